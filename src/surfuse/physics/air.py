"""Sound in air: its speed."""

from __future__ import annotations

import numpy as np

ZERO_CELSIUS_K = 273.15
REFERENCE_K = 293.15


def speed_of_sound(temperature_c: float) -> float:
    """Speed of sound in m/s: `343.2 sqrt(T / 293.15 K)` (ISO 9613-1)."""
    return float(343.2 * np.sqrt((temperature_c + ZERO_CELSIUS_K) / REFERENCE_K))
