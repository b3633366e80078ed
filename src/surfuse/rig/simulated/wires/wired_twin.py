"""The twin of a cell file, each of its devices at the protocol that its driver speaks."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

from surfuse import registry
from surfuse.errors import ConfigError
from surfuse.geometry.sensor_array import grip_from_sensors
from surfuse.interfaces import Clock, RangeSensor
from surfuse.node.catalogue import Catalogue
from surfuse.node.counters import Tally
from surfuse.node.firmware import Node
from surfuse.node.link import BusLink, open_bus
from surfuse.node.responder import NodeIdentity, Responder
from surfuse.records import FloatArray, SensorSpec
from surfuse.rig.described_sensors import described_spec, places
from surfuse.rig.description import bus_parameters
from surfuse.rig.real.node_sensors import addresses, refuse_closed_bus
from surfuse.rig.real.recordings import Recordings
from surfuse.rig.real.sensors import assumed_spec
from surfuse.rig.real.sources import BRIDGE, NODE, driven
from surfuse.rig.simulated.assembly import build_world
from surfuse.rig.simulated.kit_on_a_line import KitOnALine
from surfuse.rig.simulated.wires.frames import encoder
from surfuse.rig.simulated.wires.iio_folder import IioFolder
from surfuse.rig.simulated.wires.paced_clock import PacedClock
from surfuse.rig.simulated.wires.standing_twin import StandingTwin, simulated_ranger
from surfuse.rig.simulated.wires.terminals import TalkingRanger, TerminalKit
from surfuse.rig.simulated.wires.wired_arms import Wire, wired_arm
from surfuse.sensors import iio
from surfuse.settings import Settings
from surfuse.settings.rig_tables import SensorSettings

KIT, IIO, SERIAL = "ranging_kit", "iio", ("a02yyuw", "maxbotix", "tfmini")


@dataclass(frozen=True)
class Wires:
    """How the arm and the sensors, in the order of the cell file, are reached."""

    arm: Wire
    sensors: tuple[Wire, ...]


class WiredTwin:
    """See the module; used in a `with` block, inside of which `wires` says where everything is.

    Parameters
    ----------
    settings : the cell file of a real rig, or of the twin.
    port : of the bridge, where the arm has one; 0: a free one.
    times_faster : how much faster than the real ones the sensors measure and talk.

    Raises
    ------
    UsageError, ConfigError, DataError : the twin does not speak for a device of the file.
    """

    def __init__(self, settings: Settings, port: int = 0, times_faster: float = 1.0) -> None:
        self._settings, self._times_faster = settings, times_faster
        _refuse_unspoken(settings)
        self._clock: Clock = PacedClock(times_faster)
        self.arm = wired_arm(settings, port)
        self._world, _ = build_world(settings, StandingTwin)
        self._grip_from_sensor = grip_from_sensors(*places(settings.sensor))
        self._specs = tuple(_spec(sensor) for sensor in settings.sensor)
        self._open = ExitStack()
        self._wires: dict[str, Wire] = {}

    def __enter__(self) -> Self:
        with ExitStack() as opening:
            opening.enter_context(self.arm)
            folder = Path(opening.enter_context(tempfile.TemporaryDirectory(prefix="surfuse-wires-")))
            for number, sensor in enumerate(self._settings.sensor):
                self._wires[sensor.name] = self._opened(opening, number, sensor, folder)
            self._open_nodes(opening)
            self._open = opening.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.__exit__(kind, error, trace)

    @property
    def wires(self) -> Wires:
        """Where everything is."""
        return Wires(self.arm.wire, tuple(self._wires[sensor.name] for sensor in self._settings.sensor))

    def _opened(self, opening: ExitStack, number: int, sensor: SensorSettings, folder: Path) -> Wire:
        """A device of its own, for sensors that are one."""
        if sensor.driver in SERIAL:
            speaks = encoder(sensor.driver, sensor.parameters)
            period_s = registry.load("sensors", sensor.driver).SPEC.firing_time_s / self._times_faster
            talking = opening.enter_context(TalkingRanger(self._ranger(number), speaks, period_s))
            return Wire(f"{sensor.driver} at {talking.port}", {"port": talking.port})
        if sensor.driver == KIT:
            kit = KitOnALine(self._world, self._specs[number], partial(self._place, number), self._clock)
            terminal = opening.enter_context(TerminalKit(kit))
            return Wire(f"{KIT} at {terminal.port}", {"port": terminal.port})
        if sensor.driver == IIO:
            parameters = registry.parameters("sensors", IIO, sensor.parameters, f"sensor '{sensor.name}'")
            assert isinstance(parameters, iio.Parameters)
            files = IioFolder(self._ranger(number), replace(parameters, folder=folder / sensor.name))
            opening.enter_context(files)
            return Wire(f"{IIO} at {files.folder}", {"folder": str(files.folder)})
        if sensor.driver == NODE:
            bus = bus_parameters(self._settings.bus)
            return Wire(f"{NODE} on {bus.interface} {bus.channel}", {})
        return Wire("read by the bridge", {"driver": BRIDGE})

    def _open_nodes(self, opening: ExitStack) -> None:
        """A node for each address that the sensors name."""
        sensors = self._settings.sensor
        behind = [k for k, sensor in enumerate(sensors) if sensor.driver == NODE]
        if not behind:
            return
        bus = bus_parameters(self._settings.bus)
        found = addresses([sensors[k] for k in behind], self._settings.bus.node)
        for address in sorted({one.node for one in found}):
            numbers = {one.number: k for one, k in zip(found, behind, strict=True) if one.node == address}
            rangers = [self._ranger(numbers[number]) for number in _without_gaps(numbers, address)]
            responder = Responder(rangers, self._clock, NodeIdentity(address, address), Catalogue())
            opening.enter_context(Node(responder, BusLink(lambda: open_bus(bus), self._clock, Tally())))

    def _ranger(self, number: int) -> RangeSensor:
        return simulated_ranger(self._world, self._specs[number], partial(self._place, number), self._clock)

    def _place(self, number: int) -> FloatArray:
        placed: FloatArray = self.arm.world_from_grip() @ self._grip_from_sensor[number]
        return placed


def _refuse_unspoken(settings: Settings) -> None:
    """Refuse sensors whose devices the twin cannot stand for."""
    spoken = (BRIDGE, NODE, IIO, KIT, *SERIAL)
    for sensor in settings.sensor:
        if sensor.driver not in spoken:
            raise ConfigError(
                f"sensor '{sensor.name}': the twin does not speak for driver = '{sensor.driver}'",
                cure=f"take one of {', '.join(spoken)}",
            )
    if any(sensor.driver == NODE for sensor in settings.sensor):
        refuse_closed_bus(settings.bus)


def _spec(sensor: SensorSettings) -> SensorSpec:
    """What the host knows of it."""
    if sensor.driver in (BRIDGE, NODE):
        return described_spec(sensor, assumed_spec(sensor))
    return driven(sensor, PacedClock(1.0), Recordings({})).spec


def _without_gaps(numbers: dict[int, int], node: int) -> Sequence[int]:
    if sorted(numbers) != list(range(len(numbers))):
        raise ConfigError(
            f"node {node} of the twin has the numbers {sorted(numbers)}", cure="number its sensors 0, 1, 2... "
        )
    return range(len(numbers))
