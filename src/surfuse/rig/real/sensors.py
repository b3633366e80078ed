"""The sensors of a real rig: what is known of them, who fires them, and their answers in the order of the cell file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from surfuse import registry
from surfuse.bridge.messages import BridgeReading
from surfuse.bridge.shared import SharedBridge
from surfuse.errors import ConfigError
from surfuse.geometry.sensor_array import grip_from_sensors
from surfuse.interfaces import Clock, OpenedTogether, RangeSensor, SensorSurroundings
from surfuse.records import Echo, Fixture, FloatArray, LateTable, SensorSpec, Status
from surfuse.runs.scan_log import AssumedSensor
from surfuse.sensors.polaroid import within_limits
from surfuse.settings.rig_tables import SensorSettings

BRIDGE = "bridge"


def places(sensors: Sequence[SensorSettings]) -> tuple[FloatArray, FloatArray]:
    """Positions (S, 3) and unit axes (S, 3) of the sensors in the frame of the tool."""
    axes = np.array([sensor.axis for sensor in sensors], dtype=np.float64)
    return (
        np.array([sensor.position_m for sensor in sensors], dtype=np.float64),
        axes / np.linalg.norm(axes, axis=1)[:, None],
    )


def check_directions(sensors: Sequence[SensorSettings]) -> None:
    """Refuse sensors that look at the tool that carries them.

    Raises
    ------
    ConfigError : names the sensor.
    """
    for sensor in sensors:
        if sensor.axis[2] < 0.0:
            raise ConfigError(
                f"sensor '{sensor.name}': axis = {list(sensor.axis)} looks back at the tool",
                cure="z of the tool points along the beams, towards the part: give an axis with z > 0",
            )


def described_spec(sensor: SensorSettings, usual: SensorSpec) -> SensorSpec:
    """What is known of a sensor: what its table says, else what its driver says of it."""
    beam_rad = None if sensor.beam_full_angle_deg is None else float(np.radians(sensor.beam_full_angle_deg))
    return replace(
        usual,
        name=sensor.name,
        kind=sensor.kind or usual.kind,
        range_min_m=_known(sensor.range_min_m, usual.range_min_m),
        range_max_m=_known(sensor.range_max_m, usual.range_max_m),
        beam_full_angle_rad=_known(beam_rad, usual.beam_full_angle_rad),
        sigma_m=_known(sensor.sigma_m, usual.sigma_m),
        frequency_hz=usual.frequency_hz if sensor.frequency_hz is None else sensor.frequency_hz,
        aperture_m=usual.aperture_m if sensor.aperture_m is None else sensor.aperture_m,
        incidence_limit_rad=float(np.radians(sensor.incidence_limit_deg)),
        firing_time_s=sensor.firing_time_s,
        dead_length_m=sensor.dead_length_m,
        late=_late(sensor) or usual.late,
    )


def _known(given: float | None, usual: float) -> float:
    return usual if given is None else given


def _late(sensor: SensorSettings) -> LateTable | None:
    if not sensor.late_tilt_deg:
        return None
    tilts = tuple(float(tilt) for tilt in np.radians(sensor.late_tilt_deg))
    return LateTable(tilts, tuple(sensor.late_bias_m), tuple(sensor.late_scatter_m))


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


def _echo(reading: BridgeReading) -> Echo:
    return Echo(
        range_m=reading.range_m,
        status=reading.status,
        t_s=reading.t_s,
        amplitude=reading.amplitude,
        sigma_m=reading.sigma_m,
    )


def _missing(t_s: float) -> Echo:
    return Echo(float("nan"), Status.FAULT, t_s, count=0)


def _corrected(echo: Echo, sensor: SensorSettings, spec: SensorSpec) -> Echo:
    """True range = scale x reading + offset; what then lies outside of the sensor's limits is no measurement."""
    if echo.status is Status.OK and (sensor.scale != 1.0 or sensor.offset_m != 0.0):
        echo = replace(echo, range_m=sensor.scale * echo.range_m + sensor.offset_m)
    return within_limits(echo, spec)
