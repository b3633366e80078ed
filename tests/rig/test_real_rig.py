"""A real rig of a cell file: assembled, first met, scanned, interrupted, contradicted."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from surfuse.arms import bridge as bridge_arm
from surfuse.bridge.client import BridgeClient
from surfuse.commands.acquire.acquisition import acquire, resume
from surfuse.commands.acquire.dry_run import dry_run
from surfuse.commands.machine.doctor import doctor
from surfuse.commands.machine.starter import start
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import (
    ConfigError,
    DataError,
    DeviceError,
    InterruptError,
    SafetyStopError,
    UnreachableError,
    UsageError,
)
from surfuse.exporters import nc
from surfuse.records import Status
from surfuse.rig.real.assembly import real_rig
from surfuse.runs.log_reader import read_log
from surfuse.settings import load

HERE = Path(__file__).parent


def module_of(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


pretended = module_of(HERE / "pretended_rig.py")

LASER = 'kind = "laser"\nbeam_full_angle_deg = 1.0\nrange_min_m = 0.05\nrange_max_m = 1.5\nsigma_m = 0.001\n'
AREA = (
    "[area]\norigin_m = [-0.06, -0.04, 0.0]\nu = [1.0, 0.0, 0.0]\nv = [0.0, 1.0, 0.0]\n"
    "width_m = 0.12\nheight_m = 0.08\ntallest_m = 0.1\n[scan]\nstep_m = 0.02\nstandoff_m = 0.4\n"
)


def cell(folder: Path, address: str, sensors: str = f'[[sensor]]\nname = "us0"\n{LASER}', more: str = "") -> Path:
    path = folder / "rig.toml"
    arm = f'[arm]\ndriver = "bridge"\naddress = "{address}"\n{more}\n'
    path.write_text(f'{arm}{sensors}\n{AREA}[fusion]\nmethod = "mean"\n')
    return path


class Answering(SilentWatcher):
    """Somebody at a terminal, with the answers to come."""

    attended = True

    def __init__(self, *answers):
        self.asked, self._answers = [], list(answers)

    def ask(self, question):
        self.asked.append(question)
        return self._answers.pop(0)


class Notes(SilentWatcher):
    def __init__(self):
        self.notes = []

    def warn(self, text):
        self.notes.append(text)


@pytest.fixture
def rig():
    return pretended.PretendedRig()


@pytest.fixture
def served(rig):
    with pretended.Served(rig) as found:
        yield found


def assert_is_the_plane(run: Path) -> None:
    surface = nc.read(run / "surface.nc")
    u = np.broadcast_to(surface.grid.u_m, surface.grid.shape)
    assert surface.mask.all()
    # Along the axis the mean of one sensor is exact.
    np.testing.assert_allclose(surface.height_m, pretended.HEIGHT_M + pretended.SLOPE * (u - 0.06), atol=1e-9)


def test_a_plane_comes_out_where_it_is_in_the_frame_of_the_area(served, tmp_path):
    outcome = acquire(load(cell(tmp_path, served.address)), tmp_path / "run", SilentWatcher(), yes=True)
    assert outcome.complete
    assert outcome.summary["stops"] == 35
    assert_is_the_plane(tmp_path / "run")
    frame = nc.read(tmp_path / "run" / "surface.nc").grid.world_from_part
    np.testing.assert_allclose(frame[:3, 3], [-0.06, -0.04, 0.0])


def test_the_arm_keeps_the_quarter_turn_that_it_has(served, rig, tmp_path):
    acquire(load(cell(tmp_path, served.address)), tmp_path / "run", SilentWatcher(), yes=True)
    np.testing.assert_allclose(rig.pose[:3, :3], pretended.LOOKING_DOWN[:3, :3], atol=1e-12)


def test_nothing_moves_without_a_yes(served, rig, tmp_path):
    settings = load(cell(tmp_path, served.address))
    with pytest.raises(UsageError, match="--yes"):
        acquire(settings, tmp_path / "a", SilentWatcher())
    user = Answering("no", "y")
    with pytest.raises(InterruptError, match="has not moved"):
        acquire(settings, tmp_path / "b", user)
    assert "35 stops" in user.asked[0]
    assert rig.moves == 0
    assert resume(tmp_path / "b", user).complete
    assert_is_the_plane(tmp_path / "b")


def test_a_dry_run_and_the_doctor_move_nothing(served, rig, tmp_path):
    path = cell(tmp_path, served.address)
    outcome = dry_run(load(path), tmp_path / "dry", SilentWatcher())
    assert outcome.summary["stops"] == 35
    assert outcome.summary["predicted_robot_time_s"] > 0.0
    assert "<svg" in (tmp_path / "dry" / "plan.html").read_text("utf-8")
    found = doctor(path, [])
    assert found.summary["problems"] == []
    assert "0.5500 m" in found.summary["checks"]["us0"]["text"]
    assert (rig.moves, rig.sweeps) == (0, 1)


def test_an_area_that_turns_its_back_is_refused_before_anything_moves(served, rig, tmp_path):
    path = cell(tmp_path, served.address)
    path.write_text(path.read_text("utf-8").replace("v = [0.0, 1.0, 0.0]", "v = [0.0, -1.0, 0.0]"), "utf-8")
    for command in (
        lambda: acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True),
        lambda: dry_run(load(path), None, SilentWatcher()),
    ):
        with pytest.raises(ConfigError, match=r"w = u x v .* along the beams .*; w points out of the part"):
            command()
    found = doctor(path, []).summary
    assert found["problems"]
    assert "along the beams" in found["checks"]["area"]["text"]
    assert rig.moves == 0


def test_when_the_arm_refuses_every_stop_nothing_is_called_complete(served, rig, tmp_path):
    rig.refused_x_m = -1.0
    with pytest.raises(UnreachableError, match=r"refused all 35 stops, the last because .*beyond the end of the rail"):
        acquire(load(cell(tmp_path, served.address)), tmp_path / "run", SilentWatcher(), yes=True)
    rig.refused_x_m = np.inf
    assert resume(tmp_path / "run", SilentWatcher(), yes=True).complete
    assert_is_the_plane(tmp_path / "run")


@pytest.mark.parametrize(
    ("sensor", "told"),
    [
        ("rnage_max_m = 1.0", r"'us0': unknown key 'rnage_max_m'; did you mean 'range_max_m'"),
        ('driver = "tfmimi"', r"'us0': there is no driver 'tfmimi'; did you mean 'tfmini'"),
    ],
)
def test_a_slip_in_the_table_of_a_sensor_is_named(served, tmp_path, sensor, told):
    path = cell(tmp_path, served.address, f'[[sensor]]\nname = "us0"\n{sensor}\n{LASER}')
    with pytest.raises(ConfigError, match=told):
        acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True)


def test_millimetres_for_the_place_of_the_area_are_noticed(served, tmp_path):
    path = cell(tmp_path, served.address)
    path.write_text(path.read_text("utf-8").replace("[-0.06, -0.04, 0.0]", "[-60, -40, 0]"), "utf-8")
    with pytest.raises(ConfigError, match=r"area.origin_m .* limit 30 m; give metres"):
        load(path)


def test_stops_that_the_arm_refuses_are_left_out(served, rig, tmp_path):
    rig.refused_x_m = 0.03
    watcher = Notes()
    outcome = acquire(load(cell(tmp_path, served.address)), tmp_path / "run", watcher, yes=True)
    assert outcome.complete
    assert outcome.summary["stops"] == 25
    assert sum("beyond the end of the rail" in note for note in watcher.notes) == 10


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ({"ends_off_m": 0.020, "ends_off_at": 12}, "20.000 mm from where it was sent"),
        ({"drifts_m": 0.012, "drifts_at": 12}, "moved by 12.000 mm"),
    ],
)
def test_a_pose_that_is_not_the_one_sent_is_a_safety_stop_and_the_run_can_be_gone_on_with(
    served, rig, tmp_path, fault, told
):
    for name, value in fault.items():
        setattr(rig, name, value)
    with pytest.raises(SafetyStopError, match=told) as caught:
        acquire(load(cell(tmp_path, served.address)), tmp_path / "run", SilentWatcher(), yes=True)
    assert "surfuse resume" in str(caught.value)
    assert 5 <= len(read_log(tmp_path / "run").sweeps) < 35
    assert resume(tmp_path / "run", SilentWatcher(), yes=True).complete
    assert_is_the_plane(tmp_path / "run")


def test_a_bridge_that_dies_is_a_device_error_and_the_scan_goes_on_with_the_next_one(tmp_path):
    def started():
        program = subprocess.Popen(
            [sys.executable, str(HERE / "pretended_rig.py"), "0"], stdout=subprocess.PIPE, text=True
        )
        return program, program.stdout.readline().strip()

    class Killer(SilentWatcher):
        def __init__(self, program, after):
            self.program, self.left = program, after

        def advance(self, steps=1):
            self.left -= steps
            if self.left == 0:
                self.program.kill()

    program, address = started()
    with pytest.raises(DeviceError, match="surfuse resume"):
        acquire(load(cell(tmp_path, address)), tmp_path / "run", Killer(program, 9), yes=True)
    program.communicate()
    assert len(read_log(tmp_path / "run").sweeps) >= 9
    port = address.rpartition(":")[2]
    again = subprocess.Popen([sys.executable, str(HERE / "pretended_rig.py"), port], stdout=subprocess.PIPE, text=True)
    try:
        assert again.stdout.readline().strip() == address
        assert resume(tmp_path / "run", SilentWatcher(), yes=True).complete
    finally:
        again.kill()
        again.communicate()
    assert_is_the_plane(tmp_path / "run")


def test_a_bridge_that_falls_silent_in_a_sweep_is_given_up_after_one_wait(served, rig, tmp_path):
    waiting, sweep = threading.Event(), rig.sweep

    def silent(sensors):
        if rig.sweeps == 4:
            rig.sweeps += 1
            waiting.wait(60.0)
        return sweep(sensors)

    rig.sweep = silent
    path = cell(tmp_path, served.address, more="sweep_timeout_s = 0.4\ngive_up_s = 0.5")
    told = r"no answer to 'sweep' within 0.4 s; .* firing_time_s, or a longer arm.sweep_timeout_s"
    with pytest.raises(DeviceError, match=told) as given_up:
        acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True)
    assert given_up.value.exit_status == 4
    assert len(read_log(tmp_path / "run").sweeps) == 4
    waiting.set()
    assert resume(tmp_path / "run", SilentWatcher(), yes=True).complete
    assert_is_the_plane(tmp_path / "run")


@pytest.mark.parametrize(
    ("firing_s", "more", "wait_s"),
    [([], "", 4.0), ([1.0, 1.0], "", 4.0), ([1.5, 2.0], "", 7.0), ([1.5, 2.0], "sweep_timeout_s = 3.0", 3.0)],
)
def test_slow_sensors_are_waited_for_twice_their_time_and_others_less_than_five_seconds(
    served, rig, tmp_path, monkeypatch, firing_s, more, wait_s
):
    sensors = "".join(
        f'[[sensor]]\nname = "us{k}"\n{LASER}firing_time_s = {seconds}\n' for k, seconds in enumerate(firing_s)
    )
    # A sensor with a driver of its own is not fired by the bridge, so that its time does not count.
    own = 'driver = "tfmini"\nmodel = "tfmini-plus"\nport = "?"\nfiring_time_s = 60.0\n'
    beside = f'[[sensor]]\nname = "slow"\n{own}{LASER}'
    waits = []

    class Patient(BridgeClient):
        def __init__(self, transport, patience, tolerances):
            waits.append(patience)
            super().__init__(transport, patience, tolerances)

    monkeypatch.setattr(bridge_arm, "BridgeClient", Patient)
    made = real_rig(
        load(cell(tmp_path, served.address, (sensors or f'[[sensor]]\nname = "us0"\n{LASER}') + beside, more))
    )
    with made.poses:
        made.poses.tool_state()
    (patience,) = waits
    assert patience.sweep_timeout_s == wait_s
    # A sweep that is not answered is not asked again: the second wait would end after the bridge is given up.
    assert 2.0 * patience.sweep_timeout_s > patience.give_up_s


def test_sensors_of_any_kinds_and_places_scan_together(tmp_path):
    rig = pretended.PretendedRig(("a", "b", "c"), [(0.03, 0.0, 0.01), (-0.03, 0.0, 0.0), (0.0, 0.02, -0.01)])
    places = {"a": [0.03, 0.0, 0.01], "b": [-0.03, 0.0, 0.0], "c": [0.0, 0.02, -0.01]}
    kinds = {"a": "laser", "b": "tof", "c": "infrared"}
    tables = "".join(
        f'[[sensor]]\nname = "{name}"\n{LASER.replace("laser", kinds[name])}position_m = {place}\n'
        for name, place in places.items()
    )
    with pretended.Served(rig) as served:
        settings = load(cell(tmp_path, served.address, tables), ["fusion.method=own_axis_median"])
        acquire(settings, tmp_path / "run", SilentWatcher(), yes=True)
    scan = read_log(tmp_path / "run").readings()
    hit = scan.position_m + scan.range_m[:, None] * scan.axis
    np.testing.assert_allclose(hit[:, 2], pretended.HEIGHT_M + pretended.SLOPE * hit[:, 0], atol=1e-9)
    assert [spec.kind for spec in scan.specs] == ["laser", "tof", "infrared"]


@pytest.mark.parametrize(
    ("sensors", "more", "told"),
    [
        ("", "", "no sensor"),
        (f'[[sensor]]\nname = "a"\n{LASER}[[sensor]]\nname = "a"\n{LASER}', "", "two sensors are called 'a'"),
        (f'[[sensor]]\nname = "a"\n{LASER}axis = [0.0, 0.0, 90.0]\n', "", "length 90, wanted 1"),
        (f'[[sensor]]\nname = "a"\n{LASER}axis = [0.0, 0.0, -1.0]\n', "", "looks back at the tool"),
        (f'[[sensor]]\nname = "a"\n{LASER}position_m = [25.0, 0.0, 0.0]\n', "", "give metres"),
        (f'[[sensor]]\nname = "a"\n{LASER}driver = "tfmimi"\n', "", "did you mean 'tfmini'"),
        (f'[[sensor]]\nname = "us0"\n{LASER}', "adress = 'x'\n", "did you mean 'address'"),
        (f'[[sensor]]\nname = "us9"\n{LASER}', "", "no sensor 'us9'"),
    ],
)
def test_cell_files_that_cannot_be_meant_are_refused(served, rig, tmp_path, sensors, more, told):
    with pytest.raises((ConfigError, UsageError, DeviceError), match=told):
        acquire(load(cell(tmp_path, served.address, sensors, more)), tmp_path / "run", SilentWatcher(), yes=True)
    assert rig.moves == 0


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("u = [1.0, 0.0, 0.0]", "u = [2.0, 0.0, 0.0]", "length 2, wanted 1"),
        ("v = [0.0, 1.0, 0.0]", "v = [0.6, 0.8, 0.0]", "enclose 53.13 degrees"),
        ("height_m = 0.08\n", "", "no height_m"),
        ('driver = "bridge"', 'driver = "brige"', "did you mean 'bridge'"),
        ("tcp://127.0.0.1", "tcp://192.0.2.1", "allow_remote"),
    ],
)
def test_areas_and_arms_that_cannot_be_meant_are_refused(served, rig, tmp_path, old, new, told):
    path = cell(tmp_path, served.address)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises((ConfigError, UsageError, DeviceError), match=told):
        acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True)
    assert rig.moves == 0


def test_a_bridge_that_is_not_there_is_told_soon(tmp_path):
    began = time.monotonic()
    with pytest.raises(DeviceError, match=r"127\.0\.0\.1:9"):
        acquire(load(cell(tmp_path, "tcp://127.0.0.1:9")), tmp_path / "run", SilentWatcher(), yes=True)
    assert time.monotonic() - began < 60.0  # only a hang is an error here


def test_a_command_in_one_text_is_shown_as_the_list_that_it_should_be(tmp_path):
    path = cell(tmp_path, "unused")
    path.write_text(path.read_text("utf-8").replace('address = "unused"', 'command = "python3 bridge.py"'), "utf-8")
    with pytest.raises(ConfigError, match=r"arm.command = 'python3 bridge.py'; give .* as \['python3', 'bridge.py'\]"):
        acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True)


def test_a_dry_run_knows_the_method_that_the_scan_would_refuse(served, tmp_path):
    path = cell(tmp_path, served.address)
    path.write_text(path.read_text("utf-8").replace('method = "mean"', 'method = "maen"'), "utf-8")
    with pytest.raises(ConfigError, match=r"fusion.method = 'maen': .* did you mean 'mean'"):
        dry_run(load(path), None, SilentWatcher())


class Impatient(SilentWatcher):
    """Stops the scan after three sweeps."""

    def __init__(self):
        self.sweeps = 0

    def advance(self, steps=1):
        self.sweeps += steps

    def stop_requested(self):
        return self.sweeps >= 3


def test_a_bridge_that_is_a_program_of_the_folder_is_resumed_from_another_one(tmp_path, monkeypatch):
    start(tmp_path / "rig", overwrite=False)
    monkeypatch.chdir(tmp_path / "rig")
    settings = load(Path("rig.toml"), ["fusion.method=mean", "scan.step_m=0.03"])
    assert not acquire(settings, tmp_path / "run", Impatient(), yes=True).complete
    monkeypatch.chdir(tmp_path)
    assert resume(tmp_path / "run", SilentWatcher(), yes=True).complete


def test_a_sensor_that_reports_only_faults_is_named(tmp_path):
    rig = pretended.PretendedRig()
    rig.status = Status.FAULT
    with (
        pretended.Served(rig) as served,
        pytest.raises(DataError, match=r"none of its .* stops gave a value; 'us0' reported 'fault' in every reading"),
    ):
        acquire(load(cell(tmp_path, served.address)), tmp_path / "run", SilentWatcher(), yes=True)


def test_a_clock_that_stands_still_ends_the_scan(tmp_path):
    rig = pretended.PretendedRig()
    rig.now_s = lambda: 7.0
    with (
        pretended.Served(rig) as served,
        pytest.raises(SafetyStopError, match=r"clock of the bridge stands still: t_s = 7\.0.*; stamp each.*resume"),
    ):
        acquire(load(cell(tmp_path, served.address)), tmp_path / "run", SilentWatcher(), yes=True)
    assert 0 < len(read_log(tmp_path / "run").sweeps) < 7
