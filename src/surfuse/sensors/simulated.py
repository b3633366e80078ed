"""Any ranger in the twin: it asks the world what it would hear at its true pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from surfuse.errors import ConfigError
from surfuse.interfaces import GIVEN_BY_RIG, AlwaysOpen, SensorSurroundings, World, surrounded
from surfuse.node.averaging import average_pings
from surfuse.records import Echo, FloatArray, SensorSpec
from surfuse.sensors.polaroid import SPEC, averaging_of, within_limits

SUMMARY = "a ranger of any kind in the simulated rig"


@dataclass(frozen=True, kw_only=True)
class Surroundings(SensorSurroundings):
    """The world of the twin; `pose` says where the ranger truly is when it fires: `world_from_sensor` (4, 4)."""

    world: World
    pose: Callable[[], FloatArray]


@dataclass(frozen=True)
class Parameters:
    """How a reading is made.

    pings : emissions averaged for one reading.
    ping_period_s : time between them, each from where the sensor then is; 0 for a sensor that stands still, all of
        whose pings come from one pose.
    sample_rate_hz : rate of the clock that counts the times of flight.
    """

    pings: int = 5
    ping_period_s: float = 0.0
    sample_rate_hz: float = 1e6
    surroundings: Surroundings | None = field(default=None, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if not 1 <= self.pings <= 1000:
            raise ConfigError(f"pings = {self.pings}", cure="give 1 to 1000")
        if not 0.0 <= self.ping_period_s <= 60.0:
            raise ConfigError(f"ping_period_s = {self.ping_period_s}", cure="give 0 to 60 s")
        if not 1.0 <= self.sample_rate_hz <= 1e12:
            raise ConfigError(f"sample_rate_hz = {self.sample_rate_hz}", cure="give 1 to 1e12 Hz")


class SimulatedSensor(AlwaysOpen):
    """A ranger with any spec in the twin; every reading lets `spec.firing_time_s` pass.

    Raises
    ------
    ConfigError : the pings take longer than the firing time.
    """

    def __init__(self, parameters: Parameters, surroundings: Surroundings) -> None:
        self._spec = surroundings.known(SPEC)
        self._pings, self._ping_period_s = parameters.pings, parameters.ping_period_s
        if not self._pings * self._ping_period_s <= self._spec.firing_time_s * (1.0 + 1e-9):
            raise ConfigError(
                f"{self._pings} pings every {self._ping_period_s} s, firing time {self._spec.firing_time_s} s",
                cure="give fewer pings or a longer firing time",
                where=f"sensor '{self._spec.name}'",
            )
        self._world, self._pose, self._clock = surroundings.world, surroundings.pose, surroundings.clock
        self._averaging = averaging_of(self._spec, parameters.sample_rate_hz)

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


def create(parameters: Parameters) -> SimulatedSensor:
    """A ranger in the twin."""
    return SimulatedSensor(parameters, surrounded(parameters.surroundings, "simulated"))
