"""Joint moves with limited jerk, all joints in step."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from surfuse.errors import ConfigError, DataError
from surfuse.motion.limits import JointLimits
from surfuse.records import FloatArray

_STILL_RAD = 1e-9  # changes below this are rounding, not motion


@dataclass(frozen=True)
class JerkLimitedMove:
    """One move between two joint positions (J,), straight in joint space, within speed, acceleration and jerk limits.

    `jerk_rad_s3` (J,). The joints share one time law along the straight line, as in `TrapezoidalMove`: that of one
    coordinate that runs from 0 to 1.

    `start_rad` and `end_rad` in rad, at rest at both; the speeds and accelerations of `limits` hold.
    """

    start_rad: FloatArray
    end_rad: FloatArray
    limits: JointLimits
    jerk_rad_s3: FloatArray

    def __post_init__(self) -> None:
        jerk = np.asarray(self.jerk_rad_s3)
        if jerk.shape != (len(self.limits),) or not np.all(np.isfinite(jerk) & (jerk > 0.0)):
            raise ConfigError(
                f"jerk limits {jerk.tolist()}", cure=f"give {len(self.limits)} positive values in rad/s^3"
            )
        for name in ("start_rad", "end_rad"):
            value = np.asarray(getattr(self, name))
            if value.shape != (len(self.limits),) or not np.all(np.isfinite(value)):
                raise DataError(f"{name} = {value.tolist()}, wanted {len(self.limits)} finite angles")

    @property
    def duration_s(self) -> float:
        """Time from rest to rest."""
        return float(self._breaks[0][-1])

    @cached_property
    def _breaks(self) -> tuple[FloatArray, FloatArray]:
        """Times (S + 1,) at which the jerk changes, and the jerk (S,) in between, of the coordinate from 0 to 1."""
        size = np.abs(np.subtract(self.end_rad, self.start_rad))
        moving = size > _STILL_RAD
        if not np.any(moving):
            return np.zeros(1), np.zeros(0)
        limits, size = self.limits, size[moving]
        return _one_coordinate(
            float(np.min(limits.velocity_rad_s[moving] / size)),
            float(np.min(limits.acceleration_rad_s2[moving] / size)),
            float(np.min(np.asarray(self.jerk_rad_s3)[moving] / size)),
        )

    def sample(self, t_s: npt.ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, speed and acceleration (T, J) at times (T,) from the start; at rest before and after."""
        change = np.subtract(self.end_rad, self.start_rad)[None, :]
        times, jerk = self._breaks
        asked = np.ravel(np.asarray(t_s, dtype=np.float64))
        if len(jerk) == 0:
            still = np.zeros((len(asked), change.shape[1]))
            return still + self.start_rad, still, still.copy()
        states = _states(times, jerk)
        t = np.clip(asked, 0.0, times[-1])
        k = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(jerk) - 1)
        h = t - times[k]
        x, v, a = states[k].T
        path = x + h * (v + h * (a / 2.0 + h * jerk[k] / 6.0))
        rate = v + h * (a + h * jerk[k] / 2.0)
        push = a + h * jerk[k]
        outside = (asked < 0.0) | (asked >= times[-1])
        path = np.where(asked >= times[-1], 1.0, path)
        rate, push = np.where(outside, 0.0, rate), np.where(outside, 0.0, push)
        return self.start_rad + path[:, None] * change, rate[:, None] * change, push[:, None] * change


def _states(times: FloatArray, jerk: FloatArray) -> FloatArray:
    """Position, speed and acceleration (S, 3) at the beginning of every phase of constant jerk."""
    states = np.zeros((len(jerk), 3))
    for k in range(1, len(jerk)):
        h = times[k] - times[k - 1]
        x, v, a = states[k - 1]
        j = jerk[k - 1]
        states[k] = x + h * (v + h * (a / 2.0 + h * j / 6.0)), v + h * (a + h * j / 2.0), a + h * j
    return states


def _one_coordinate(speed: float, acceleration: float, jerk: float) -> tuple[FloatArray, FloatArray]:
    """The fastest rest-to-rest motion from 0 to 1: break times and jerks.

    Seven phases in closed form (Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008,
    section 3.4); phases that a short motion has no room for have no length.
    """
    if speed * jerk >= acceleration**2:
        bend, rise = acceleration / jerk, acceleration / jerk + speed / acceleration
    else:
        bend = np.sqrt(speed / jerk)
        rise = 2.0 * bend
    cruise = 1.0 / speed - rise
    if cruise < 0.0:
        cruise, bend = 0.0, acceleration / jerk
        rise = 0.5 * bend + np.sqrt(0.25 * bend**2 + 1.0 / acceleration)
        if rise < 2.0 * bend:
            bend = np.cbrt(0.5 / jerk)
            rise = 2.0 * bend
    phases = np.array([bend, rise - 2.0 * bend, bend, cruise, bend, rise - 2.0 * bend, bend])
    pushes = jerk * np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])
    kept = phases > 0.0
    return np.concatenate([[0.0], np.cumsum(phases[kept])]), pushes[kept]
