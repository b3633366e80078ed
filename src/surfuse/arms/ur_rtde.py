"""Universal Robots arms: joint states over RTDE (package ur-rtde, extra `ur`), moves as URScript.

Ports and formats: Universal Robots, "Real-Time Data Exchange (RTDE) Guide" (30004) and "Remote Control via TCP/IP"
(secondary interface, 30002). The controller plans and supervises every move; remote control must be allowed on it.
"""

from __future__ import annotations

import socket
import struct
import time
from dataclasses import dataclass, field
from types import TracebackType
from typing import Protocol, Self

import numpy as np

from surfuse.errors import ConfigError, DeviceError, SafetyStopError
from surfuse.extras import needed_by
from surfuse.interfaces import GIVEN_BY_RIG, Kinematics, surrounded
from surfuse.motion.arm_surroundings import ArmSurroundings
from surfuse.motion.limits import JointLimits, check_position
from surfuse.motion.trapezoid import durations_s
from surfuse.records import FloatArray, JointState

SUMMARY = "an arm of Universal Robots, over its network interface (RTDE)"
NEEDS = ("rtde_receive",)
RTDE_PORT = 30004
SCRIPT_PORT = 30002
VARIABLES = ["timestamp", "actual_q", "actual_qd", "robot_mode", "safety_mode"]
ROBOT_RUNNING = 7
SAFETY_NORMAL = (1, 2)  # normal, reduced
SAFETY_NAMES = {
    3: "protective stop",
    4: "recovery",
    5: "safeguard stop",
    6: "system emergency stop",
    7: "emergency stop of the robot",
    8: "violation",
    9: "fault",
}
_REQUEST_VERSION_2 = struct.pack(">HBH", 5, ord("V"), 2)


class Receiver(Protocol):
    """What is used of `rtde_receive.RTDEReceiveInterface`."""

    def isConnected(self) -> bool: ...
    def disconnect(self) -> None: ...
    def getTimestamp(self) -> float: ...
    def getActualQ(self) -> list[float]: ...
    def getActualQd(self) -> list[float]: ...
    def getRobotMode(self) -> int: ...
    def getSafetyMode(self) -> int: ...


@dataclass(frozen=True)
class Parameters:
    """Where the arm is, and how it is moved and watched.

    `host`: network address of the controller.
    `speed_share`: share in (0, 1] of the joint speeds and accelerations. `settle_rad`, `still_rad_s`: when a joint has
    arrived and rests; `settle_s`: for how long. `grace_s`: how much longer than planned a move may take.
    `answer_timeout_s`: longest wait for the controller, and longest silence of its data. `frequency_hz`: of the data.
    """

    host: str
    speed_share: float = 0.5
    settle_rad: float = 5e-4
    still_rad_s: float = 2e-3
    settle_s: float = 0.1
    grace_s: float = 3.0
    answer_timeout_s: float = 2.0
    frequency_hz: float = 125.0
    surroundings: ArmSurroundings | None = field(default=None, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if not self.host:
            raise ConfigError("host = ''", cure="give the network address of the controller")
        if not 0.0 < self.speed_share <= 1.0:
            raise ConfigError(f"speed_share = {self.speed_share}", cure="give a share above 0, at most 1")
        for name in ("settle_rad", "still_rad_s", "settle_s", "grace_s", "answer_timeout_s", "frequency_hz"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ConfigError(f"{name} = {getattr(self, name)}", cure="give a positive value")


class UrArm:
    """The arm behind a controller; its kinematics come from the rig."""

    def __init__(self, parameters: Parameters, surroundings: ArmSurroundings) -> None:
        self._host = parameters.host
        self._kinematics = surroundings.kinematics
        self._limits = surroundings.limits
        self._clock = surroundings.clock
        self._parameters = parameters
        self._guard = surroundings.guard
        self._receiver: Receiver | None = None
        self._script: socket.socket | None = None
        self._last_stamp_s, self._heard_s = -1.0, 0.0

    def __enter__(self) -> Self:
        with needed_by("an arm of Universal Robots", self._host):
            from rtde_receive import (  # type: ignore[import-not-found,import-untyped,unused-ignore]
                RTDEReceiveInterface,
            )

        self._check_controller()

        try:
            self._script = socket.create_connection((self._host, SCRIPT_PORT), self._parameters.answer_timeout_s)
            self._receiver = RTDEReceiveInterface(self._host, self._parameters.frequency_hz, VARIABLES)
        except (OSError, RuntimeError) as error:
            self._close()
            raise DeviceError(
                f"the controller refuses: {error}", where=self._host, cure="allow RTDE and remote control on it"
            ) from error
        self._heard_s = time.monotonic()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None and self._script is not None:
            self.stop()
        self._close()

    @property
    def kinematics(self) -> Kinematics:
        """Kinematics with the grip as tool."""
        return self._kinematics

    def joint_state(self) -> JointState:
        """What the controller reports now.

        Raises
        ------
        DeviceError : its data have stopped.
        """
        return JointState(np.array(self._live().getActualQ()), self._clock.now_s())

    def move_to(self, joints_rad: FloatArray, speed_share: float | None = None) -> JointState:
        """Go there and settle; `speed_share` as in `Arm`.

        Raises
        ------
        SafetyStopError : the target is outside a limit or the guard refuses the way, and the arm has not moved; or the
            controller has stopped the arm.
        DeviceError : the controller is silent or not ready, or the arm did not arrive in time.
        """
        check_position(joints_rad, self._limits)
        self._check_ready()
        start = np.array(self._live().getActualQ())
        target = np.array(joints_rad, dtype=np.float64)
        if self._guard is not None:
            self._guard(start, target)
        share = self._parameters.speed_share if speed_share is None else min(speed_share, self._parameters.speed_share)
        angles = ", ".join(f"{angle:.9f}" for angle in target)
        speed = share * float(np.min(self._limits.velocity_rad_s))
        acceleration = share * float(np.min(self._limits.acceleration_rad_s2))
        self._send(f"def surfuse_move():\n  movej([{angles}], a={acceleration:.6f}, v={speed:.6f})\nend\n")
        change = float(np.max(np.abs(target - start)))
        slowest = JointLimits(np.array([-1e3]), np.array([1e3]), np.array([speed]), np.array([acceleration]))
        planned_s = float(durations_s(np.zeros(1), np.array([change]), slowest))
        self._wait_for(target, planned_s + self._parameters.grace_s)
        return self.joint_state()

    def stop(self) -> None:
        """Ask for a controlled stop of all joints."""
        self._send(f"def surfuse_stop():\n  stopj({float(np.min(self._limits.acceleration_rad_s2)):.6f})\nend\n")

    def _wait_for(self, target: FloatArray, limit_s: float) -> None:
        began, arrived_s = time.monotonic(), float("nan")
        while True:
            self._check_ready()
            off = np.abs(np.array(self._live().getActualQ()) - target)
            still = np.max(np.abs(self._live().getActualQd())) <= self._parameters.still_rad_s
            now = time.monotonic()
            if np.max(off) > self._parameters.settle_rad or not still:
                arrived_s = float("nan")
            elif not np.isfinite(arrived_s):
                arrived_s = now
            elif now - arrived_s >= self._parameters.settle_s:
                return
            if now - began > limit_s:
                self.stop()
                j = int(np.argmax(off))
                raise DeviceError(
                    f"joint {j + 1} is still {np.degrees(off[j]):.2f} deg from its target after {limit_s:.1f} s",
                    where=self._host,
                    cure="check that the controller is in remote control and its speed slider is not low",
                )
            time.sleep(0.5 / self._parameters.frequency_hz)

    def _live(self) -> Receiver:
        """The receiver, if its data still flow."""
        if self._receiver is None:
            raise DeviceError("the arm is not open", where=self._host, cure="use it in a with block")
        stamp, now = self._receiver.getTimestamp(), time.monotonic()
        if stamp != self._last_stamp_s:
            self._last_stamp_s, self._heard_s = stamp, now
        silent = now - self._heard_s
        if silent > self._parameters.answer_timeout_s or not self._receiver.isConnected():
            raise DeviceError(
                f"no data from the controller for {silent:.1f} s, at most {self._parameters.answer_timeout_s:g} s",
                where=self._host,
                cure="check the network, then open the arm again",
            )
        return self._receiver

    def _check_ready(self) -> None:
        receiver = self._live()
        safety = int(receiver.getSafetyMode())
        if safety not in SAFETY_NORMAL:
            name = SAFETY_NAMES.get(safety, "unknown")
            raise SafetyStopError(
                f"the controller has stopped the arm: safety mode {safety} ({name})",
                where=self._host,
                cure="clear the cause at the robot, unlock it there, then resume",
            )
        mode = int(receiver.getRobotMode())
        if mode != ROBOT_RUNNING:
            raise DeviceError(
                f"robot mode {mode}, wanted {ROBOT_RUNNING} (running)",
                where=self._host,
                cure="switch the arm on and release its brakes",
            )

    def _send(self, script: str) -> None:
        if self._script is None:
            raise DeviceError("the arm is not open", where=self._host, cure="use it in a with block")
        try:
            self._script.sendall(script.encode("ascii"))
        except OSError as error:
            raise DeviceError(f"the controller takes no script: {error}", where=self._host) from error

    def _check_controller(self) -> None:
        """Ask for protocol version 2 first: the library would wait for a silent peer for ever, with all threads."""
        timeout = self._parameters.answer_timeout_s
        try:
            with socket.create_connection((self._host, RTDE_PORT), timeout) as line:
                line.settimeout(timeout)
                line.sendall(_REQUEST_VERSION_2)
                answer = line.recv(4)
        except OSError as error:
            raise DeviceError(
                f"no RTDE answer on port {RTDE_PORT}: {error}", where=self._host, cure="check address and network"
            ) from error
        if answer != struct.pack(">HBB", 4, ord("V"), 1):
            raise DeviceError(
                f"port {RTDE_PORT} answers {answer.hex(' ') or 'nothing'}, which is not RTDE version 2",
                where=self._host,
                cure="check that this is a robot with software 3.4 or later",
            )

    def _close(self) -> None:
        if self._receiver is not None:
            self._receiver.disconnect()
            self._receiver = None
        if self._script is not None:
            self._script.close()
            self._script = None


def create(parameters: Parameters) -> UrArm:
    """A Universal Robots arm at a network address."""
    return UrArm(parameters, surrounded(parameters.surroundings, "ur_rtde"))
