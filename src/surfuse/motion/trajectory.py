"""What every planned motion can do: say how long it takes, and where the joints should be at any time."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from surfuse.records import FloatArray


class Trajectory(Protocol):
    """A motion of J joints from rest to rest."""

    @property
    def duration_s(self) -> float: ...
    def sample(self, t_s: npt.ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, speed and acceleration (T, J) at times (T,) from the start; at rest before and after."""


def ticks(trajectory: Trajectory, period_s: float) -> FloatArray:
    """Times (T,) of the servo ticks of a motion, the last one at or after its end."""
    count = int(np.ceil(trajectory.duration_s / period_s - 1e-9))
    return np.asarray(period_s * np.arange(1, count + 1), dtype=np.float64)
