"""Synchronised joint moves with a trapezoidal speed profile: all joints start, cruise and stop together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from surfuse.errors import DataError
from surfuse.motion.limits import JointLimits
from surfuse.records import FloatArray

_STILL_RAD = 1e-12  # changes below this are rounding, not motion


def durations_s(start_rad: FloatArray, end_rad: FloatArray, limits: JointLimits) -> FloatArray:
    """Shortest times (...) of moves from start (..., J) to end (..., J), at rest at both ends.

    In s. The limits of position do not matter; a move of no length takes no time.
    """
    cruising, rise = _path_times(np.subtract(end_rad, start_rad), limits)
    return cruising + rise


def _path_times(change_rad: FloatArray, limits: JointLimits) -> tuple[FloatArray, FloatArray]:
    """Time (s) that the path parameter takes from 0 to 1 at its cruise rate, and the time until it has that rate.

    Joint j has the speed rate x change_j, so each joint bounds the rate by v_j / |change_j| and its slope by
    a_j / |change_j|. A short path never reaches that rate: its profile is a triangle.
    """
    size = np.where(np.abs(change_rad) < _STILL_RAD, 0.0, np.abs(change_rad))
    by_speed = np.max(size / limits.velocity_rad_s, axis=-1)
    triangle = np.sqrt(np.max(size / limits.acceleration_rad_s2, axis=-1))
    cruising = np.maximum(by_speed, triangle)
    rise = np.divide(triangle**2, cruising, out=np.zeros_like(cruising), where=cruising > 0.0)
    return cruising, rise


@dataclass(frozen=True)
class TrapezoidalMove:
    """One move between two joint positions (J,): straight in joint space, within speed and acceleration limits.

    `start_rad` and `end_rad` in rad, at rest at both. The joints start and stop together: the slowest one sets the
    time.
    """

    start_rad: FloatArray
    end_rad: FloatArray
    limits: JointLimits

    def __post_init__(self) -> None:
        for name in ("start_rad", "end_rad"):
            value = np.asarray(getattr(self, name))
            if value.shape != (len(self.limits),) or not np.all(np.isfinite(value)):
                raise DataError(f"{name} = {value.tolist()}, wanted {len(self.limits)} finite angles")

    @property
    def duration_s(self) -> float:
        """Time from rest to rest."""
        return float(durations_s(self.start_rad, self.end_rad, self.limits))

    def sample(self, t_s: npt.ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, speed and acceleration (T, J) at times (T,) from the start; at rest before and after."""
        change = np.subtract(self.end_rad, self.start_rad)
        asked = np.ravel(np.asarray(t_s, dtype=np.float64))
        cruising, rise = (float(time) for time in _path_times(change, self.limits))
        total = cruising + rise
        if total == 0.0:
            still = np.zeros((len(asked), len(change)))
            return still + self.start_rad, still, still.copy()
        t = np.clip(asked, 0.0, total)
        cruise = 1.0 / cruising
        slope = cruise / rise
        up, down = np.minimum(t, rise), np.minimum(total - t, rise)
        # Distance is symmetric: what is covered from the start, or what is left to the end.
        early = 0.5 * slope * up**2 + cruise * np.maximum(t - rise, 0.0)
        late = 1.0 - 0.5 * slope * down**2
        path = np.where(t <= total - rise, early, late)
        rate = slope * np.minimum(up, down)
        moving = (asked >= 0.0) & (asked <= total)
        push = slope * ((moving & (t < rise)).astype(np.float64) - (moving & (t > total - rise)))
        return self.start_rad + path[:, None] * change, rate[:, None] * change, push[:, None] * change
