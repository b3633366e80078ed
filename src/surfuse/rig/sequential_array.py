"""An array that fires its rangers one after the other, so that no one hears another's emission."""

from __future__ import annotations

from collections.abc import Sequence

from surfuse.errors import ConfigError
from surfuse.interfaces import OpenedTogether, RangeSensor
from surfuse.records import Echo, Fixture


class SequentialArray(OpenedTogether):
    """See `create`."""

    def __init__(self, fixture: Fixture, sensors: Sequence[RangeSensor]) -> None:
        if len(sensors) != len(fixture):
            raise ConfigError(
                f"{len(sensors)} sensors for a fixture of {len(fixture)}", cure="give one sensor for each place"
            )
        for place, (sensor, spec) in enumerate(zip(sensors, fixture.specs, strict=True)):
            if sensor.spec != spec:
                raise ConfigError(
                    f"sensor '{sensor.spec.name}' in place {place} of the fixture, which is for '{spec.name}'",
                    cure="give the sensors in the order of the fixture",
                )
        super().__init__(*sensors)
        self._fixture, self._sensors = fixture, tuple(sensors)

    @property
    def fixture(self) -> Fixture:
        """Where the sensors sit."""
        return self._fixture

    def sweep(self) -> tuple[Echo, ...]:
        """One answer a sensor, in the order of the fixture."""
        return tuple(sensor.fire() for sensor in self._sensors)


def create(fixture: Fixture, sensors: Sequence[RangeSensor]) -> SequentialArray:
    """The rangers of a fixture, given in its order, as one array."""
    return SequentialArray(fixture, sensors)
