"""Where a moving grip was at any moment between the states that the arm told, and how well that is known."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surfuse.geometry.pose_between import poses_between
from surfuse.records import FloatArray, ToolState

KEPT_S = 25.0  # a sensor's stamp may be 10 s late, and a sweep may take 10 s

HIDDEN_M_S2 = 0.1
"""Acceleration that a moving arm may have had between two states without their showing it: it turns round at 0.1 m/s
within two seconds. One that stands has none."""

_STANDS_M = 1e-4


@dataclass(frozen=True)
class TrackedPlaces:
    """Poses (N, 4, 4) and joints (N, J) at N moments; `off_m` (N,): how far what the sensor looks at may be off."""

    world_from_grip: FloatArray
    joints_rad: FloatArray
    off_m: FloatArray


class ToolTrack:
    """States in the order of time, as long as they may still be asked for.

    Between two states the place is on a straight line, the turn on the shortest arc, both at constant speed. What a
    point ahead of the grip then is off by, because the speed was not constant, is at most `a dt^2 / 8` in the middle of
    `dt` with the acceleration `a`: the change of the point's mean speed from the interval before, or `HIDDEN_M_S2`.
    """

    def __init__(self, kept_s: float = KEPT_S) -> None:
        self._kept_s = kept_s
        self._states: list[ToolState] = []
        self._times_s: list[float] = []

    def add(self, state: ToolState) -> None:
        """Take in a state; one that is not later than the last is the same state told again."""
        if self._states and state.t_s <= self._states[-1].t_s:
            return
        self._states.append(state)
        self._times_s.append(state.t_s)
        old = bisect.bisect_left(self._times_s, state.t_s - self._kept_s) - 2
        if old > 0:
            del self._states[:old], self._times_s[:old]

    @property
    def until_s(self) -> float:
        """Time of the last state; `-inf` without one."""
        return self._states[-1].t_s if self._states else -np.inf

    @property
    def since_s(self) -> float:
        """Time from which places are known: the second state, so that each interval has one before it."""
        return self._states[1].t_s if len(self._states) > 1 else np.inf

    def at(self, t_s: Sequence[float], ahead_m: Sequence[float]) -> TrackedPlaces:
        """The grip at moments within `since_s` and `until_s`; `ahead_m` is how far in front of it the sensor looks."""
        found = [self._one(t, ahead) for t, ahead in zip(t_s, ahead_m, strict=True)]
        return TrackedPlaces(
            np.array([place for place, _, _ in found]),
            np.array([joints for _, joints, _ in found]),
            np.array([off for _, _, off in found]),
        )

    def _one(self, t_s: float, ahead_m: float) -> tuple[FloatArray, FloatArray, float]:
        after = min(max(bisect.bisect_left(self._times_s, t_s), 2), len(self._states) - 1)
        earlier, before, later = self._states[max(after - 2, 0)], self._states[after - 1], self._states[after]
        share = (t_s - before.t_s) / (later.t_s - before.t_s)
        joints = before.joints_rad
        if len(joints) == len(later.joints_rad):
            joints = (1.0 - share) * joints + share * later.joints_rad
        place = poses_between(before.world_from_tool, later.world_from_tool, np.array([share]))[0]
        return place, joints, 4.0 * share * (1.0 - share) * _most_off_m(earlier, before, later, ahead_m)


def _most_off_m(earlier: ToolState, before: ToolState, later: ToolState, ahead_m: float) -> float:
    """`a dt^2 / 8` of a point `ahead_m` in front of the grip between `before` and `later`."""
    poses = np.array([state.world_from_tool for state in (earlier, before, later)])
    ways = np.diff(poses[:, :3, 3] + ahead_m * poses[:, :3, 2], axis=0)
    if np.all(np.linalg.norm(ways, axis=1) < _STANDS_M):
        return 0.0
    first_s, then_s = before.t_s - earlier.t_s, later.t_s - before.t_s
    change = float(np.linalg.norm(ways[1] / then_s - ways[0] / first_s)) / (0.5 * (first_s + then_s))
    return max(change, HIDDEN_M_S2) * then_s**2 / 8.0
