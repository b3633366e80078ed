"""The sensors of a cell file that sit behind nodes on the CAN bus: `driver = "node"`, one sweep a node."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass

from surfuse.errors import ConfigError, nearest
from surfuse.interfaces import Clock, OpenedTogether
from surfuse.node.array import CanArray, Parameters
from surfuse.node.counters import BusCounters, Tally
from surfuse.node.link import BusLink, open_bus
from surfuse.node.messages import MAX_SENSORS
from surfuse.node.timeouts import NodeTimeouts
from surfuse.records import Echo, Fixture
from surfuse.rig.description import bus_parameters
from surfuse.settings import NO_BUS, BusSettings
from surfuse.settings.rig_tables import SensorSettings

_SILENCE_S = 10.0
# A sweep without any answer is an error at once: the scan tries the same stop again, and a resumed run goes on there.
_LOST_SWEEPS = 1
_NODES = 7


@dataclass(frozen=True)
class NodeAddress:
    """Where a sensor is on the bus: `node`, and its `number` in it.

    In a cell file both are keys of the sensor's table. By default `node` is `bus.node`, and the numbers of a node's
    sensors are 0, 1, 2... in the order of the file.
    """

    node: int
    number: int


def addresses(sensors: Sequence[SensorSettings], usual_node: int) -> tuple[NodeAddress, ...]:
    """The address of each sensor.

    Raises
    ------
    ConfigError : unknown key, a value out of its limits, or two sensors at one address.
    """
    taken: dict[NodeAddress, str] = {}
    for sensor in sensors:
        unknown = next((key for key in sensor.parameters if key not in ("node", "number")), None)
        if unknown is not None:
            known = ["node", "number", *(name for name in SensorSettings.model_fields if name != "parameters")]
            raise ConfigError(f"sensor '{sensor.name}': unknown key '{unknown}'", cure=nearest(unknown, known))
        node = _whole(sensor, "node", usual_node, 1, _NODES)
        order = sum(address.node == node for address in taken)
        address = NodeAddress(node, _whole(sensor, "number", order, 0, MAX_SENSORS - 1))
        if address in taken:
            raise ConfigError(
                f"the sensors '{taken[address]}' and '{sensor.name}' are both number {address.number} of node {node}",
                cure="give each its own number: the place of its table in the node file, from 0",
            )
        taken[address] = sensor.name
    return tuple(taken)


def _whole(sensor: SensorSettings, key: str, usual: int, low: int, high: int) -> int:
    value = sensor.parameters.get(key, usual)
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise ConfigError(f"sensor '{sensor.name}': {key} = {value!r}", cure=f"give a whole number, {low} to {high}")
    return value


class NodeSensors(OpenedTogether):
    """The sensors of one node; `fixture` (S,) are those in the order of `numbers`, their numbers in the node."""

    def __init__(
        self, fixture: Fixture, bus: BusSettings, node: int, numbers: tuple[int, ...], clock: Clock, together: bool
    ) -> None:
        over, tally = bus_parameters(bus), Tally()
        timeouts = NodeTimeouts(
            silence_limit_s=_SILENCE_S, connect_timeout_s=bus.connect_timeout_s, lost_sweeps_limit=_LOST_SWEEPS
        )
        parameters = Parameters(over, node, numbers, timeouts, together=together)
        self._array = CanArray(fixture, parameters, BusLink(lambda: open_bus(over), clock, tally), clock, tally)
        super().__init__(self._array)

    @property
    def counters(self) -> BusCounters:
        """What happened on the bus so far."""
        return self._array.counters

    def sweep(self) -> Mapping[str, Echo]:
        """All of them, asked for with one trigger."""
        names = [spec.name for spec in self._array.fixture.specs]
        return dict(zip(names, self._array.sweep(), strict=True))


def nodes_of(
    sensors: Sequence[SensorSettings], fixture: Fixture, bus: BusSettings, clock: Clock, together: bool
) -> tuple[NodeSensors, ...]:
    """One source for each node that the sensors name; `fixture` (S,) is theirs, in their order.

    Raises
    ------
    ConfigError : the bus does not leave this process, or an address is wrong.
    """
    if not sensors:
        return ()
    refuse_closed_bus(bus)
    found = addresses(sensors, bus.node)
    rows = {node: [k for k, one in enumerate(found) if one.node == node] for node in sorted({a.node for a in found})}
    return tuple(
        NodeSensors(_part(fixture, of_node), bus, node, tuple(found[k].number for k in of_node), clock, together)
        for node, of_node in rows.items()
    )


def refuse_closed_bus(bus: BusSettings) -> None:
    """Refuse a bus on which no other program can be; a virtual one with a name may have a node in this process.

    Raises
    ------
    ConfigError : names the interface.
    """
    if bus.interface == NO_BUS or (bus.interface == "virtual" and not bus.channel):
        raise ConfigError(
            f"sensors sit behind a node, and bus.interface = '{bus.interface}' reaches none",
            cure="give the bus: [bus] interface = 'socketcan', channel = 'can0'; or 'udp_multicast', 'slcan', ...",
        )


def _part(fixture: Fixture, rows: list[int]) -> Fixture:
    return Fixture(fixture.grip_from_sensor[rows], tuple(fixture.specs[k] for k in rows))


def summed(counters: Iterable[BusCounters]) -> BusCounters:
    """What happened on all buses together."""
    return BusCounters(*(sum(column) for column in zip(*(astuple(one) for one in counters), strict=True)))
