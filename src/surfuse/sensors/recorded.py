"""One sensor of a recorded scan: every shot answers what was recorded, in order of time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from surfuse.errors import ConfigError, DeviceError, nearest
from surfuse.interfaces import GIVEN_BY_RIG, AlwaysOpen, SensorSurroundings, surrounded
from surfuse.records import Echo, Readings, SensorSpec, Status

SUMMARY = "plays back the readings of one sensor of a recorded scan"


@dataclass(frozen=True, kw_only=True)
class Surroundings(SensorSurroundings):
    """The recorded scan."""

    readings: Readings


@dataclass(frozen=True)
class Parameters:
    """`sensor`: its name in the record. `first_reading`: which of its readings comes first, from 0."""

    sensor: str
    first_reading: int = 0
    surroundings: Surroundings | None = field(default=None, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if self.first_reading < 0:
            raise ConfigError(f"first_reading = {self.first_reading}", cure="give 0 or more")


class RecordedSensor(AlwaysOpen):
    """A sensor whose answers are known beforehand."""

    def __init__(self, parameters: Parameters, surroundings: Surroundings) -> None:
        readings = surroundings.readings
        names = [spec.name for spec in readings.specs]
        if parameters.sensor not in names:
            raise ConfigError(f"sensor = '{parameters.sensor}'", cure=nearest(parameters.sensor, names))
        number = names.index(parameters.sensor)
        rows = np.flatnonzero(readings.sensor == number)
        self._readings, self._spec = readings, surroundings.known(readings.specs[number])
        self._rows = rows[np.argsort(readings.t_s[rows], kind="stable")][parameters.first_reading :]
        self._stops = np.repeat(readings.stop, np.diff(readings.start))[self._rows]
        self._next = 0

    @property
    def spec(self) -> SensorSpec:
        """What the record says of the sensor."""
        return self._spec

    def go_to(self, stop: int) -> None:
        """Play on from the first reading of this stop; where there is none, the record ends."""
        found = np.flatnonzero(self._stops == stop)
        self._next = int(found[0]) if len(found) else len(self._rows)

    def fire(self) -> Echo:
        """The next recorded reading.

        Raises
        ------
        DeviceError : the record has no more of this sensor.
        """
        if self._next >= len(self._rows):
            raise DeviceError(
                f"the record has only {len(self._rows)} readings of '{self._spec.name}'",
                cure="fire no more often than was recorded",
            )
        k, taken = int(self._rows[self._next]), self._readings
        self._next += 1
        return Echo(
            range_m=float(taken.range_m[k]),
            status=Status(int(taken.status[k])),
            t_s=float(taken.t_s[k]),
            amplitude=float(taken.amplitude[k]),
            spread_m=float(taken.spread_m[k]),
            count=int(taken.count[k]),
            sigma_m=float(taken.sigma_m[k]),
        )


def create(parameters: Parameters) -> RecordedSensor:
    """A sensor that plays back."""
    return RecordedSensor(parameters, surrounded(parameters.surroundings, "recorded"))
