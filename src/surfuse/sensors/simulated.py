"""Any ranger in the twin: it asks the world what it would hear at its true pose."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

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
    ping_period_s : time between them, each from where the sensor then is; 0 for a sensor that stands still, all of
        whose pings come from one pose.
    sample_rate_hz : rate of the clock that counts the times of flight.
    """

    def __init__(
        self,
        spec: SensorSpec,
        world: World,
        pose: Callable[[], FloatArray],
        clock: Clock,
        pings: int,
        ping_period_s: float = 0.0,
        sample_rate_hz: float = 1e6,
    ) -> None:
        if not 1 <= pings <= 1000:
            raise ConfigError(f"sensor '{spec.name}': pings = {pings}", cure="give 1 to 1000")
        self._spec, self._world, self._pose, self._clock, self._pings = spec, world, pose, clock, pings
        if not 0.0 <= pings * ping_period_s <= spec.firing_time_s * (1.0 + 1e-9):
            raise ConfigError(
                f"sensor '{spec.name}': {pings} pings every {ping_period_s} s, firing time {spec.firing_time_s} s",
                cure="give fewer pings or a longer firing time",
            )
        self._ping_period_s = ping_period_s
        self._averaging = averaging_of(spec, sample_rate_hz)

    @property
    def spec(self) -> SensorSpec:
        """What is known of this ranger."""
        return self._spec

    def fire(self) -> Echo:
        """One reading: its pings, averaged; the clock goes on by the firing time."""
        started_s = self._clock.now_s()
        if self._ping_period_s == 0.0:
            ranges, amplitudes = self._world.ping(self._pose(), self._spec, self._pings, started_s)
        else:
            ranges, amplitudes = self._ping_on_the_way()
        self._clock.advance(self._spec.firing_time_s - (self._pings - 1) * self._ping_period_s)
        return within_limits(average_pings(ranges, amplitudes, started_s, self._averaging), self._spec)

    def _ping_on_the_way(self) -> tuple[FloatArray, FloatArray]:
        """Every ping from where the sensor is at its own moment."""
        heard = []
        for ping in range(self._pings):
            if ping:
                self._clock.advance(self._ping_period_s)
            heard.append(self._world.ping(self._pose(), self._spec, 1, self._clock.now_s()))
        return np.concatenate([ranges for ranges, _ in heard]), np.concatenate([levels for _, levels in heard])


def create(
    spec: SensorSpec,
    world: World,
    pose: Callable[[], FloatArray],
    clock: Clock,
    pings: int = 5,
    ping_period_s: float = 0.0,
    sample_rate_hz: float = 1e6,
) -> SimulatedSensor:
    """A ranger with any spec in the twin; the other arguments as in `SimulatedSensor`."""
    return SimulatedSensor(spec, world, pose, clock, pings, ping_period_s, sample_rate_hz)
