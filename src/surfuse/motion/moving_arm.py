"""What an arm must do so that devices can be used while it moves."""

from __future__ import annotations

from typing import Protocol

from surfuse.interfaces import Arm
from surfuse.motion.trajectory import Trajectory
from surfuse.records import JointSamples, JointState


class MovingArm(Arm, Protocol):
    """An arm whose motion goes on with the clock while other devices are used; its encoders are sampled all the way."""

    def start(self, trajectory: Trajectory) -> float:
        """Begin a motion from rest where the arm is, and return at once; the answer is the time at which it began.

        Raises
        ------
        SafetyStopError : the motion does not begin where the arm is or breaks a limit, and the arm has not moved.
        """

    def wait_until(self, t_s: float) -> None:
        """Return at this time of the clock, or at once if it has passed.

        Raises
        ------
        SafetyStopError, DeviceError : the arm was stopped on the way; it is at rest.
        """

    def samples_since(self, t_s: float) -> JointSamples:
        """Encoder samples of this motion from the last one at or before a time until now, now included."""

    def finish(self) -> JointState:
        """Wait for the end of the motion, settle, and return the state as reached.

        Raises
        ------
        SafetyStopError, DeviceError : the arm was stopped on the way, or did not settle.
        """
