"""An arm that replays recorded joint states with their own times: one a move, or those that are where it is sent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from surfuse.errors import ConfigError, DataError, DeviceError
from surfuse.interfaces import GIVEN_BY_RIG, AlwaysOpen, Kinematics, surrounded
from surfuse.motion.arm_surroundings import ArmSurroundings
from surfuse.motion.limits import check_position
from surfuse.records import FloatArray, JointState

SUMMARY = "plays back the joint states of a recorded scan"


@dataclass(frozen=True, kw_only=True)
class Surroundings(ArmSurroundings):
    """The arm that was recorded, and its joint states in their order."""

    states: Sequence[JointState]


@dataclass(frozen=True)
class Parameters:
    """How moves find their recorded states.

    tolerance_rad : how far a recorded state may be from the target of its move (inf: anywhere).
    in_order : every move is the next recorded one; else it goes to the recorded state that is nearest to its target.
    """

    tolerance_rad: float = 0.02
    in_order: bool = True
    surroundings: Surroundings | None = field(default=None, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if not self.tolerance_rad >= 0.0:
            raise ConfigError(f"tolerance_rad = {self.tolerance_rad}", cure="give an angle of 0 rad or more")


class RecordedArm(AlwaysOpen):
    """Stands at the first of the recorded states; every move goes to the next, or to the nearest one."""

    def __init__(self, parameters: Parameters, surroundings: Surroundings) -> None:
        if len(surroundings.states) == 0:
            raise DataError("a recorded arm without joint states", cure="give a log that has some")
        self._kinematics, self._limits = surroundings.kinematics, surroundings.limits
        joints = len(self._kinematics.lower_rad)
        for i, state in enumerate(surroundings.states):
            if len(state.position_rad) != joints:
                raise DataError(f"recorded state {i} has {len(state.position_rad)} joints, the arm has {joints}")
        self._states, self._guard = tuple(surroundings.states), surroundings.guard
        self._tolerance_rad, self._in_order = parameters.tolerance_rad, parameters.in_order
        self._at = 0

    @property
    def kinematics(self) -> Kinematics:
        """Kinematics with the grip as tool."""
        return self._kinematics

    def joint_state(self) -> JointState:
        """The state of the recording at which the replay stands."""
        return self._states[self._at]

    def move_to(self, joints_rad: FloatArray, speed_share: float | None = None) -> JointState:
        """Step on to the next recorded state (or the nearest), which must be where the target is; no speed matters.

        Raises
        ------
        SafetyStopError : the target is outside a limit, or the guard refuses the way; the replay has not moved.
        DeviceError : the recording is over, or its next state is elsewhere; the replay has not moved.
        """
        check_position(joints_rad, self._limits)
        if self._guard is not None:
            self._guard(self._states[self._at].position_rad, np.array(joints_rad, dtype=np.float64))
        to = self._next() if self._in_order else self._nearest(joints_rad)
        recorded = self._states[to]
        off = np.abs(recorded.position_rad - np.asarray(joints_rad, dtype=np.float64))
        if not np.all(off <= self._tolerance_rad):
            j = int(np.argmax(off))
            raise DeviceError(
                f"recorded state {to} has joint {j + 1} at {np.degrees(recorded.position_rad[j]):.2f} deg, "
                f"the target is {np.degrees(joints_rad[j]):.2f} deg",
                cure="replay with the plan of the recorded scan",
            )
        self._at = to
        return recorded

    def _next(self) -> int:
        if self._at + 1 >= len(self._states):
            raise DeviceError(
                f"the recording ends after {len(self._states)} joint states", cure="ask for no more moves than it has"
            )
        return self._at + 1

    def _nearest(self, joints_rad: FloatArray) -> int:
        off = [float(np.max(np.abs(state.position_rad - joints_rad))) for state in self._states]
        return int(np.argmin(off))


def create(parameters: Parameters) -> RecordedArm:
    """A recorded arm, played back from its first state."""
    return RecordedArm(parameters, surrounded(parameters.surroundings, "recorded"))
