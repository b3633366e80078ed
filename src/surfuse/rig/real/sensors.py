"""The sensors of a real rig: what is known of them, who fires them, and their answers in the order of the cell file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from surfuse import registry
from surfuse.bridge.shared import SharedBridge
from surfuse.errors import ConfigError, nearest
from surfuse.geometry.sensor_array import grip_from_sensors
from surfuse.interfaces import Clock, OpenedTogether, RangeSensor
from surfuse.node.counters import BusCounters
from surfuse.records import Echo, Fixture, SensorSpec, Status
from surfuse.rig.described_sensors import check_directions, described_spec, places
from surfuse.rig.real.node_sensors import NodeSensors, nodes_of, summed
from surfuse.rig.real.recordings import Recordings
from surfuse.rig.real.sources import BRIDGE, NODE, BridgeSensors, DrivenSensor, SensorSource, driven
from surfuse.runs.scan_log import AssumedSensor
from surfuse.sensors.polaroid import within_limits
from surfuse.settings import Settings
from surfuse.settings.rig_tables import SensorSettings


def assumed_spec(sensor: SensorSettings) -> SensorSpec:
    """What is taken for a sensor behind a bridge or a node of which the table does not say it."""
    usual = AssumedSensor()
    return SensorSpec(
        sensor.name,
        "ultrasonic",
        usual.range_min_m,
        usual.range_max_m,
        usual.beam_full_angle_rad,
        usual.sigma_m,
    )


class RealArray(OpenedTogether):
    """All sensors of a rig, from any number of sources one after the other; each source fires its own in one sweep."""

    def __init__(
        self, sensors: Sequence[SensorSettings], fixture: Fixture, sources: Sequence[SensorSource], clock: Clock
    ) -> None:
        super().__init__(*sources)
        self._sensors, self._fixture, self._sources, self._clock = tuple(sensors), fixture, tuple(sources), clock

    @property
    def fixture(self) -> Fixture:
        """Where the sensors sit, in the frame of the grip."""
        return self._fixture

    @property
    def has_bus(self) -> bool:
        """Whether some of the sensors sit behind nodes."""
        return any(isinstance(source, NodeSensors) for source in self._sources)

    @property
    def counters(self) -> BusCounters:
        """What happened between this end and all nodes so far."""
        return summed(source.counters for source in self._sources if isinstance(source, NodeSensors))

    def sweep(self) -> tuple[Echo, ...]:
        """One answer a sensor, in the order of the cell file, with offset and scale taken out."""
        answers = {name: echo for source in self._sources for name, echo in source.sweep().items()}
        return tuple(
            _corrected(answers.get(sensor.name) or _missing(self._clock.now_s()), sensor, spec)
            for sensor, spec in zip(self._sensors, self._fixture.specs, strict=True)
        )


def array_of(settings: Settings, bridge: SharedBridge | None, clock: Clock, recordings: Recordings) -> RealArray:
    """The array of a cell file.

    Raises
    ------
    UsageError, ConfigError, DataError : no sensors, or sensors that cannot be used; names them.
    """
    sensors = settings.sensor
    if not sensors:
        raise ConfigError("the rig has no sensor", cure="add a [[sensor]] table for each to the cell file")
    check_directions(sensors)
    _check_keys(sensors, bridge)
    drivers = {
        sensor.name: driven(sensor, clock, recordings) for sensor in sensors if sensor.driver not in (BRIDGE, NODE)
    }
    fixture = Fixture(grip_from_sensors(*places(sensors)), tuple(_spec(sensor, drivers) for sensor in sensors))
    asked = [sensor.name for sensor in sensors if sensor.driver == BRIDGE]
    rows = [k for k, sensor in enumerate(sensors) if sensor.driver == NODE]
    behind = Fixture(fixture.grip_from_sensor[rows], tuple(fixture.specs[k] for k in rows)) if rows else fixture
    sources: list[SensorSource] = [] if bridge is None or not asked else [BridgeSensors(bridge, asked)]
    at_once = settings.array.trigger == "simultaneous"
    sources += nodes_of([sensors[k] for k in rows], behind, settings.bus, clock, at_once)
    sources += [DrivenSensor(name, driver) for name, driver in drivers.items()]
    return RealArray(sensors, fixture, sources, clock)


def _spec(sensor: SensorSettings, drivers: dict[str, RangeSensor]) -> SensorSpec:
    driver = drivers.get(sensor.name)
    return described_spec(sensor, assumed_spec(sensor)) if driver is None else driver.spec


def _check_keys(sensors: Sequence[SensorSettings], bridge: SharedBridge | None) -> None:
    """Refuse drivers that there are not, keys that nobody reads, and sensors of a bridge that there is not."""
    drivers = (BRIDGE, NODE, *registry.names("sensors"))
    for sensor in sensors:
        if sensor.driver not in drivers:
            cure = nearest(sensor.driver, drivers)
            raise ConfigError(f"sensor '{sensor.name}': there is no driver '{sensor.driver}'", cure=cure)
        if sensor.driver == BRIDGE and sensor.parameters:
            key = next(iter(sensor.parameters))
            cure = nearest(key, [name for name in SensorSettings.model_fields if name != "parameters"])
            raise ConfigError(f"sensor '{sensor.name}': unknown key '{key}'", cure=cure)
        if sensor.driver == BRIDGE and bridge is None:
            raise ConfigError(
                f"sensor '{sensor.name}' is read by the bridge, but the arm has none",
                cure="name the sensor's own driver, or give [arm] driver = 'bridge'",
            )


def _missing(t_s: float) -> Echo:
    return Echo(float("nan"), Status.FAULT, t_s, count=0)


def _corrected(echo: Echo, sensor: SensorSettings, spec: SensorSpec) -> Echo:
    """True range = scale x reading + offset; what then lies outside of the sensor's limits is no measurement."""
    if echo.status is Status.OK and (sensor.scale != 1.0 or sensor.offset_m != 0.0):
        echo = replace(echo, range_m=sensor.scale * echo.range_m + sensor.offset_m)
    return within_limits(echo, spec)
