"""The array of the twin whose sensors all send at the same moment, and therefore hear each other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from surfuse.interfaces import AlwaysOpen, Clock
from surfuse.node.averaging import average_pings
from surfuse.records import Echo, Fixture, FloatArray
from surfuse.sensors.polaroid import averaging_of, within_limits
from surfuse.world.twin import Twin


class SimultaneousArray(AlwaysOpen):
    """A fixture whose sensors fire together: a sweep takes as long as its slowest sensor.

    Parameters
    ----------
    fixture : where the sensors sit.
    world : the twin.
    world_from_grip : returns the grip's true pose (4, 4).
    clock : simulated time.
    pings : emissions averaged for one reading.
    """

    def __init__(
        self, fixture: Fixture, world: Twin, world_from_grip: Callable[[], FloatArray], clock: Clock, pings: int
    ) -> None:
        self._fixture, self._world, self._world_from_grip = fixture, world, world_from_grip
        self._clock, self._pings = clock, pings

    @property
    def fixture(self) -> Fixture:
        """Where the sensors sit."""
        return self._fixture

    def sweep(self) -> tuple[Echo, ...]:
        """One answer a sensor, in the order of the fixture, all of the same moment."""
        specs, now_s = self._fixture.specs, self._clock.now_s()
        poses = np.asarray(self._world_from_grip() @ self._fixture.grip_from_sensor, dtype=np.float64)
        ranges, amplitudes = self._world.ping_together(poses, specs, self._pings, now_s)
        self._clock.advance(max(spec.firing_time_s for spec in specs))
        return tuple(
            within_limits(average_pings(heard, strength, now_s, averaging_of(spec)), spec)
            for heard, strength, spec in zip(ranges, amplitudes, specs, strict=True)
        )
