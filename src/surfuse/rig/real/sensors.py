"""The sensors of a real rig: what is known of them, who fires them, and their answers in the order of the cell file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Self

from surfuse import registry
from surfuse.bridge.messages import BridgeReading
from surfuse.bridge.shared import SharedBridge
from surfuse.errors import ConfigError, nearest
from surfuse.geometry.sensor_array import grip_from_sensors
from surfuse.interfaces import Clock, OpenedTogether, RangeSensor, SensorSurroundings
from surfuse.records import Echo, Fixture, SensorSpec, Status
from surfuse.rig.described_sensors import check_directions, described_spec, places
from surfuse.runs.scan_log import AssumedSensor
from surfuse.sensors.polaroid import within_limits
from surfuse.settings.rig_tables import SensorSettings

BRIDGE = "bridge"


def assumed_spec(sensor: SensorSettings) -> SensorSpec:
    """What is taken for a sensor behind a bridge of which the table does not say it."""
    usual = AssumedSensor()
    return SensorSpec(
        sensor.name,
        "ultrasonic",
        usual.range_min_m,
        usual.range_max_m,
        usual.beam_full_angle_rad,
        usual.sigma_m,
    )


def driven(sensor: SensorSettings, clock: Clock) -> RangeSensor:
    """The driver of a sensor, which knows what its table says of the sensor.

    Raises
    ------
    UsageError, ConfigError : no such driver, or its keys are wrong.
    """
    where = f"sensor '{sensor.name}'"
    module = registry.load("sensors", sensor.driver)
    usual = module.create(registry.parameters("sensors", sensor.driver, sensor.parameters, where)).spec
    surroundings = SensorSurroundings(clock, described_spec(sensor, usual))
    made: RangeSensor = module.create(
        registry.parameters("sensors", sensor.driver, sensor.parameters, where, surroundings)
    )
    return made


class RealArray(OpenedTogether):
    """All sensors of a rig: those behind the bridge in one sweep, the others one after the other."""

    def __init__(
        self, sensors: Sequence[SensorSettings], fixture: Fixture, bridge: SharedBridge | None, clock: Clock
    ) -> None:
        self._sensors, self._fixture, self._clock = tuple(sensors), fixture, clock
        self._bridge = bridge
        self._asked = tuple(sensor.name for sensor in sensors if sensor.driver == BRIDGE)
        self._drivers = {sensor.name: driven(sensor, clock) for sensor in sensors if sensor.driver != BRIDGE}
        shared = (bridge,) if bridge is not None and self._asked else ()
        super().__init__(*shared, *self._drivers.values())

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
        if self._bridge is None:
            return
        there = self._bridge.client.hello.sensors
        for name in self._asked:
            if name not in there:
                raise ConfigError(f"the bridge has no sensor '{name}'", cure=nearest(name, there))

    @property
    def fixture(self) -> Fixture:
        """Where the sensors sit, in the frame of the grip."""
        return self._fixture

    def sweep(self) -> tuple[Echo, ...]:
        """One answer a sensor, in the order of the cell file, with offset and scale taken out."""
        answers = self._of_bridge()
        for name, driver in self._drivers.items():
            answers[name] = driver.fire()
        return tuple(
            _corrected(answers.get(sensor.name) or _missing(self._clock.now_s()), sensor, spec)
            for sensor, spec in zip(self._sensors, self._fixture.specs, strict=True)
        )

    def _of_bridge(self) -> dict[str, Echo]:
        if self._bridge is None or not self._asked:
            return {}
        swept = self._bridge.client.sweep(self._asked)
        return {reading.sensor: _echo(reading) for reading in swept.readings}


def array_of(sensors: Sequence[SensorSettings], bridge: SharedBridge | None, clock: Clock) -> RealArray:
    """The array of a cell file.

    Raises
    ------
    ConfigError : no sensors, or sensors that cannot be used; names them.
    """
    if not sensors:
        raise ConfigError("the rig has no sensor", cure="add a [[sensor]] table for each to the cell file")
    check_directions(sensors)
    _check_keys(sensors)
    if bridge is None and any(sensor.driver == BRIDGE for sensor in sensors):
        name = next(sensor.name for sensor in sensors if sensor.driver == BRIDGE)
        raise ConfigError(
            f"sensor '{name}' is read by the bridge, but the arm has none",
            cure="name the sensor's own driver, or give [arm] driver = 'bridge'",
        )
    usual: Mapping[str, SensorSpec] = {
        sensor.name: assumed_spec(sensor) for sensor in sensors if sensor.driver == BRIDGE
    }
    specs = tuple(
        described_spec(sensor, usual[sensor.name]) if sensor.driver == BRIDGE else driven(sensor, clock).spec
        for sensor in sensors
    )
    fixture = Fixture(grip_from_sensors(*places(sensors)), specs)
    return RealArray(sensors, fixture, bridge, clock)


def _check_keys(sensors: Sequence[SensorSettings]) -> None:
    """Refuse drivers that there are not, and keys that nobody reads."""
    drivers = (BRIDGE, *registry.names("sensors"))
    for sensor in sensors:
        if sensor.driver not in drivers:
            cure = nearest(sensor.driver, drivers)
            raise ConfigError(f"sensor '{sensor.name}': there is no driver '{sensor.driver}'", cure=cure)
        if sensor.driver == BRIDGE and sensor.parameters:
            key = next(iter(sensor.parameters))
            cure = nearest(key, [name for name in SensorSettings.model_fields if name != "parameters"])
            raise ConfigError(f"sensor '{sensor.name}': unknown key '{key}'", cure=cure)


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


def _missing(t_s: float) -> Echo:
    return Echo(float("nan"), Status.FAULT, t_s, count=0)


def _corrected(echo: Echo, sensor: SensorSettings, spec: SensorSpec) -> Echo:
    """True range = scale x reading + offset; what then lies outside of the sensor's limits is no measurement."""
    if echo.status is Status.OK and (sensor.scale != 1.0 or sensor.offset_m != 0.0):
        echo = replace(echo, range_m=sensor.scale * echo.range_m + sensor.offset_m)
    return within_limits(echo, spec)
