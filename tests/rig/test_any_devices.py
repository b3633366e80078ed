"""Whole scans by rigs of other kinds: a gantry that probes, an arm of joints, sensors of several kinds and lines."""

from __future__ import annotations

import importlib.util
import os
import sys
import threading
import tty
from pathlib import Path

import numpy as np
import pytest

from surfuse.bridge.messages import ArmKind, ArmOfBridge, Hello, State
from surfuse.commands.acquire.acquisition import acquire, resume
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import SafetyStopError
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


pretended = module_of(HERE / "pretended_rig.py")
LASER = 'kind = "laser"\nbeam_full_angle_deg = 1.0\nrange_min_m = 0.05\nrange_max_m = 1.5\nsigma_m = 0.001\n'
AREA = (
    "[area]\norigin_m = [-0.06, -0.04, 0.0]\nu = [1.0, 0.0, 0.0]\nv = [0.0, 1.0, 0.0]\nwidth_m = 0.12\n"
    'height_m = 0.08\ntallest_m = 0.1\n[scan]\nstep_m = 0.02\nstandoff_m = 0.4\n[fusion]\nmethod = "median"\n'
)


class StopsAfter(SilentWatcher):
    """Stops a scan after so many sweeps."""

    def __init__(self, sweeps):
        self._left = sweeps

    def advance(self, steps=1):
        self._left -= steps

    def stop_requested(self):
        return self._left <= 0


def written(folder: Path, *tables: str) -> Path:
    (folder / "rig.toml").write_text("\n".join(tables), "utf-8")
    return folder / "rig.toml"


def off_the_plane_m(run: Path) -> float:
    """How far the map (part frame at height 0) is from the pretended plane z = height + slope x, at most."""
    surface = nc.read(run / "surface.nc")
    assert surface.mask.sum() > 0.9 * surface.mask.size
    x_m = surface.grid.world_from_part[0, 3] + np.broadcast_to(surface.grid.u_m, surface.grid.shape)
    expected_m = pretended.HEIGHT_M + pretended.SLOPE * x_m - surface.grid.world_from_part[2, 3]
    return float(np.abs(surface.height_m - expected_m)[surface.mask].max())


@pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")
@pytest.mark.parametrize("dialect", ["marlin", "grbl"])
def test_a_gantry_probes_a_plate(tmp_path, dialect):
    pytest.importorskip("serial")
    sys.path.insert(0, str(HERE.parent / "stand_ins"))
    from gcode_boards import Grbl, Marlin

    with {"marlin": Marlin, "grbl": Grbl}[dialect]() as board:
        board.part_mm = 70.0
        line = f'port = "{board.port}"\ndialect = "{dialect}"\n'
        path = written(
            tmp_path,
            f'[arm]\ndriver = "gcode"\n{line}travel_min_m = [0, 0, 0]\ntravel_max_m = [0.3, 0.3, 0.3]\nsettle_s = 0.0',
            "feed_mm_min = 3000.0",
            f'[[sensor]]\nname = "tip"\ndriver = "gcode_probe"\n{line}probe_feed_mm_min = 3000.0',
            "[area]\norigin_m = [0.1, 0.1, 0.05]\nu = [1.0, 0.0, 0.0]\nv = [0.0, 1.0, 0.0]",
            "width_m = 0.04\nheight_m = 0.02\ntallest_m = 0.01",
            '[scan]\nstep_m = 0.02\nstandoff_m = 0.04\nmargin_m = 0.0\n[fusion]\nmethod = "median"',
        )
        assert acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True).complete
    surface = nc.read(tmp_path / "run" / "surface.nc")
    assert surface.mask.all()
    np.testing.assert_allclose(surface.height_m, 0.02, atol=1e-5)


class JointRig(pretended.PretendedRig):
    """Only its joints are known; where the sensors are follows from the file of the arm."""

    def __init__(self, kinematics, ready_rad):
        super().__init__()
        self.kinematics, self.joints_rad = kinematics, ready_rad
        self.pose = kinematics.forward(ready_rad)

    def hello(self):
        return Hello("joints", ArmOfBridge(ArmKind.JOINTS, len(self.joints_rad)), self.sensors)

    def state(self):
        return State(super().state().t_s, None, self.joints_rad)

    def move(self, to):
        self.moves += 1
        self.joints_rad = np.array(to.joints_rad)
        self.pose = self.kinematics.forward(self.joints_rad)
        return self.state()


def joint_rig(tmp_path):
    from surfuse.arm_models import model_file

    seven = module_of(HERE.parent / "arms" / "test_model_file.py").seven
    (tmp_path / "arm.urdf").write_text(seven(), "utf-8")
    kinematics = model_file.create(tmp_path / "arm.urdf", "tool", np.eye(4), np.eye(4))
    down, _ = kinematics.inverse(pose(np.diag([1.0, -1.0, -1.0]), [0.45, 0.0, 0.5])[None])
    return JointRig(kinematics, down[~np.isnan(down).any(axis=-1)][0])


def joint_cell(tmp_path, address):
    return written(
        tmp_path,
        f'[arm]\ndriver = "bridge"\naddress = "{address}"\nfile = "{tmp_path / "arm.urdf"}"\ntool = "tool"',
        f'[[sensor]]\nname = "us0"\n{LASER}',
        AREA.replace("[-0.06, -0.04, 0.0]", "[0.40, -0.04, 0.0]"),
    )


def test_an_arm_of_joints_behind_a_bridge(tmp_path):
    pytest.importorskip("mujoco")
    rig = joint_rig(tmp_path)
    with pretended.Served(rig) as served:
        path = joint_cell(tmp_path, served.address)
        assert not acquire(load(path), tmp_path / "run", StopsAfter(7), yes=True).complete
        assert resume(tmp_path / "run", SilentWatcher(), yes=True).complete
    assert rig.moves >= 35
    assert off_the_plane_m(tmp_path / "run") < 2.1e-3  # a cell of 2 cm on a slope of a tenth


def test_an_arm_of_joints_that_moves_while_the_sensors_fire_is_noticed(tmp_path):
    pytest.importorskip("mujoco")
    rig = joint_rig(tmp_path)
    sweep = rig.sweep

    def moves(sensors):
        answer = sweep(sensors)
        if rig.sweeps == 5:
            rig.joints_rad = rig.joints_rad + 0.05
        return answer

    rig.sweep = moves
    with (
        pretended.Served(rig) as served,
        pytest.raises(SafetyStopError, match=r"2\.865 deg at joint \d without a move"),
    ):
        acquire(load(joint_cell(tmp_path, served.address)), tmp_path / "run", SilentWatcher(), yes=True)
    assert len(read_log(tmp_path / "run").sweeps) == 4


class TfminiOnALine:
    """A TFmini-Plus on a pseudo-terminal: a hundred readings a second of what the rig has in front of it."""

    def __init__(self, rig, place):
        self._rig, self._place, self._end = rig, np.append(place, 1.0), threading.Event()

    def __enter__(self):
        self._controller, self._device = os.openpty()
        tty.setraw(self._controller)
        tty.setraw(self._device)
        self.port = os.ttyname(self._device)
        self._thread = threading.Thread(target=self._talk, daemon=True)
        self._thread.start()
        return self

    def _talk(self):
        while not self._end.wait(0.01):
            start, axis = (self._rig.pose @ self._place)[:3], self._rig.pose[:3, 2]
            plane_m = pretended.HEIGHT_M + pretended.SLOPE * start[0]
            centimetres = round(100.0 * (plane_m - start[2]) / (axis[2] - pretended.SLOPE * axis[0]))
            head = b"\x59\x59" + centimetres.to_bytes(2, "little") + (1000).to_bytes(2, "little") + b"\x00\x00"
            os.write(self._controller, head + bytes([sum(head) & 0xFF]))

    def __exit__(self, *_):
        self._end.set()
        self._thread.join()
        os.close(self._controller)
        os.close(self._device)


@pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")
def test_sound_and_light_side_by_side_over_a_bridge_and_a_serial_line(tmp_path):
    pytest.importorskip("serial")
    places = ((0.0, 0.0, 0.0), (0.03, 0.0, 0.0))
    rig = pretended.PretendedRig(("spot", "wide"), places)
    with pretended.Served(rig) as served, TfminiOnALine(rig, (0.0, 0.03, 0.0)) as tfmini:
        path = written(
            tmp_path,
            f'[arm]\ndriver = "bridge"\naddress = "{served.address}"',
            f'[[sensor]]\nname = "spot"\n{LASER}position_m = [0.0, 0.0, 0.0]',
            '[[sensor]]\nname = "wide"\nkind = "ultrasonic"\nposition_m = [0.03, 0.0, 0.0]\nfrequency_hz = 40000.0\n'
            "beam_full_angle_deg = 20.0\nrange_min_m = 0.1\nrange_max_m = 2.0\nsigma_m = 0.002",
            f'[[sensor]]\nname = "light"\ndriver = "tfmini"\nport = "{tfmini.port}"\nmodel = "tfmini-plus"\n'
            "position_m = [0.0, 0.03, 0.0]\nsigma_m = 0.005\nrange_min_m = 0.1",
            AREA,
        )
        outcome = acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True)
    assert outcome.complete
    clock = outcome.summary["clock"]
    assert clock["brought_to_it"] == ["light"]
    assert clock["keeps_pace"]
    assert 0.0 < clock["uncertainty_ms"] < 1e3
    readings = read_log(tmp_path / "run").readings()
    assert [spec.kind for spec in readings.specs] == ["laser", "ultrasonic", "tof"]
    assert set(np.unique(readings.sensor)) == {0, 1, 2}
    assert off_the_plane_m(tmp_path / "run") < 8e-3  # the light counts whole centimetres
