"""How fast real arms move: slowly to where the scan begins, else with the share that was given, or a careful one."""

from __future__ import annotations

import importlib.util
import re
import struct
import sys
import types
from pathlib import Path

import numpy as np
import pytest

from surfuse.arms import ur_rtde
from surfuse.commands.acquire.acquisition import acquire, resume
from surfuse.commands.acquire.consent import FIRST_MOVES_SHARE
from surfuse.commands.outcome import SilentWatcher
from surfuse.rig.assembled import assembled
from surfuse.rig.real.assembly import real_rig
from surfuse.rig.real.camera import LOOKING_SHARE, SlowJoints
from surfuse.settings import load

HERE = Path(__file__).parent


def module_of(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


any_devices = module_of(HERE / "test_any_devices.py")
JOINT_SPEED_RAD_S = np.radians(60.0)  # the default of arm.joint_speed_deg_s


@pytest.fixture
def joint_rig(tmp_path):
    """An arm of joints behind a bridge that keeps the share of every move."""
    pytest.importorskip("mujoco")
    rig = any_devices.joint_rig(tmp_path)
    rig.shares, move = [], rig.move

    def keep(to):
        rig.shares.append(to.speed_share)
        return move(to)

    rig.move = keep
    with any_devices.pretended.Served(rig) as served:
        yield rig, any_devices.joint_cell(tmp_path, served.address)


def test_joints_behind_a_bridge_go_slowly_to_where_the_scan_begins_or_goes_on(joint_rig, tmp_path):
    rig, path = joint_rig
    assert not acquire(load(path), tmp_path / "run", any_devices.StopsAfter(7), yes=True).complete
    # To the first stop, to it once more as part of the walk, and on: nobody gave a share, so the bridge's own speed.
    assert rig.shares == [FIRST_MOVES_SHARE] + [None] * 7
    rig.shares.clear()
    assert resume(tmp_path / "run", SilentWatcher(), yes=True).complete
    assert rig.shares[0] == FIRST_MOVES_SHARE
    assert set(rig.shares[1:]) == {None}


@pytest.mark.parametrize(("given", "first"), [(0.1, 0.1), (0.8, FIRST_MOVES_SHARE), (1.0, FIRST_MOVES_SHARE)])
def test_a_share_that_was_given_holds_and_the_first_move_is_never_faster(joint_rig, tmp_path, given, first):
    rig, path = joint_rig
    settings = load(path, [f"arm.speed_share={given}"])
    acquire(settings, tmp_path / "run", any_devices.StopsAfter(3), yes=True)
    assert rig.shares == [first] + [given] * 3


def test_a_camera_on_an_arm_of_joints_is_brought_slowly(joint_rig):
    rig, path = joint_rig
    made = real_rig(load(path))
    with made.opened():
        SlowJoints(made.motion.arm).move_to(rig.joints_rad + 0.01)
    assert rig.shares == [LOOKING_SHARE]


def test_nobody_said_how_fast_a_real_arm_is_careful_and_the_simulated_one_as_ever(tmp_path):
    real = ['arm.driver="ur_rtde"', 'arm.host="127.0.0.1"']
    assert load(None, real).arm.share_of_speed == 0.5
    assert load(None, [*real, "arm.speed_share=1.0"]).arm.share_of_speed == 1.0
    assert load(None).arm.share_of_speed == 1.0
    assert load(None, ["arm.speed_share=0.3"]).arm.share_of_speed == 0.3


class Controller:
    """A controller whose arm is at once where a script sends it; `scripts` are all that it was sent."""

    def __init__(self) -> None:
        self.scripts, self.joints_rad, self.stamp_s = [], np.zeros(6), 0.0

    # What is asked through the library.
    def getTimestamp(self):
        self.stamp_s += 0.01
        return self.stamp_s

    def getActualQ(self):
        return list(self.joints_rad)

    def getActualQd(self):
        return [0.0] * 6

    def getRobotMode(self):
        return 7

    def getSafetyMode(self):
        return 1

    def isConnected(self):
        return True

    def disconnect(self):
        pass

    # The lines to its ports.
    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass

    def settimeout(self, seconds):
        pass

    def recv(self, size):
        return struct.pack(">HBB", 4, ord("V"), 1)

    def close(self):
        pass

    def sendall(self, message):
        if found := re.search(rb"movej\(\[(.*)\], a=(.*), v=(.*)\)", message):
            self.joints_rad = np.array([float(angle) for angle in found[1].split(b",")])
            self.scripts.append(float(found[3]))


@pytest.fixture
def controller(monkeypatch):
    made = Controller()
    library = types.ModuleType("rtde_receive")
    library.RTDEReceiveInterface = lambda *words: made
    monkeypatch.setitem(sys.modules, "rtde_receive", library)
    monkeypatch.setattr(ur_rtde.socket, "create_connection", lambda *words: made)
    return made


@pytest.mark.parametrize(("given", "share"), [("", 0.5), ("speed_share = 1.0\n", 1.0)])
def test_what_is_sent_to_a_universal_robot(controller, tmp_path, given, share):
    pytest.importorskip("mujoco")
    file = tmp_path / "arm.xml"
    file.write_text(module_of(HERE.parent / "arms" / "test_model_file.py").SIX, "utf-8")
    path = any_devices.written(
        tmp_path,
        f'[arm]\ndriver = "ur_rtde"\nhost = "127.0.0.1"\nfile = "{file}"\ntool = "flange"\nsettle_s = 0.01\n{given}',
        f'[[sensor]]\nname = "us0"\ndriver = "tfmini"\nmodel = "tfmini-plus"\nport = "?"\n{any_devices.LASER}',
        any_devices.AREA,
    )
    arm = real_rig(load(path)).motion.arm
    with arm:
        arm.move_to(np.full(6, -0.1), FIRST_MOVES_SHARE)
        arm.move_to(np.full(6, -0.2))
    np.testing.assert_allclose(
        controller.scripts, [FIRST_MOVES_SHARE * JOINT_SPEED_RAD_S, share * JOINT_SPEED_RAD_S], rtol=1e-5
    )


@pytest.mark.parametrize("driver", ["kinematic", "trident"])
def test_the_arms_of_the_simulated_cell_take_longer_with_a_smaller_share_and_no_time_without(driver):
    def duration_s(share, *more):
        rig = assembled(load(None, [f"arm.driver={driver}", "scene.name=flat", "arm.settle_s=0.0", *more]))
        arm = rig.motion.arm
        with arm:
            began = arm.joint_state()
            target = began.position_rad + 0.2
            reached = arm.move_to(target, share)
        np.testing.assert_allclose(reached.position_rad, target, atol=2e-3)
        return reached.t_s - began.t_s

    whole = duration_s(None)
    assert duration_s(1.0) == whole
    assert duration_s(0.25) > 1.5 * whole
    if driver == "kinematic":
        assert duration_s(0.25) == pytest.approx(4.0 * whole)
    slow = "arm.speed_share=0.5"
    assert duration_s(0.8, slow) == duration_s(None, slow)
    assert duration_s(0.25, slow) > duration_s(None, slow)
