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

STANDS_S = 0.5
"""An arm that tells one pose for so long, to the last bit, stands. In less time it may have told an old pose again."""


@dataclass(frozen=True)
class TrackedPlaces:
    """Poses (N, 4, 4) and joints (N, J) at N moments, and what is ahead of the grip there.

    `off_m` (N,): how far what the sensor looks at may be off; `velocity_m_s` (N, 3): how it moves, in the world.
    """

    world_from_grip: FloatArray
    joints_rad: FloatArray
    off_m: FloatArray
    velocity_m_s: FloatArray


class ToolTrack:
    """States in the order of time, as long as they may still be asked for.

    Between two states the place is on a straight line, the turn on the shortest arc, both at constant speed. What a
    point ahead of the grip then is off by, because the speed was not constant, is at most `a dt^2 / 8` in the middle of
    `dt` with the acceleration `a`: the change of the point's mean speed from the interval before, or `HIDDEN_M_S2`.

    An arm may tell an old pose again under a new stamp, when it is asked more often than it looks. A pose that is
    repeated to the last bit for less than `STANDS_S` therefore says nothing: the arm was on its way to the next one.
    When that one was reached is known to the time since the last repetition, which the speed turns into metres.
    """

    def __init__(self, kept_s: float = KEPT_S) -> None:
        self._kept_s = kept_s
        self._states: list[ToolState] = []
        self._times_s: list[float] = []
        self._late_s: list[float] = []
        self._told_s = -np.inf
        self._changed_s = -np.inf

    def add(self, state: ToolState) -> None:
        """Take in a state; one that is not later than the last is the same state told again."""
        if state.t_s <= self._told_s:
            return
        last_told_s, self._told_s = self._told_s, state.t_s
        if self._states and same_place(self._states[-1], state):
            if state.t_s - self._changed_s >= STANDS_S:
                self._append(state, 0.0)
            return
        self._changed_s = state.t_s
        repeated = bool(self._states) and last_told_s > self._states[-1].t_s
        self._append(state, state.t_s - last_told_s if repeated else 0.0)

    def _append(self, state: ToolState, late_s: float) -> None:
        self._states.append(state)
        self._times_s.append(state.t_s)
        self._late_s.append(late_s)
        old = bisect.bisect_left(self._times_s, state.t_s - self._kept_s) - 2
        if old > 0:
            del self._states[:old], self._times_s[:old], self._late_s[:old]

    @property
    def told_s(self) -> float:
        """Time of the last state that was told, also one that says nothing; `-inf` without one."""
        return self._told_s

    @property
    def unchanged_s(self) -> float:
        """How long the arm has told one pose, to the last bit."""
        return self._told_s - self._changed_s

    @property
    def until_s(self) -> float:
        """Time until which places are known: the last state that says something; `-inf` without one."""
        return self._states[-1].t_s if self._states else -np.inf

    @property
    def since_s(self) -> float:
        """Time from which places are known: each interval has one before it, or the arm stood in it."""
        if len(self._states) < 2:
            return np.inf
        return self._times_s[0] if self._stood_first() else self._times_s[1]

    def _stood_first(self) -> bool:
        return same_place(self._states[0], self._states[1])

    def at(self, t_s: Sequence[float], ahead_m: Sequence[float]) -> TrackedPlaces:
        """The grip at moments within `since_s` and `until_s`; `ahead_m` is how far in front of it the sensor looks."""
        found = [self._one(t, ahead) for t, ahead in zip(t_s, ahead_m, strict=True)]
        return TrackedPlaces(
            np.array([place for place, _, _, _ in found]),
            np.array([joints for _, joints, _, _ in found]),
            np.array([off for _, _, off, _ in found]),
            np.array([velocity for _, _, _, velocity in found]),
        )

    def _one(self, t_s: float, ahead_m: float) -> tuple[FloatArray, FloatArray, float, FloatArray]:
        first = 1 if self._stood_first() else 2
        after = min(max(bisect.bisect_left(self._times_s, t_s), first), len(self._states) - 1)
        earlier, before, later = self._states[max(after - 2, 0)], self._states[after - 1], self._states[after]
        share = (t_s - before.t_s) / (later.t_s - before.t_s)
        joints = before.joints_rad
        if len(joints) == len(later.joints_rad):
            joints = (1.0 - share) * joints + share * later.joints_rad
        place = poses_between(before.world_from_tool, later.world_from_tool, np.array([share]))[0]
        late_s = (1.0 - share) * self._late_s[after - 1] + share * self._late_s[after]
        velocity = _way(before, later, ahead_m) / (later.t_s - before.t_s)
        bent_m = 4.0 * share * (1.0 - share) * _most_off_m(earlier, before, later, ahead_m)
        return place, joints, bent_m + late_s * float(np.linalg.norm(velocity)), velocity


def same_place(one: ToolState, other: ToolState) -> bool:
    """Whether two states tell the same pose and joints to the last bit."""
    same = np.array_equal(one.world_from_tool, other.world_from_tool)
    return same and np.array_equal(one.joints_rad, other.joints_rad)


def _way(before: ToolState, later: ToolState, ahead_m: float) -> FloatArray:
    """How a point ahead of the grip has moved (3,)."""
    poses = [state.world_from_tool for state in (before, later)]
    start, end = (pose[:3, 3] + ahead_m * pose[:3, 2] for pose in poses)
    return np.asarray(end - start, dtype=np.float64)


def _most_off_m(earlier: ToolState, before: ToolState, later: ToolState, ahead_m: float) -> float:
    """`a dt^2 / 8` of a point `ahead_m` in front of the grip between `before` and `later`."""
    ways = np.array([_way(earlier, before, ahead_m), _way(before, later, ahead_m)])
    if np.all(np.linalg.norm(ways, axis=1) < _STANDS_M):
        return 0.0
    first_s, then_s = before.t_s - earlier.t_s, later.t_s - before.t_s
    change = float(np.linalg.norm(ways[1] / then_s - ways[0] / first_s)) / (0.5 * (first_s + then_s))
    return max(change, HIDDEN_M_S2) * then_s**2 / 8.0
