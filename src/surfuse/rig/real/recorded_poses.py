"""An arm of which only the poses of its grip were recorded, for a scan that is played back."""

from __future__ import annotations

import numpy as np

from surfuse.errors import DeviceError
from surfuse.geometry.poses import inverse
from surfuse.interfaces import AlwaysOpen
from surfuse.records import BoolArray, FloatArray, ToolState

_AWAY_M, _AWAY = 0.005, 0.03


class RecordedPoseArm(AlwaysOpen):
    """A `PoseArm` that stands at one of the recorded poses (M, 4, 4) of the grip, told with their times (M,) in s.

    It goes to the recorded pose that is nearest to the target, which must be that pose within 5 mm and 0.03 rad.
    """

    def __init__(self, world_from_grip: FloatArray, times_s: FloatArray, tool_from_grip: FloatArray) -> None:
        self._world_from_tool = np.asarray(world_from_grip @ inverse(tool_from_grip), dtype=np.float64)
        self._times_s, self._at = times_s, 0

    def tool_state(self) -> ToolState:
        """The pose at which the replay stands."""
        return ToolState(float(self._times_s[self._at]), self._world_from_tool[self._at])

    def reachable(self, world_from_tool: FloatArray) -> BoolArray:
        """Which of the poses (N, 4, 4) were recorded: (N,)."""
        return np.array([self._away(pose)[1] <= 1.0 for pose in world_from_tool], dtype=np.bool_)

    def move_to_pose(self, world_from_tool: FloatArray, speed_share: float | None = None) -> ToolState:
        """Go to the recorded pose that is there.

        Raises
        ------
        DeviceError : none is; the replay has not moved.
        """
        nearest, away = self._away(world_from_tool)
        if away > 1.0:
            place = ", ".join(f"{x:.3f}" for x in world_from_tool[:3, 3])
            raise DeviceError(
                f"nothing was recorded at ({place}) m, to 5 mm and 0.03 rad",
                cure="play back with the area and the scan settings of the recorded scan",
            )
        self._at = nearest
        return self.tool_state()

    def _away(self, target: FloatArray) -> tuple[int, float]:
        """The nearest recorded pose, and how far it is in units of what is allowed."""
        off_m = np.linalg.norm(self._world_from_tool[:, :3, 3] - target[:3, 3], axis=1)
        turned = np.linalg.norm(self._world_from_tool[:, :3, :3] - target[:3, :3], axis=(1, 2)) / np.sqrt(2.0)
        away = np.maximum(off_m / _AWAY_M, turned / _AWAY)
        nearest = int(np.argmin(away))
        return nearest, float(away[nearest])
