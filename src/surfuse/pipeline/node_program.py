"""The program of a sensor node: rangers on a CAN bus, real ones from a file, or simulated ones tethered to a host."""

from __future__ import annotations

import dataclasses
import secrets
import signal
import threading
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from surfuse import registry
from surfuse.errors import ConfigError, DeviceError, nearest
from surfuse.interfaces import AlwaysOpen, Clock, RangeSensor
from surfuse.node.averaging import average_echoes
from surfuse.node.catalogue import Catalogue
from surfuse.node.counters import Tally
from surfuse.node.firmware import MonotonicClock, run
from surfuse.node.link import BusLink, open_bus
from surfuse.node.responder import Average, NodeIdentity, Responder, Volley
from surfuse.node.volley import ThreadedVolley
from surfuse.pipeline.outcome import Outcome
from surfuse.records import Echo, FloatArray, SensorSpec
from surfuse.runs.toml_file import read_toml, refuse_unknown
from surfuse.settings import BUS_PINGS_LIMIT, BusSettings, from_tree
from surfuse.simultaneous import SimultaneousArray
from surfuse.twin import (
    SimulatedClock,
    array_sensors,
    array_spec,
    build_world,
    bus_parameters,
    fired_together,
    square_fixture,
)
from surfuse.world.tether import NodeEnd, Place
from surfuse.world.twin import Twin

DEFAULT_BUS = "udp_multicast"
OWN_SENSORS = ("a02yyuw", "hcsr04", "iio", "maxbotix", "tfmini")
PINGS = 5
_UID_LIMIT = 65_536
_SESSIONS = 256


@dataclass(frozen=True)
class NodeFile:
    """What a node file says: bus, readings averaged for one answer, and the sensors in the order of their numbers."""

    bus: BusSettings
    pings: int
    sensors: tuple[tuple[str, Mapping[str, object]], ...]


def node(
    file: Path | None, options: Mapping[str, object], stop: threading.Event, say: Callable[[str], None]
) -> Outcome:
    """Be a node until `stop` is set.

    `file` is TOML with `[[sensor]]` tables; without one the sensors are simulated, placed by the host that connects.
    `options` are keys of the bus that win over the file's; `say` is told once, when the node is ready.

    Raises
    ------
    ConfigError : the file or an option cannot be used.
    DeviceError : the bus or a sensor cannot be opened.
    """
    chosen = read_node_file(file, options)
    tally, bus = Tally(), bus_parameters(chosen.bus)
    identity = NodeIdentity(chosen.bus.node, uuid.getnode() % _UID_LIMIT, secrets.randbelow(_SESSIONS))
    average: Average | None = None
    pings = 1
    with ExitStack() as opening:
        if chosen.sensors:
            clock: Clock = MonotonicClock()
            sensors: Sequence[RangeSensor] = [opening.enter_context(_own(*sensor)) for sensor in chosen.sensors]
            volley: Volley = ThreadedVolley(sensors)
            pings, average = chosen.pings, average_echoes
        else:
            simulated = TetheredSensors()
            clock, sensors = simulated.clock, simulated.sensors
            if chosen.bus.tether_port:
                opening.enter_context(NodeEnd(chosen.bus.tether_port, simulated.configure, simulated.move))
            volley = simulated.volley
        responder = Responder(sensors, clock, identity, Catalogue(), pings=pings, average=average, volley=volley)
        kind = "own" if chosen.sensors else "simulated"
        say(f"node {identity.node} on {bus.interface} {bus.channel}: {len(sensors)} {kind} sensors; Ctrl-C ends it")
        run(responder, BusLink(lambda: open_bus(bus), MonotonicClock(), tally), stop)
    return _outcome(responder, identity, tally, [sensor.spec.name for sensor in sensors])


@contextmanager
def ended_by_signals() -> Iterator[threading.Event]:
    """An event that Ctrl-C and a termination request set, so that the node closes what it opened."""
    stop = threading.Event()

    def end(number: int, frame: FrameType | None) -> None:
        stop.set()

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def read_node_file(file: Path | None, options: Mapping[str, object]) -> NodeFile:
    """The bus and the sensors of a node; see `docs/how-to/two_processes.md`.

    Raises
    ------
    ConfigError : unknown key or plug-in, wrong type, value out of its limits.
    """
    table = {} if file is None else read_toml(file)
    where = "node" if file is None else str(file)
    refuse_unknown(table, ("bus", "pings", "sensor"), where)
    bus, entries, pings = table.get("bus", {}), table.get("sensor", []), table.get("pings", PINGS)
    if not isinstance(bus, dict) or not isinstance(entries, list):
        raise ConfigError("bus and sensor have the wrong form", cure="write [bus] and [[sensor]] tables", where=where)
    if isinstance(pings, bool) or not isinstance(pings, int) or not 1 <= pings <= BUS_PINGS_LIMIT:
        raise ConfigError(f"pings = {pings!r}", cure=f"give 1 to {BUS_PINGS_LIMIT}", where=where)
    if file is not None and not entries:
        raise ConfigError("no sensor", cure="add a [[sensor]] table, or give no file for simulated ones", where=where)
    known = {key: value for key, value in options.items() if value is not None}
    chosen = from_tree({"bus": {"interface": DEFAULT_BUS, **bus, **known}}, where).bus
    if chosen.interface in ("none", "virtual"):
        raise ConfigError(
            f"bus.interface = '{chosen.interface}' does not leave this process",
            cure="give udp_multicast, socketcan, slcan...",
            where=where,
        )
    return NodeFile(chosen, pings, tuple(_sensor_entry(entry, where) for entry in entries))


def _sensor_entry(entry: object, where: str) -> tuple[str, Mapping[str, object]]:
    if not isinstance(entry, dict) or not isinstance(entry.get("plugin"), str):
        raise ConfigError("a [[sensor]] without plugin", cure="write plugin = 'tfmini', for example", where=where)
    name = entry["plugin"]
    if name not in OWN_SENSORS:
        raise ConfigError(f"unknown sensor plug-in '{name}'", cure=nearest(name, OWN_SENSORS), where=where)
    values = {key: value for key, value in entry.items() if key != "plugin"}
    fields = dataclasses.fields(registry.load("sensors", name).Parameters)
    refuse_unknown(values, [field.name for field in fields], f"{where}, sensor '{name}'")
    missing = [
        field.name
        for field in fields
        if field.default is dataclasses.MISSING
        and field.default_factory is dataclasses.MISSING
        and field.name not in values
    ]
    if missing:
        raise ConfigError(f"sensor '{name}' lacks {', '.join(missing)}", cure=f"add {missing[0]} = ...", where=where)
    return name, values


def _own(name: str, values: Mapping[str, object]) -> RangeSensor:
    """A driver with its parameters."""
    plug_in = registry.load("sensors", name)
    try:
        sensor: RangeSensor = plug_in.create(plug_in.Parameters(**values))
    except (TypeError, ValueError) as error:
        raise ConfigError(f"sensor '{name}': {error}", cure="correct its table in the node file") from error
    return sensor


class TetheredSensors:
    """Simulated sensors of a twin that the connected host describes, at the place that it tells."""

    def __init__(self) -> None:
        specs = [array_spec(from_tree({}), f"us{index}") for index in range(4)]
        self.sensors = tuple(_Tethered(self, index, spec) for index, spec in enumerate(specs))
        self.clock = SimulatedClock()
        self._world: Twin | None = None
        self._fired: tuple[RangeSensor, ...] = ()
        self._together: SimultaneousArray | None = None
        self._world_from_grip: FloatArray | None = None

    def configure(self, tree: Mapping[str, object]) -> None:
        """Build the host's twin."""
        settings = from_tree(tree, "configuration of the host")
        self._world, _ = build_world(settings)
        self._world_from_grip = None
        fixture = square_fixture(settings)
        self._together = fired_together(settings, fixture, self._world, self._grip, self.clock)
        self._fired = array_sensors(settings, fixture, self._world, self._grip, self.clock)

    def move(self, place: Place) -> None:
        """Take the arm's true place."""
        if self._world is None:
            raise ConfigError("a place before the configuration", cure="send the configuration first")
        self.clock.advance(place.t_s - self.clock.now_s())
        self._world.begin(place.stage, place.index)
        self._world_from_grip = place.world_from_grip

    def fire(self, index: int) -> Echo:
        """One reading of one sensor."""
        if not self._fired:
            raise DeviceError("no host has said where the sensors are", cure="run `surfuse acquire --node udp`")
        return self._fired[index].fire()

    def volley(self, numbers: Sequence[int]) -> Sequence[Echo | None]:
        """One reading of each of these sensors, all at the same moment; None before a host has told all it must."""
        if self._together is None or self._world_from_grip is None:
            return (None,) * len(numbers)
        return self._together.volley(numbers)

    def _grip(self) -> FloatArray:
        if self._world_from_grip is None:
            raise DeviceError("the host has not said where the arm is", cure="run `surfuse acquire --node udp`")
        return self._world_from_grip


class _Tethered(AlwaysOpen):
    """One sensor of `TetheredSensors` under its number."""

    def __init__(self, owner: TetheredSensors, index: int, spec: SensorSpec) -> None:
        self._owner, self._index, self._spec = owner, index, spec

    @property
    def spec(self) -> SensorSpec:
        """The paper's transducer; the host's configuration may change what it hears."""
        return self._spec

    def fire(self) -> Echo:
        """One reading."""
        return self._owner.fire(self._index)


def _outcome(responder: Responder, identity: NodeIdentity, tally: Tally, names: list[str]) -> Outcome:
    counts = tally.snapshot()
    summary: dict[str, object] = {
        "node": identity.node,
        "sensors": names,
        "bad_frames": responder.bad_frames,
        "send_errors": responder.send_errors,
        "receive_errors": counts.receive_errors,
        "reopened": counts.reopened,
    }
    return Outcome(summary, [(name.replace("_", " "), str(value)) for name, value in summary.items()])
