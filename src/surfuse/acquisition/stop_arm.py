"""An arm as the walk through a plan uses it: it goes to the stops, one after the other, and says where its grip is.

An arm that takes joints goes to the joints of the plan; one that takes poses goes to the poses of the plan.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from surfuse.geometry.poses import inverse
from surfuse.interfaces import Arm, PoseArm
from surfuse.records import FloatArray, JointState, ScanPlan, ToolState


class StopArm(Protocol):
    """What the walk needs of an arm."""

    def now_s(self) -> float:
        """The arm's own time."""

    def standing(self) -> ToolState:
        """Where the grip is now (`world_from_tool` is that of the grip)."""

    def go_to(self, plan: ScanPlan, stop: int) -> ToolState:
        """Go to a stop of the plan, settle, and say where the grip is (`world_from_tool` is that of the grip).

        Raises
        ------
        UnreachableError : the arm cannot go there, and has not moved.
        SafetyStopError, DeviceError : it was stopped, or did not get there.
        """

    def check_still(self, standing: ToolState) -> None:
        """Look again after a sweep.

        Raises
        ------
        SafetyStopError : the grip is no longer where it stood.
        """


def _supervised() -> None:
    """The driver of the arm notices by itself when it moves."""


@dataclass(frozen=True)
class JointStopArm:
    """An arm that takes joints; the tool of its kinematics is the grip.

    `look_again` asks an arm that does not supervise itself for its joints after a sweep, which its driver compares.
    """

    arm: Arm
    look_again: Callable[[], object] = _supervised

    def now_s(self) -> float:
        """The arm's own time."""
        return self.arm.joint_state().t_s

    def standing(self) -> ToolState:
        """See `StopArm.standing`."""
        return self._grip(self.arm.joint_state())

    def go_to(self, plan: ScanPlan, stop: int) -> ToolState:
        """See `StopArm.go_to`."""
        return self._grip(self.arm.move_to(plan.joints_rad[stop]))

    def check_still(self, standing: ToolState) -> None:
        """See `StopArm.check_still`."""
        self.look_again()

    def _grip(self, state: JointState) -> ToolState:
        return ToolState(state.t_s, self.arm.kinematics.forward(state.position_rad), state.position_rad)


@dataclass(frozen=True)
class PoseStopArm:
    """An arm that takes poses; `tool_from_grip` (4, 4) is where the grip is on its tool.

    Its driver compares what it answers with where it was sent.
    """

    arm: PoseArm
    tool_from_grip: FloatArray

    def now_s(self) -> float:
        """The arm's own time."""
        return self.arm.tool_state().t_s

    def standing(self) -> ToolState:
        """See `StopArm.standing`."""
        return self._grip(self.arm.tool_state())

    def go_to(self, plan: ScanPlan, stop: int) -> ToolState:
        """See `StopArm.go_to`."""
        return self._grip(self.arm.move_to_pose(plan.world_from_grip[stop] @ inverse(self.tool_from_grip)))

    def check_still(self, standing: ToolState) -> None:
        """See `StopArm.check_still`; asking for the state is enough, the driver knows where the arm must be."""
        self.arm.tool_state()

    def _grip(self, state: ToolState) -> ToolState:
        grip = np.asarray(state.world_from_tool @ self.tool_from_grip, dtype=np.float64)
        return ToolState(state.t_s, grip, state.joints_rad)
