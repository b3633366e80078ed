"""Simulated sensors of a node in a process of its own: the host tells what their twin is and where the arm is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

from surfuse.errors import ConfigError, DeviceError
from surfuse.interfaces import AlwaysOpen, RangeSensor
from surfuse.node.messages import KitMessage
from surfuse.records import Echo, Fixture, FloatArray, SensorSpec
from surfuse.rig.description import array_fixture, array_spec, square_fixture
from surfuse.rig.simulated.assembly import SimulatedClock, array_sensors, build_world, fired_together
from surfuse.rig.simulated.hidden_errors import true_fixture
from surfuse.rig.simulated.kit_by_message import kit_from_message
from surfuse.sensors import simulated
from surfuse.settings import from_tree
from surfuse.twin.simultaneous_array import SimultaneousArray
from surfuse.twin.tether import NodeEnd, Place
from surfuse.twin.world import Twin


class TetheredSensors:
    """Simulated sensors of a twin that the connected host describes, at the place that it tells."""

    def __init__(self) -> None:
        specs = [array_spec(from_tree({}), f"us{index}") for index in range(4)]
        self.sensors = tuple(_Tethered(self, index, spec) for index, spec in enumerate(specs))
        self.clock = SimulatedClock()
        self._world: Twin | None = None
        self._fired: list[RangeSensor] = []
        self._together: SimultaneousArray | None = None
        self._fixture = square_fixture(from_tree({}))
        self._seated = self._fixture
        self._world_from_grip: FloatArray | None = None

    def tether(self, port: int) -> NodeEnd:
        """The end of the tether by which a host tells what the twin is and where the arm is; to be opened."""
        return NodeEnd(port, self.configure, self.move)

    def configure(self, tree: Mapping[str, object]) -> None:
        """Build the host's twin."""
        settings = from_tree(tree, "configuration of the host")
        self._world, _ = build_world(settings)
        self._world_from_grip = None
        self._fixture = array_fixture(settings)
        self._seated = true_fixture(settings, self._fixture)
        self._together = fired_together(settings, self._fixture, self._world, self._grip, self.clock)
        self._fired = list(array_sensors(settings, self._fixture, self._world, self._grip, self.clock))

    def set_kit(self, number: int, told: KitMessage) -> None:
        """Give the kit of one sensor these parameters; the next configuration of a host takes them back."""
        if self._world is None:
            raise DeviceError("no host has said where the sensors are", cure="run `surfuse acquire --node udp`")
        kit = kit_from_message(told, self._world.kit(self._fixture.specs[number]))
        usual = self._fixture.specs[number]
        blanked_m = 0.5 * self._world.assumed_speed_m_s * kit.blanking_s
        spec = replace(usual, frequency_hz=kit.frequency_hz, range_min_m=max(blanked_m, usual.dead_length_m))
        specs = (*self._fixture.specs[:number], spec, *self._fixture.specs[number + 1 :])
        self._fixture = Fixture(self._fixture.grip_from_sensor, specs)
        self._world.set_kit(spec.name, kit)
        rate_hz = kit.sample_rate_hz
        around = simulated.Surroundings(
            clock=self.clock, spec=spec, world=self._world, pose=partial(self._placed, number)
        )
        self._fired[number] = simulated.create(
            simulated.Parameters(told.pings, sample_rate_hz=rate_hz, surroundings=around)
        )
        self._together = SimultaneousArray(
            self._fixture, self._world, self._grip, self.clock, told.pings, rate_hz, self._seated
        )

    def _placed(self, number: int) -> FloatArray:
        placed: FloatArray = self._grip() @ self._seated.grip_from_sensor[number]
        return placed

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

    def fire_together(self, numbers: Sequence[int]) -> Sequence[Echo | None]:
        """One reading of each of these sensors, all at the same moment; None before a host has told all it must."""
        if self._together is None or self._world_from_grip is None:
            return (None,) * len(numbers)
        return self._together.fire_together(numbers)

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
