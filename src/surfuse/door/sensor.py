"""A range sensor as a caller describes it: the keys of sensors.toml."""

from __future__ import annotations

from dataclasses import dataclass, fields

from surfuse.door.arguments import plain
from surfuse.records import SensorSpec
from surfuse.runs.range_correction import READING_TO_TRUE
from surfuse.runs.side_files import DescribedSensor, described_sensor, exact_degrees


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """What is known of a range sensor; names, units and limits as in sensors.toml.

    `kind` is for example "ultrasonic". `beam_full_angle_deg` is the full angle of the beam, `range_min_m` and
    `range_max_m` what it can measure, `sigma_m` the standard deviation of one reading. `frequency_hz` and `aperture_m`
    (diameter of the face) tell more about an ultrasonic beam. Beyond `incidence_limit_deg` a smooth surface gives no
    echo. The beam starts `dead_length_m` in front of the origin (a tube). `firing_time_s` is the time of one reading.
    The true range is `scale` x reading + `offset_m`; with `range_correction` "true_to_reading" the reading is `scale`
    x true range + `offset_m`. `late_tilt_deg`, `late_bias_m`, `late_scatter_m` (K,) say how it was measured to read
    tilted plates. A zone looks `off_axis_deg` beside the axis of its chip;
    its `distance` is along the "ray" or "perpendicular" to the chip.

    Raises
    ------
    ConfigError, DataError : a value of another type, or outside of its limits.
    """

    kind: str
    beam_full_angle_deg: float
    range_min_m: float
    range_max_m: float
    sigma_m: float
    frequency_hz: float | None = None
    aperture_m: float | None = None
    incidence_limit_deg: float = 25.0
    dead_length_m: float = 0.0
    firing_time_s: float = 0.05
    offset_m: float = 0.0
    scale: float = 1.0
    range_correction: str = READING_TO_TRUE
    late_tilt_deg: tuple[float, ...] | None = None
    late_bias_m: tuple[float, ...] | None = None
    late_scatter_m: tuple[float, ...] | None = None
    off_axis_deg: float = 0.0
    distance: str = "ray"

    def __post_init__(self) -> None:
        described(self, "sensor", "sf.Sensor")


def described(sensor: Sensor, name: str, where: str) -> DescribedSensor:
    """The sensor under a name, as the reader of sensors.toml gives it; `where` stands before every message.

    Raises
    ------
    ConfigError, DataError : a value of another type, or outside of its limits.
    """
    table = {field.name: plain(getattr(sensor, field.name)) for field in fields(sensor)}
    given = {key: list(value) if isinstance(value, tuple) else value for key, value in table.items()}
    return described_sensor(name, {key: value for key, value in given.items() if value is not None}, where)


def sensor_of(spec: SensorSpec) -> Sensor:
    """The sensor of a specification; its calibration is taken out of the readings already."""
    late = spec.late
    return Sensor(
        kind=spec.kind,
        beam_full_angle_deg=exact_degrees(spec.beam_full_angle_rad),
        range_min_m=spec.range_min_m,
        range_max_m=spec.range_max_m,
        sigma_m=spec.sigma_m,
        frequency_hz=spec.frequency_hz,
        aperture_m=spec.aperture_m,
        incidence_limit_deg=exact_degrees(spec.incidence_limit_rad),
        dead_length_m=spec.dead_length_m,
        firing_time_s=spec.firing_time_s,
        late_tilt_deg=None if late is None else tuple(exact_degrees(tilt) for tilt in late.tilt_rad),
        late_bias_m=None if late is None else late.bias_m,
        late_scatter_m=None if late is None else late.scatter_m,
    )
