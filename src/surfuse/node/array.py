"""The array behind CAN: a node fires the sensors, this end asks, checks, asks again, and never makes up a number."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

from surfuse.errors import ConfigError
from surfuse.interfaces import Clock, MonotonicClock
from surfuse.node.catalogue import Catalogue
from surfuse.node.client import Line, NodeClient
from surfuse.node.counters import BusCounters, BusEvent, Tally
from surfuse.node.link import BusLink, BusParameters, Link, open_bus
from surfuse.node.messages import ALL_SENSORS, MAX_SENSORS, Heartbeat, KitMessage
from surfuse.node.timeouts import NodeTimeouts
from surfuse.records import Echo, Fixture


@dataclass(frozen=True)
class Parameters:
    """Which node, on which bus, with how much patience.

    bus : the CAN adapter.
    node : address of the node, 1 to 7.
    sensors : number of each sensor of the fixture in the node; empty: 0, 1, 2...
    patience : waiting and asking again; give a simulated node a `silence_limit_s` of a minute.
    wave_speed_max_m_s : no ultrasonic echo is faster; answers that would need it are refused.
    catalogue : a DBC file; None: the one of this package.
    together : have all sensors send at the same moment, so that they hear each other, instead of one after the other.
    """

    bus: BusParameters = field(default_factory=BusParameters)
    node: int = 1
    sensors: tuple[int, ...] = ()
    timeouts: NodeTimeouts = field(default_factory=NodeTimeouts)
    wave_speed_max_m_s: float = 400.0
    catalogue: Path | None = None
    together: bool = False

    def __post_init__(self) -> None:
        if not 1 <= self.node <= 7:
            raise ConfigError(f"node = {self.node}", cure="give 1 to 7")
        if not 100.0 <= self.wave_speed_max_m_s <= 1e9:
            raise ConfigError(f"wave_speed_max_m_s = {self.wave_speed_max_m_s}", cure="give 100 to 1e9 m/s")
        if len(set(self.sensors)) != len(self.sensors) or not set(self.sensors) <= set(range(MAX_SENSORS)):
            raise ConfigError(f"sensors = {self.sensors}", cure=f"give different numbers 0 to {MAX_SENSORS - 1}")


class CanArray:
    """The sensors of a fixture behind a node; `sweep` returns exactly what the frames say.

    Parameters
    ----------
    fixture : where the sensors sit.
    parameters : how to reach them.
    link : the bus of this end, sharing `clock` and `tally`.
    clock : stamps triggers and arrivals; the times of the echoes are in it.
    tally : where events are counted.
    monotonic_s : measures the waiting, which is real also when `clock` is simulated.
    """

    def __init__(
        self,
        fixture: Fixture,
        parameters: Parameters,
        link: Link,
        clock: Clock,
        tally: Tally,
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        numbers = parameters.sensors or tuple(range(len(fixture)))
        if len(numbers) != len(fixture) or len(fixture) > MAX_SENSORS:
            cure = f"a node has at most {MAX_SENSORS} sensors; give one number for each of the fixture"
            raise ConfigError(f"{len(numbers)} sensor numbers for {len(fixture)} sensors", cure=cure)
        self._fixture, self._parameters, self._link, self._tally = fixture, parameters, link, tally
        self._numbers = numbers
        self._client = NodeClient(
            parameters.node,
            dict(zip(numbers, fixture.specs, strict=True)),
            parameters.timeouts,
            Line(link, Catalogue(parameters.catalogue), clock, tally, monotonic_s),
            wave_speed_max_m_s=parameters.wave_speed_max_m_s,
            together=parameters.together,
        )
        self._lost_sweeps = 0

    def __enter__(self) -> Self:
        self._link.__enter__()
        try:
            self._client.connect()
        except BaseException as error:
            self._link.__exit__(type(error), error, error.__traceback__)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._client.close()
        self._link.__exit__(kind, error, trace)

    @property
    def fixture(self) -> Fixture:
        """Where the sensors sit."""
        return self._fixture

    @property
    def counters(self) -> BusCounters:
        """What happened on the bus so far."""
        return self._tally.snapshot()

    @property
    def heartbeat(self) -> Heartbeat | None:
        """The last sign of life of the node."""
        return self._client.watch.last_heartbeat

    def sweep(self) -> tuple[Echo, ...]:
        """One answer a sensor, in the order of the fixture; `Status.FAULT` where no trustworthy one came.

        Raises
        ------
        DeviceError : for several sweeps in a row the node has not given one trustworthy answer.
        """
        exchange = self._client.ask()
        for _ in range(1, self._parameters.timeouts.rounds):
            if not exchange.untrusted - exchange.refused or (exchange.news == 0 and not exchange.void):
                break
            self._tally.add(BusEvent.FIRED_AGAIN)
            exchange = self._client.ask()
        untrusted = exchange.untrusted
        self._tally.add(BusEvent.READINGS, len(self._numbers))
        self._tally.add(BusEvent.FAILED, len(untrusted))
        self._lost_sweeps = self._lost_sweeps + 1 if len(untrusted) == len(self._numbers) else 0
        if self._lost_sweeps >= self._parameters.timeouts.lost_sweeps_limit:
            raise self._client.lost()
        return tuple(exchange.echo(number) for number in self._numbers)

    def configure(self, settings: KitMessage, sensor: int | None = None) -> None:
        """Set the kit parameters of one sensor of the fixture (None: of all); they are sent again after a restart.

        Raises
        ------
        DeviceError : the node refuses them, or does not answer.
        """
        self._client.configure(ALL_SENSORS if sensor is None else self._numbers[sensor], settings)


def create(fixture: Fixture, parameters: Parameters | None = None, clock: Clock | None = None) -> CanArray:
    """An array behind CAN; `clock` is shared with a simulated node (None: the machine's)."""
    chosen = parameters or Parameters()
    own_clock, tally = clock or MonotonicClock(), Tally()
    return CanArray(fixture, chosen, BusLink(lambda: open_bus(chosen.bus), own_clock, tally), own_clock, tally)
