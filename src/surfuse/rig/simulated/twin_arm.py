"""What the simulated devices that ride on an arm ask of it."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from surfuse.motion.moving_arm import MovingArm
from surfuse.records import FloatArray


@runtime_checkable
class TwinArm(MovingArm, Protocol):
    """An arm of the twin: it also says where its links truly are, for the simulated devices that ride on it."""

    @property
    def true_joints_rad(self) -> FloatArray: ...
    def true_tool_pose(self) -> FloatArray:
        """`world_from_tool` (4, 4) at the true joints."""

    def begin_stop(self) -> None:
        """Forget all history: what happens at a stop depends on its target and the one before alone."""
