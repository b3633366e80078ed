"""The array of the twin whose sensors all send at the same moment, and therefore hear each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from surfuse.interfaces import AlwaysOpen, Clock
from surfuse.node.averaging import average_pings
from surfuse.records import Echo, Fixture, FloatArray
from surfuse.sensors.polaroid import averaging_of, within_limits
from surfuse.twin.world import Twin


class SimultaneousArray(AlwaysOpen):
    """A fixture whose sensors fire together: a sweep takes as long as its slowest sensor.

    Parameters
    ----------
    fixture : where the sensors are known to sit.
    world : the twin.
    world_from_grip : returns the grip's true pose (4, 4).
    clock : simulated time.
    pings : emissions averaged for one reading.
    sample_rate_hz : rate of the clock that counts the times of flight.
    seated : where the sensors truly sit; default: as known.
    """

    def __init__(
        self,
        fixture: Fixture,
        world: Twin,
        world_from_grip: Callable[[], FloatArray],
        clock: Clock,
        pings: int,
        sample_rate_hz: float = 1e6,
        seated: Fixture | None = None,
    ) -> None:
        self._seated = seated or fixture
        self._fixture, self._world, self._world_from_grip = fixture, world, world_from_grip
        self._clock, self._pings, self._sample_rate_hz = clock, pings, sample_rate_hz

    @property
    def fixture(self) -> Fixture:
        """Where the sensors are known to sit."""
        return self._fixture

    def sweep(self) -> tuple[Echo, ...]:
        """One answer a sensor, in the order of the fixture, all of the same moment."""
        return self.fire_together(range(len(self._fixture)))

    def fire_together(self, numbers: Sequence[int]) -> tuple[Echo, ...]:
        """One answer of each of these sensors, which send together; the others are silent."""
        specs, now_s = [self._fixture.specs[number] for number in numbers], self._clock.now_s()
        poses = np.asarray(self._world_from_grip() @ self._seated.grip_from_sensor[list(numbers)], dtype=np.float64)
        ranges, amplitudes = self._world.ping_together(poses, specs, self._pings, now_s)
        self._clock.advance(max(spec.firing_time_s for spec in specs))
        return tuple(
            within_limits(average_pings(heard, strength, now_s, averaging_of(spec, self._sample_rate_hz)), spec)
            for heard, strength, spec in zip(ranges, amplitudes, specs, strict=True)
        )
