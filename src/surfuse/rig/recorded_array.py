"""The array of a recorded scan: every sweep answers what was recorded, stop after stop."""

from __future__ import annotations

from surfuse.errors import ConfigError, DeviceError
from surfuse.interfaces import AlwaysOpen
from surfuse.records import Echo, Fixture, Readings, Status


class RecordedArray(AlwaysOpen):
    """See `create`."""

    def __init__(self, readings: Readings, fixture: Fixture, start: int) -> None:
        if len(fixture) != len(readings.specs):
            raise ConfigError(
                f"a fixture of {len(fixture)} sensors for a record of {len(readings.specs)}",
                cure="give the fixture that the scan was made with",
            )
        if not 0 <= start <= readings.n_sweeps:
            raise ConfigError(f"start = {start} of {readings.n_sweeps} recorded sweeps", cure="give a recorded sweep")
        self._readings, self._fixture, self._next = readings, fixture, start

    @property
    def fixture(self) -> Fixture:
        """Where the sensors sat."""
        return self._fixture

    def sweep(self) -> tuple[Echo, ...]:
        """The next recorded sweep; a sensor that it lacks answers as a fault with no pings.

        Raises
        ------
        DeviceError : the record has no more sweeps.
        """
        if self._next >= self._readings.n_sweeps:
            raise DeviceError(
                f"the record has only {self._readings.n_sweeps} sweeps", cure="scan no more stops than were recorded"
            )
        taken = self._readings.sweep(self._next)
        self._next += 1
        moment_s = float(taken.t_s[0]) if len(taken.t_s) else float("nan")
        echoes = [Echo(float("nan"), Status.FAULT, moment_s, count=0)] * len(self._fixture)
        for k, sensor in enumerate(taken.sensor):
            echoes[int(sensor)] = taken.echo(k)
        return tuple(echoes)


def create(readings: Readings, fixture: Fixture, start: int = 0) -> RecordedArray:
    """Replay a scan from sweep `start` on."""
    return RecordedArray(readings, fixture, start)
