"""An arm that is said to stand, to the last bit, while its sensors see motion: its pose is no longer that of now."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from surfuse.errors import SafetyStopError
from surfuse.records import Echo, SensorSpec, Status

SEEN_LIMIT_M, SEEN_SIGMAS = 0.01, 5.0
"""Ranges of a standing arm whose standard deviation is above both have changed."""

UNCHANGED_LIMIT_S = 2.0
"""So long an arm may tell one pose while its sensors see motion: somebody may reach through a beam."""

FROZEN_STATES = 100
"""So many states in a row may have one time stamp."""

_WINDOW, _FEWEST = 64, 12
_SMOOTH = 0.5


class StuckPose:
    """Compares what an arm says of itself with what its sensors see.

    Motion is told from scatter by von Neumann's ratio, the mean square of successive differences over the variance: it
    is 2 for readings that have nothing to do with each other and near 0 for those of a steady motion.

    J. von Neumann, "Distribution of the ratio of the mean square successive difference to the variance", Ann. Math.
    Statist. 12 (1941).
    """

    def __init__(self, specs: Sequence[SensorSpec]) -> None:
        self._specs = tuple(specs)
        self._ranges: list[deque[float]] = [deque(maxlen=_WINDOW) for _ in specs]
        self._told_s, self._times = -math.inf, 0

    def check(self, echoes: Sequence[Echo], told_s: float, unchanged_s: float) -> None:
        """A sweep, the time of the arm's last state, and how long its pose is the same.

        Raises
        ------
        SafetyStopError : the arm's time stands still, or its pose does and the sensors see motion.
        """
        self._check_time(told_s)
        if unchanged_s <= 0.0:
            for seen in self._ranges:
                seen.clear()
            return
        for echo, seen in zip(echoes, self._ranges, strict=True):
            if echo.status is Status.OK:
                seen.append(echo.range_m)
        if unchanged_s >= UNCHANGED_LIMIT_S:
            self._check_motion(unchanged_s)

    def _check_time(self, told_s: float) -> None:
        self._times = self._times + 1 if told_s == self._told_s else 0
        self._told_s = told_s
        if self._times > FROZEN_STATES:
            raise SafetyStopError(
                f"the clock of the arm stands still: t_s = {told_s:.6f} in {self._times} states one after the other, "
                f"at most {FROZEN_STATES}",
                cure="stamp each state with the time at which the arm was there",
            )

    def _check_motion(self, unchanged_s: float) -> None:
        """At least half of the sensors that hear something must agree: one alone may hear now this, now that."""
        hearing = [k for k, seen in enumerate(self._ranges) if len(seen) >= _FEWEST]
        moving = {k: spread for k in hearing if (spread := self._motion_m(k)) > 0.0}
        if not moving or 2 * len(moving) < len(hearing):
            return
        sensor = max(moving, key=lambda k: moving[k])
        raise SafetyStopError(
            f"the arm tells one pose for {unchanged_s:.1f} s while the range of '{self._specs[sensor].name}' changes "
            f"by {1e3 * moving[sensor]:.0f} mm (standard deviation), at most {1e3 * self._limit_m(sensor):.0f} mm for "
            f"{UNCHANGED_LIMIT_S:g} s",
            cure="let it tell where the arm is now, or take what moves out of the beams; readings since the pose "
            "changed last are in a wrong place",
        )

    def _limit_m(self, sensor: int) -> float:
        return max(SEEN_LIMIT_M, SEEN_SIGMAS * self._specs[sensor].sigma_m)

    def _motion_m(self, sensor: int) -> float:
        """Standard deviation of the ranges if they show a motion, else 0."""
        ranges = np.array(self._ranges[sensor])
        variance = float(np.var(ranges))
        if math.sqrt(variance) <= self._limit_m(sensor):
            return 0.0
        ratio = float(np.mean(np.diff(ranges) ** 2)) / variance
        return math.sqrt(variance) if ratio < _SMOOTH else 0.0
