"""An arm that replays recorded joint states, one a move, with their own times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surfuse.errors import DataError, DeviceError
from surfuse.interfaces import AlwaysOpen, Kinematics
from surfuse.records import FloatArray, JointState


class RecordedArm(AlwaysOpen):
    """See `create`."""

    def __init__(self, kinematics: Kinematics, states: Sequence[JointState], tolerance_rad: float) -> None:
        if len(states) == 0:
            raise DataError("a recorded arm without joint states", cure="give a log that has some")
        joints = len(kinematics.lower_rad)
        for i, state in enumerate(states):
            if len(state.position_rad) != joints:
                raise DataError(f"recorded state {i} has {len(state.position_rad)} joints, the arm has {joints}")
        self._kinematics = kinematics
        self._states = tuple(states)
        self._tolerance_rad = tolerance_rad
        self._at = 0

    @property
    def kinematics(self) -> Kinematics:
        """Kinematics with the grip as tool."""
        return self._kinematics

    def joint_state(self) -> JointState:
        """The state of the recording at which the replay stands."""
        return self._states[self._at]

    def move_to(self, joints_rad: FloatArray) -> JointState:
        """Step on to the next recorded state, which must be where the target is.

        Raises
        ------
        DeviceError : the recording is over, or its next state is elsewhere; the replay has not moved.
        """
        if self._at + 1 >= len(self._states):
            raise DeviceError(
                f"the recording ends after {len(self._states)} joint states", cure="ask for no more moves than it has"
            )
        recorded = self._states[self._at + 1]
        off = np.abs(recorded.position_rad - np.asarray(joints_rad, dtype=np.float64))
        # Written so that nan counts as elsewhere.
        if not np.all(off <= self._tolerance_rad):
            j = int(np.argmax(np.where(np.isnan(off), np.inf, off)))
            raise DeviceError(
                f"recorded state {self._at + 1} has joint {j + 1} at {np.degrees(recorded.position_rad[j]):.2f} deg, "
                f"the target is {np.degrees(joints_rad[j]):.2f} deg",
                cure="replay with the plan of the recorded scan",
            )
        self._at += 1
        return recorded


def create(kinematics: Kinematics, states: Sequence[JointState], tolerance_rad: float = 0.02) -> RecordedArm:
    """An arm that stands at the first of the recorded states and goes to the next with every move.

    `tolerance_rad` is how far a recorded state may be from the target of its move (inf: anywhere).
    """
    return RecordedArm(kinematics, states, tolerance_rad)
