"""The program of a sensor node: rangers on a CAN bus, real ones from a file, or simulated ones tethered to a host."""

from __future__ import annotations

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
from surfuse.commands.outcome import Outcome
from surfuse.errors import ConfigError, UsageError, nearest
from surfuse.interfaces import STANDING_ALONE, Clock, MonotonicClock, RangeSensor
from surfuse.node.averaging import average_echoes
from surfuse.node.catalogue import Catalogue
from surfuse.node.counters import Tally
from surfuse.node.firmware import run
from surfuse.node.link import BusLink, open_bus
from surfuse.node.responder import Average, Configure, NodeAbilities, NodeIdentity, Responder, SimultaneousFire
from surfuse.node.simultaneous_fire import ThreadedVolley
from surfuse.rig.description import bus_parameters
from surfuse.rig.simulated.tethered_sensors import TetheredSensors
from surfuse.runs.toml_file import read_toml, refuse_unknown
from surfuse.settings import BUS_PINGS_LIMIT, BusSettings, from_tree

DEFAULT_BUS = "udp_multicast"
PINGS = 5
_UID_LIMIT = 65_536
_SESSIONS = 256
_DRIVER_KEYS = ("driver", "plugin")  # the second is what version 0.1.0 calls it


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
    _refuse_unused(chosen, options)
    tally, bus = Tally(), bus_parameters(chosen.bus)
    identity = NodeIdentity(chosen.bus.node, uuid.getnode() % _UID_LIMIT, secrets.randbelow(_SESSIONS))
    average: Average | None = None
    configure: Configure | None = None
    pings = 1
    with ExitStack() as opening:
        if chosen.sensors:
            clock: Clock = MonotonicClock()
            sensors: Sequence[RangeSensor] = [opening.enter_context(_own(*sensor, "node")) for sensor in chosen.sensors]
            fire_together: SimultaneousFire = ThreadedVolley(sensors)
            pings, average = chosen.pings, average_echoes
        else:
            simulated = TetheredSensors()
            clock, sensors = simulated.clock, simulated.sensors
            if chosen.bus.tether_port:
                opening.enter_context(simulated.tether(chosen.bus.tether_port))
            fire_together, configure = simulated.fire_together, simulated.set_kit
        abilities = NodeAbilities(pings, average, configure, fire_together=fire_together)
        responder = Responder(sensors, clock, identity, Catalogue(), abilities)
        kind = "own" if chosen.sensors else "simulated"
        say(f"node {identity.node} on {bus.interface} {bus.channel}: {len(sensors)} {kind} sensors; Ctrl-C ends it")
        run(responder, BusLink(lambda: open_bus(bus), MonotonicClock(), tally), stop)
    return _outcome(responder, identity, tally, [sensor.spec.name for sensor in sensors])


def _refuse_unused(chosen: NodeFile, options: Mapping[str, object]) -> None:
    """Options that this node would do nothing with."""
    if chosen.sensors and options.get("tether_port") is not None:
        raise UsageError("--tether-port with sensors of its own", cure="leave it out: it places simulated sensors")
    if options.get("port") is not None and chosen.bus.interface != DEFAULT_BUS:
        raise UsageError(
            f"--port with the bus '{chosen.bus.interface}'", cure=f"leave it out: it is for {DEFAULT_BUS} (--bus udp)"
        )


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
    said = [key for key in _DRIVER_KEYS if isinstance(entry, dict) and isinstance(entry.get(key), str)]
    if not isinstance(entry, dict) or len(said) != 1:
        found = "both driver and plugin" if said else "no driver"
        raise ConfigError(f"a [[sensor]] with {found}", cure="write driver = 'tfmini', for example", where=where)
    name, names = entry[said[0]], registry.names("sensors")
    if name not in names:
        raise ConfigError(f"unknown driver '{name}'", cure=nearest(name, names), where=where)
    values = {key: value for key, value in entry.items() if key not in _DRIVER_KEYS}
    _own(name, values, where)
    return name, values


def _own(name: str, values: Mapping[str, object], where: str) -> RangeSensor:
    """A driver with its parameters; it is not opened yet."""
    parameters = registry.parameters("sensors", name, values, f"{where}, sensor '{name}'", STANDING_ALONE)
    sensor: RangeSensor = registry.load("sensors", name).create(parameters)
    return sensor


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
