"""The array of the simulated cell behind a sensor node: in this process, or in another one."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Protocol

from surfuse.interfaces import Clock, Device, OpenedTogether, RangeSensor
from surfuse.node.array import CanArray, Parameters
from surfuse.node.bus_time import sweep_bus_s
from surfuse.node.catalogue import Catalogue
from surfuse.node.counters import BusCounters, Tally
from surfuse.node.firmware import Node
from surfuse.node.link import BusLink, BusParameters, OpenBus, open_bus
from surfuse.node.responder import NodeAbilities, NodeIdentity, Responder, SimultaneousFire
from surfuse.node.timeouts import NodeTimeouts
from surfuse.records import Echo, Fixture

# A simulated node compiles its kernels at the first reading, which takes seconds on a slow machine.
_SIMULATED_SILENCE_S = 60.0
_REAL_SILENCE_S = 10.0
# Sensors that really measure may take their time: it does not pass on the simulated clock.
_REAL_SWEEP_S = 60.0
_TELLINGS = 3
# A sweep without any answer is an error at once: the scan tries the same stop again, and a resumed run goes on there.
_LOST_SWEEPS = 1
_numbers = itertools.count(1)


class Tether(Device, Protocol):
    """What tells a simulated node in another process where the arm truly is."""

    def tell(self) -> None:
        """Send the stop and the arm's place now; return when the node has taken them in."""


class _ArrayOnBus(OpenedTogether):
    """An array behind a node, with what has to be open for it."""

    def __init__(self, array: CanArray, *parts: Device) -> None:
        super().__init__(*parts)
        self._array = array

    @property
    def fixture(self) -> Fixture:
        """Where the sensors sit."""
        return self._array.fixture

    @property
    def counters(self) -> BusCounters:
        """What happened on the bus so far."""
        return self._array.counters


class ArrayInProcess(_ArrayOnBus):
    """The sensors of a fixture behind a node on the virtual bus of this process; see `in_process`."""

    def __init__(self, node: Node, array: CanArray, clock: Clock, bus_s: float) -> None:
        super().__init__(array, node, array)
        self._clock, self._bus_s = clock, bus_s

    def sweep(self) -> tuple[Echo, ...]:
        """One answer a sensor, in the order of the fixture.

        Afterwards simulated time goes on by that of the frames on the bus: what is read does not depend on the bus.
        """
        echoes = self._array.sweep()
        self._clock.advance(self._bus_s)
        return echoes


class ArrayElsewhere(_ArrayOnBus):
    """The sensors of a fixture behind a node in another process; see `elsewhere`."""

    def __init__(self, array: CanArray, tether: Tether | None, clock: Clock, sweep_s: float) -> None:
        """`sweep_s` is how long a sweep takes, with its frames on the bus."""
        super().__init__(array, array, *([] if tether is None else [tether]))
        self._tether, self._clock, self._sweep_s = tether, clock, sweep_s

    def sweep(self) -> tuple[Echo, ...]:
        """One answer a sensor, in the order of the fixture; simulated time goes on by that of the sweep.

        A simulated node that is started again in the middle no longer knows where it is: it is told, and fires anew.
        """
        for _ in range(_TELLINGS):
            restarts = self._array.counters.restarts
            if self._tether is not None:
                self._tether.tell()
            echoes = self._array.sweep()
            if self._tether is None or self._array.counters.restarts == restarts:
                break
        self._clock.advance(self._sweep_s)
        return echoes


class _ArrivalClock:
    """Stamps what arrives with the end of the sweep, which a node elsewhere lets pass on a clock of its own."""

    def __init__(self, clock: Clock, sweep_s: float) -> None:
        self._clock, self._sweep_s = clock, sweep_s

    def now_s(self) -> float:
        """The end of a sweep that begins now."""
        return self._clock.now_s() + self._sweep_s

    def advance(self, duration_s: float) -> None:
        """Let time pass."""
        self._clock.advance(duration_s)


def in_process(
    fixture: Fixture,
    sensors: Sequence[RangeSensor],
    node: int,
    bitrate_bps: int,
    clock: Clock,
    fire_together: SimultaneousFire,
    together: bool,
) -> ArrayInProcess:
    """Sensors behind a node in a thread of this process, on a virtual bus that no one else is on.

    `clock` is shared by both ends and the sensors; `together` has them sent by `fire_together`, not one by one.
    """
    bus = BusParameters("virtual", f"surfuse-{next(_numbers)}", bitrate_bps)
    abilities = NodeAbilities(fire_together=fire_together)
    responder = Responder(sensors, clock, NodeIdentity(node), Catalogue(), abilities)
    timeouts = NodeTimeouts(silence_limit_s=_SIMULATED_SILENCE_S, lost_sweeps_limit=_LOST_SWEEPS)
    host = Parameters(bus=bus, node=node, timeouts=timeouts, together=together)
    firmware = Node(responder, BusLink(_opener(bus), clock, Tally()))
    bus_s = sweep_bus_s(len(fixture), bitrate_bps)
    return ArrayInProcess(firmware, _can_array(fixture, host, clock, clock), clock, bus_s)


def elsewhere(
    fixture: Fixture,
    bus: BusParameters,
    node: int,
    connect_timeout_s: float,
    tether: Tether | None,
    clock: Clock,
    together: bool,
) -> ArrayElsewhere:
    """Sensors behind a node in another process; `tether` is for a node whose sensors are simulated."""
    silence_s = _REAL_SILENCE_S if tether is None else _SIMULATED_SILENCE_S
    timeouts = NodeTimeouts(
        silence_limit_s=silence_s, connect_timeout_s=connect_timeout_s, lost_sweeps_limit=_LOST_SWEEPS
    )
    sweep_s = _firing_time_s(fixture, together)
    arrivals = _ArrivalClock(clock, _REAL_SWEEP_S if tether is None else sweep_s)
    host = Parameters(bus=bus, node=node, timeouts=timeouts, together=together)
    bus_s = sweep_bus_s(len(fixture), bus.bitrate_bps)
    return ArrayElsewhere(_can_array(fixture, host, clock, arrivals), tether, clock, sweep_s + bus_s)


def _can_array(fixture: Fixture, parameters: Parameters, clock: Clock, arrivals: Clock) -> CanArray:
    tally = Tally()
    return CanArray(fixture, parameters, BusLink(_opener(parameters.bus), arrivals, tally), clock, tally)


def _opener(bus: BusParameters) -> OpenBus:
    return lambda: open_bus(bus)


def _firing_time_s(fixture: Fixture, together: bool) -> float:
    """How long a sweep takes."""
    times_s = [spec.firing_time_s for spec in fixture.specs]
    return max(times_s) if together else sum(times_s)
