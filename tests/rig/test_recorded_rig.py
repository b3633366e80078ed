"""A scan played back from its log: the devices of the cell file are recorded, the map is that of the scan."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from surfuse.commands.acquire.acquisition import acquire, resume
from surfuse.commands.acquire.dry_run import dry_run
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import ConfigError, DataError, DeviceError, UnreachableError
from surfuse.exporters import nc
from surfuse.geometry.poses import pose
from surfuse.runs.log_reader import read_log
from surfuse.settings import load

HERE = Path(__file__).parent


def module_of(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


any_devices = module_of(HERE / "test_any_devices.py")
pretended = any_devices.pretended
LIGHT = 'kind = "laser"\nbeam_full_angle_deg = 1.0\nrange_min_m = 0.05\nrange_max_m = 1.5\nsigma_m = 0.001\n'
PLACES = {"a": (0.03, 0.0, 0.01), "b": (-0.03, 0.0, 0.0)}
AREA = (
    "[area]\norigin_m = [0.40, -0.04, 0.0]\nu = [1.0, 0.0, 0.0]\nv = [0.0, 1.0, 0.0]\nwidth_m = 0.08\n"
    'height_m = 0.04\ntallest_m = 0.1\n[scan]\nstep_m = 0.02\nstandoff_m = 0.4\n[fusion]\nmethod = "median"\n'
)


def cell(folder, arm, sensors, area=AREA):
    tables = [
        f'[[sensor]]\nname = "{name}"\n{driver}\nposition_m = {list(PLACES[name])}\n{LIGHT}'
        for name, driver in sensors.items()
    ]
    (folder / "rig.toml").write_text("\n".join([f"[arm]\n{arm}", *tables, area]), "utf-8")
    return folder / "rig.toml"


def play(folder, arm, names=("a", "b"), area=AREA, out="again", watcher=None):
    path = cell(folder, arm, dict.fromkeys(names, 'driver = "recorded"'), area)
    # Nothing moves, so nobody is asked.
    return acquire(load(path), folder / out, watcher or SilentWatcher())


@pytest.fixture
def of_poses(tmp_path):
    """A run of an arm that is sent to poses."""
    rig = pretended.PretendedRig(tuple(PLACES), tuple(PLACES.values()))
    with pretended.Served(rig) as served:
        path = cell(tmp_path, f'driver = "bridge"\naddress = "{served.address}"', dict.fromkeys(PLACES, ""))
        acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True)
    return tmp_path / "run"


@pytest.fixture
def of_joints(tmp_path):
    """A run of an arm of joints, and the keys of its file."""
    pytest.importorskip("mujoco")
    from surfuse.arm_models import model_file

    file = tmp_path / "arm.urdf"
    file.write_text(module_of(HERE.parent / "arms" / "test_model_file.py").seven(), "utf-8")
    kinematics = model_file.create(file, "tool", np.eye(4), np.eye(4))
    down, _ = kinematics.inverse(pose(np.diag([1.0, -1.0, -1.0]), [0.45, 0.0, 0.5])[None])
    rig = any_devices.JointRig(kinematics, down[~np.isnan(down).any(axis=-1)][0])
    rig.sensors, rig.places = tuple(PLACES), [np.array(place) for place in PLACES.values()]
    keys = f'file = "{file}"\ntool = "tool"'
    with pretended.Served(rig) as served:
        path = cell(tmp_path, f'driver = "bridge"\naddress = "{served.address}"\n{keys}', dict.fromkeys(PLACES, ""))
        acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True)
    return tmp_path / "run", keys


def assert_same(one, other):
    first, second = read_log(one).readings(), read_log(other).readings()
    for column in ("range_m", "t_s", "sigma_m", "status", "world_from_grip", "joints_rad"):
        np.testing.assert_allclose(getattr(first, column), getattr(second, column), atol=1e-12, err_msg=column)
    a, b = nc.read(one / "surface.nc"), nc.read(other / "surface.nc")
    np.testing.assert_allclose(a.height_m, b.height_m, atol=1e-12)


def test_a_scan_of_poses_plays_back(of_poses, tmp_path):
    assert play(tmp_path, f'driver = "recorded"\nlog = "{of_poses}"').complete
    assert_same(tmp_path / "again", of_poses)
    events = read_log(tmp_path / "again").events
    times = read_log(of_poses).readings().t_s
    assert all(event.t_s <= times.max() for event in events)  # the clock is that of the record


def test_a_scan_of_joints_plays_back_also_in_two_parts_from_two_folders(of_joints, tmp_path, monkeypatch):
    run, keys = of_joints
    monkeypatch.chdir(run.parent)
    arm = f'driver = "recorded"\nlog = "{run.name}"\n{keys}'
    told = dry_run(load(cell(tmp_path, arm, dict.fromkeys(PLACES, 'driver = "recorded"'))), None, SilentWatcher())
    assert told.summary["collisions"] == "not checked: a recorded arm moves nothing"
    assert not play(tmp_path, arm, watcher=any_devices.StopsAfter(5)).complete
    monkeypatch.chdir(Path(run.anchor))
    assert resume(tmp_path / "again", SilentWatcher(), yes=True).complete
    first, second = nc.read(run / "surface.nc"), nc.read(tmp_path / "again" / "surface.nc")
    np.testing.assert_allclose(first.height_m, second.height_m, atol=1e-9)


def test_one_sensor_of_the_record_under_another_name(of_poses, tmp_path):
    driver = f'driver = "recorded"\nlog = "{of_poses}"\nsensor = "a"'
    path = cell(tmp_path, f'driver = "recorded"\nlog = "{of_poses}"', {"a": 'driver = "recorded"', "b": driver})
    acquire(load(path), tmp_path / "again", SilentWatcher(), yes=True)
    ranges = read_log(tmp_path / "again").readings().range_m.reshape(-1, 2)
    np.testing.assert_array_equal(ranges[:, 0], ranges[:, 1])


@pytest.mark.parametrize(
    ("arm", "names", "error", "told"),
    [
        ('driver = "recorded"', "ab", ConfigError, "no log is named"),
        ('driver = "recorded"\nlog = "nowhere"', "ab", DataError, "nowhere"),
        ('driver = "recorded"\nlog = "{run}"\ntolerance = 1.0', "ab", ConfigError, "unknown key 'arm.tolerance'"),
    ],
)
def test_records_that_cannot_be_meant_are_refused(of_poses, tmp_path, arm, names, error, told):
    with pytest.raises(error, match=told):
        play(tmp_path, arm.replace("{run}", str(of_poses)), names)


def test_stops_that_were_not_recorded_are_out_of_reach(of_poses, tmp_path):
    elsewhere = AREA.replace("origin_m = [0.40", "origin_m = [0.52")
    with pytest.raises((UnreachableError, DataError, DeviceError), match=r"stops can be visited|was recorded"):
        play(tmp_path, f'driver = "recorded"\nlog = "{of_poses}"', area=elsewhere)
