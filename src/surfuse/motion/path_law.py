"""How a path parameter runs over time: from speeds at grid points, with constant or slowly built-up acceleration."""

from __future__ import annotations

import numpy as np

from surfuse.records import FloatArray

_HALVINGS = 60


class PathLaw:
    """The parameter (from grid[0] = 0 to grid[-1]) over time, with path speeds `speed` (G,) at grid points (G,).

    Between grid points the acceleration is constant. With a `ramp_s` the law is the mean of that one over the last
    `ramp_s` seconds: it takes so much longer, ends at the same place, is nowhere faster than the fastest of what it
    averages, and its acceleration builds up over the ramp instead of jumping.
    """

    def __init__(self, grid: FloatArray, speed: FloatArray, ramp_s: float = 0.0) -> None:
        span = 2.0 * np.diff(grid) / np.maximum(speed[:-1] + speed[1:], 1e-12)
        self._clock = np.concatenate([[0.0], np.cumsum(span)])
        self._grid = grid
        self._speed = speed
        self._push = np.diff(speed) / span
        # Area under the parameter up to each grid point: its mean over a window is a difference of two areas.
        area = grid[:-1] * span + speed[:-1] * span**2 / 2.0 + self._push * span**3 / 6.0
        self._area = np.concatenate([[0.0], np.cumsum(area)])
        self._ramp_s = ramp_s

    @property
    def duration_s(self) -> float:
        """Time from rest to rest."""
        return float(self._clock[-1]) + self._ramp_s

    def sample(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Parameter, its rate and its acceleration (T,) at times (T,) from the start; at rest before and after."""
        if self._ramp_s == 0.0:
            return self._plain(t_s)[:3]
        at, rate, _, area = self._plain(t_s)
        at_before, rate_before, _, area_before = self._plain(t_s - self._ramp_s)
        mean = np.clip((area - area_before) / self._ramp_s, 0.0, self._grid[-1])
        return mean, (at - at_before) / self._ramp_s, (rate - rate_before) / self._ramp_s

    def times_s(self, parameter: FloatArray) -> FloatArray:
        """When the parameter has each value (N,), by halving: the law never runs backwards."""
        low, high = np.zeros(len(parameter)), np.full(len(parameter), self.duration_s)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            late = self.sample(middle)[0] >= parameter
            low, high = np.where(late, low, middle), np.where(late, middle, high)
        return np.where(parameter <= 0.0, 0.0, high)

    def _plain(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Parameter, rate, acceleration, and area under the parameter since the start, without the ramp."""
        end = self._clock[-1]
        t = np.clip(t_s, 0.0, end)
        k = np.clip(np.searchsorted(self._clock, t, side="right") - 1, 0, len(self._clock) - 2)
        h = t - self._clock[k]
        start, speed, push = self._grid[k], self._speed[k], self._push[k]
        at = np.clip(start + h * (speed + 0.5 * push * h), 0.0, self._grid[-1])
        area = self._area[k] + h * (start + h * (speed / 2.0 + push * h / 6.0))
        area = area + self._grid[-1] * np.maximum(t_s - end, 0.0)
        outside = (t_s < 0.0) | (t_s >= end)
        return at, np.where(outside, 0.0, speed + push * h), np.where(outside, 0.0, push), area
