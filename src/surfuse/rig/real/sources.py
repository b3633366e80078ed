"""What answers for the sensors of a real rig: the bridge, drivers, nodes; each for some of them, all in one array.

Every source stamps its readings on the clock of the rig, so that those of one sweep can be compared: a bridge with its
own clock, which is then that of the rig; drivers with the rig's clock when they fire; a node with its delay after the
trigger, which the host stamped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, Self

from surfuse import registry
from surfuse.bridge.messages import BridgeReading
from surfuse.bridge.shared import SharedBridge
from surfuse.errors import ConfigError, nearest
from surfuse.interfaces import Clock, Device, OpenedTogether, RangeSensor, SensorSurroundings
from surfuse.records import Echo
from surfuse.rig.described_sensors import described_spec
from surfuse.rig.real.recordings import Recordings
from surfuse.settings.rig_tables import SensorSettings

BRIDGE, NODE = "bridge", "node"


class SensorSource(Device, Protocol):
    """Some sensors that are fired together."""

    def sweep(self) -> Mapping[str, Echo]:
        """One answer a sensor by its name; one that is missing has not answered."""


class BridgeSensors(OpenedTogether):
    """Those that the arm's bridge reads, all in one question."""

    def __init__(self, bridge: SharedBridge, names: Sequence[str]) -> None:
        super().__init__(bridge)
        self._bridge, self._names = bridge, tuple(names)

    def __enter__(self) -> Self:
        super().__enter__()
        try:
            self._check_names()
        except BaseException as error:
            self.__exit__(type(error), error, error.__traceback__)
            raise
        return self

    def _check_names(self) -> None:
        """Refuse sensors that the bridge does not have, before anything moves."""
        there = self._bridge.client.hello.sensors
        for name in self._names:
            if name not in there:
                raise ConfigError(f"the bridge has no sensor '{name}'", cure=nearest(name, there))

    def sweep(self) -> Mapping[str, Echo]:
        """See `SensorSource`."""
        return {reading.sensor: _echo(reading) for reading in self._bridge.client.sweep(self._names).readings}


class DrivenSensor(OpenedTogether):
    """One with a driver of its own."""

    def __init__(self, name: str, sensor: RangeSensor) -> None:
        super().__init__(sensor)
        self._name, self._sensor = name, sensor

    def sweep(self) -> Mapping[str, Echo]:
        """See `SensorSource`."""
        return {self._name: self._sensor.fire()}


def driven(sensor: SensorSettings, clock: Clock, recordings: Recordings) -> RangeSensor:
    """The driver of a sensor, which knows what its table says of the sensor.

    Raises
    ------
    UsageError, ConfigError, DataError : no such driver, its keys are wrong, or its record cannot be read.
    """
    where = f"sensor '{sensor.name}'"
    if sensor.driver == Recordings.DRIVER:
        return recordings.sensor(sensor, clock)
    module = registry.load("sensors", sensor.driver)
    usual = module.create(registry.parameters("sensors", sensor.driver, sensor.parameters, where)).spec
    surroundings = SensorSurroundings(clock, described_spec(sensor, usual))
    made: RangeSensor = module.create(
        registry.parameters("sensors", sensor.driver, sensor.parameters, where, surroundings)
    )
    return made


def _echo(reading: BridgeReading) -> Echo:
    return Echo(
        range_m=reading.range_m,
        status=reading.status,
        t_s=reading.t_s,
        amplitude=reading.amplitude,
        spread_m=reading.spread_m,
        count=reading.count,
        sigma_m=reading.sigma_m,
    )
