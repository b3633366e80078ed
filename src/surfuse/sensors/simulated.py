"""Any ranger in the twin: it asks the world what it would hear at its true pose."""

from __future__ import annotations

from collections.abc import Callable

from surfuse.errors import ConfigError
from surfuse.interfaces import AlwaysOpen, Clock, World
from surfuse.node.averaging import average_pings
from surfuse.records import Echo, FloatArray, SensorSpec
from surfuse.sensors.polaroid import averaging_of, within_limits


class SimulatedSensor(AlwaysOpen):
    """A ranger with any spec in the twin.

    Parameters
    ----------
    spec : the ranger.
    world : the twin.
    pose : returns `world_from_sensor` (4, 4) as it truly is at the moment of firing.
    clock : simulated time; every reading advances it by `spec.firing_time_s`.
    pings : emissions averaged for one reading.
    """

    def __init__(
        self, spec: SensorSpec, world: World, pose: Callable[[], FloatArray], clock: Clock, pings: int
    ) -> None:
        if not 1 <= pings <= 1000:
            raise ConfigError(f"sensor '{spec.name}': pings = {pings}", cure="give 1 to 1000")
        self._spec, self._world, self._pose, self._clock, self._pings = spec, world, pose, clock, pings
        self._averaging = averaging_of(spec)

    @property
    def spec(self) -> SensorSpec:
        """What is known of this ranger."""
        return self._spec

    def fire(self) -> Echo:
        """One reading: all its pings from one pose, averaged; the clock goes on by the firing time."""
        started_s = self._clock.now_s()
        ranges, amplitudes = self._world.ping(self._pose(), self._spec, self._pings, started_s)
        self._clock.advance(self._spec.firing_time_s)
        return within_limits(average_pings(ranges, amplitudes, started_s, self._averaging), self._spec)


def create(
    spec: SensorSpec, world: World, pose: Callable[[], FloatArray], clock: Clock, pings: int = 5
) -> SimulatedSensor:
    """A ranger with any spec in the twin; `pose`, `clock` and `pings` as in `SimulatedSensor`."""
    return SimulatedSensor(spec, world, pose, clock, pings)
