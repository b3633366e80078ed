"""The driver for Universal Robots arms against a stand-in that speaks RTDE on loopback, in a process of its own."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.arm_models.puma560 import Puma560
from surfuse.arms import ur_rtde
from surfuse.errors import ConfigError, DeviceError, SafetyStopError
from surfuse.motion.arm_surroundings import ArmSurroundings, Guard
from surfuse.motion.limits import JointLimits
from surfuse.records import FloatArray

pytest.importorskip("rtde_receive")
if not sys.platform.startswith("linux"):
    pytest.skip("other loopback addresses than 127.0.0.1 need Linux", allow_module_level=True)

# The ports of the protocol are fixed, so the stand-in gets an address of its own.
ADDRESS = f"127.73.{os.getpid() // 250 % 250 + 1}.{os.getpid() % 250 + 1}"
OTHER_ADDRESS, NOBODY = ADDRESS.replace("127.73.", "127.76."), ADDRESS.replace("127.73.", "127.78.")
KINEMATICS = Puma560(np.eye(4), np.eye(4))
LIMITS = JointLimits(np.full(6, -6.2), np.full(6, 6.2), np.full(6, 3.0), np.full(6, 10.0))
# Nothing but a hang waits so long.
PATIENT = ur_rtde.Parameters(ADDRESS, speed_share=1.0, settle_s=0.03, grace_s=300.0, answer_timeout_s=300.0)
TARGET = np.array([0.2, -0.1, 0.15, 0.05, -0.2, 0.1])


class WallClock:
    def now_s(self) -> float:
        return time.monotonic()

    def advance(self, duration_s: float) -> None:
        raise AssertionError("nobody advances real time")


class StandIn:
    def __init__(self, address: str) -> None:
        command = [sys.executable, str(Path(__file__).parent / "ur_stand_in.py"), address]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"

    def tell(self, order: str) -> None:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(order + "\n")
        self.process.stdin.flush()
        assert self.process.stdout.readline() == "done\n"

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()


class Opened:
    """An open arm, and the guard of its moves, which refuses them when told to."""

    robot: ur_rtde.UrArm
    refuses = False

    def __call__(self, start: FloatArray, end: FloatArray) -> None:
        if self.refuses:
            raise SafetyStopError("too near")


@pytest.fixture(scope="module")
def ready() -> Iterator[tuple[StandIn, Opened]]:
    """A controller in order and its arm, for tests that leave it so: the library takes a second to part from it."""
    stand_in = StandIn(ADDRESS)
    guard = Opened()
    with arm(guard) as robot:
        guard.robot = robot
        yield stand_in, guard
    stand_in.close()


@pytest.fixture
def controller() -> Iterator[StandIn]:
    """One that may be left in any state."""
    stand_in = StandIn(OTHER_ADDRESS)
    yield stand_in
    stand_in.close()


def arm(guard: Guard | None = None, **how: float | str) -> ur_rtde.UrArm:
    surroundings = ArmSurroundings(KINEMATICS, LIMITS, WallClock(), guard)
    return ur_rtde.create(replace(PATIENT, surroundings=surroundings, **how))


def until_it_fails(robot: ur_rtde.UrArm) -> None:
    while True:
        robot.joint_state()
        time.sleep(0.01)


def until_it_reads(robot: ur_rtde.UrArm, name: str, value: int) -> None:
    """Wait for a change of the controller to come with its data."""
    while getattr(robot._receiver, name)() != value:
        time.sleep(0.002)


def test_the_arm_goes_where_it_is_told_and_says_so(ready: tuple[StandIn, Opened]) -> None:
    for target in (TARGET, -TARGET):
        began = time.monotonic()
        state = ready[1].robot.move_to(target)
        assert_allclose(state.position_rad, target, atol=5e-4)
        assert began < state.t_s <= time.monotonic()


def test_targets_outside_the_limits_and_refused_ways_are_not_sent(
    ready: tuple[StandIn, Opened], monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = ready[1].robot
    before = robot.joint_state().position_rad
    monkeypatch.setattr(ready[1], "refuses", True)
    with pytest.raises(SafetyStopError, match="joint 1 is nan"):
        robot.move_to(np.full(6, np.nan))
    with pytest.raises(SafetyStopError, match=r"joint 2 is 400\.00 deg"):
        robot.move_to(np.radians([0.0, 400.0, 0.0, 0.0, 0.0, 0.0]))
    with pytest.raises(SafetyStopError, match="too near"):
        robot.move_to(0.5 * TARGET)
    time.sleep(0.05)
    assert_allclose(robot.joint_state().position_rad, before)


def test_a_protective_stop_is_a_safety_stop_and_the_arm_can_go_on(ready: tuple[StandIn, Opened]) -> None:
    controller, robot = ready[0], ready[1].robot
    controller.tell("stop")
    until_it_reads(robot, "getSafetyMode", 3)
    with pytest.raises(SafetyStopError, match=r"safety mode 3 \(protective stop\).*unlock"):
        robot.move_to(TARGET)
    controller.tell("unlock")
    until_it_reads(robot, "getSafetyMode", 1)
    assert_allclose(robot.move_to(TARGET).position_rad, TARGET, atol=5e-4)


def test_an_arm_that_is_off_or_does_not_move_or_falls_silent_is_a_device_error(controller: StandIn) -> None:
    with arm(host=OTHER_ADDRESS, grace_s=0.5) as robot:
        controller.tell("robot 3")
        until_it_reads(robot, "getRobotMode", 3)
        with pytest.raises(DeviceError, match=r"robot mode 3, wanted 7"):
            robot.move_to(TARGET)
        controller.tell("robot 7")
        controller.tell("deaf")
        until_it_reads(robot, "getRobotMode", 7)
        with pytest.raises(DeviceError, match=r"joint 1 is still 11\.46 deg from its target after"):
            robot.move_to(TARGET)
    with arm(host=OTHER_ADDRESS, answer_timeout_s=0.6) as robot:
        controller.tell("mute")
        with pytest.raises(DeviceError, match=r"no data from the controller for \d+\.\d s, at most 0.6 s"):
            until_it_fails(robot)


def test_nobody_at_the_address() -> None:
    with pytest.raises(DeviceError, match="no RTDE answer on port 30004"), arm(host=NOBODY):
        pass


@pytest.mark.parametrize(
    ("answer", "timeout_s", "words"),
    [(b"", 0.4, "no RTDE answer|nothing"), (b"HTTP", 300.0, "48 54 54 50, which is not RTDE")],
)
def test_a_stranger_at_the_address_does_not_hang_the_program(answer: bytes, timeout_s: float, words: str) -> None:
    with socket.create_server((NOBODY, 30004)) as listener:
        listener.settimeout(300.0)
        import threading

        def talk() -> None:
            line, _ = listener.accept()
            with line:
                line.sendall(answer)
                time.sleep(0.6)

        thread = threading.Thread(target=talk)
        thread.start()
        with pytest.raises(DeviceError, match=words), arm(host=NOBODY, answer_timeout_s=timeout_s):
            pass
        thread.join()


def test_an_arm_that_is_not_open_and_hostile_parameters_are_refused() -> None:
    with pytest.raises(DeviceError, match="not open"):
        arm().joint_state()
    for name, value in (("speed_share", 0.0), ("grace_s", -1.0), ("frequency_hz", np.nan)):
        with pytest.raises(ConfigError, match=name):
            replace(PATIENT, **{name: value})
