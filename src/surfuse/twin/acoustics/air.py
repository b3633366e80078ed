"""Sound in air: its speed, and how much of it is lost on the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError
from surfuse.physics.air import REFERENCE_K, ZERO_CELSIUS_K

REFERENCE_KPA = 101.325
_TRIPLE_POINT_K = 273.16
_DB_PER_NEPER = 20.0 / np.log(10.0)


@dataclass(frozen=True)
class AirParameters:
    """The air of the cell, and the temperature that the kit believes in.

    Parameters
    ----------
    temperature_c : true air temperature.
    humidity_percent : relative humidity.
    pressure_kpa : ambient pressure.
    assumed_temperature_c : temperature from which the kit takes its speed of sound.
    speed_factor : how much faster sound truly is than its temperature says.
    """

    temperature_c: float = 20.0
    humidity_percent: float = 50.0
    pressure_kpa: float = 101.325
    assumed_temperature_c: float = 20.0
    speed_factor: float = 1.0

    def __post_init__(self) -> None:
        limits = {
            "temperature_c": (-20.0, 50.0),
            "assumed_temperature_c": (-20.0, 50.0),
            "humidity_percent": (0.0, 100.0),
            "pressure_kpa": (50.0, 120.0),
            "speed_factor": (0.9, 1.1),
        }
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ConfigError(f"air.{name} = {value}", cure=f"give {low:g} to {high:g}")


def absorption(air: AirParameters, frequency_hz: float) -> float:
    """Amplitude absorption in nepers per metre of path (ISO 9613-1, used beyond its 10 kHz as is customary)."""
    kelvin = air.temperature_c + ZERO_CELSIUS_K
    ratio, pressure = kelvin / REFERENCE_K, air.pressure_kpa / REFERENCE_KPA
    saturation = 10.0 ** (-6.8346 * (_TRIPLE_POINT_K / kelvin) ** 1.261 + 4.6151)
    h = air.humidity_percent * saturation / pressure
    oxygen_hz = pressure * (24.0 + 4.04e4 * h * (0.02 + h) / (0.391 + h))
    nitrogen_hz = pressure * ratio**-0.5 * (9.0 + 280.0 * h * np.exp(-4.170 * (ratio ** (-1.0 / 3.0) - 1.0)))
    f2 = frequency_hz**2
    classical = 1.84e-11 / pressure * np.sqrt(ratio)
    oxygen = 0.01275 * np.exp(-2239.1 / kelvin) / (oxygen_hz + f2 / oxygen_hz)
    nitrogen = 0.1068 * np.exp(-3352.0 / kelvin) / (nitrogen_hz + f2 / nitrogen_hz)
    return float(f2 * (classical + ratio**-2.5 * (oxygen + nitrogen)))


def absorption_db_per_m(air: AirParameters, frequency_hz: float) -> float:
    """The same in decibels per metre, as tables give it."""
    return float(absorption(air, frequency_hz) * _DB_PER_NEPER)
