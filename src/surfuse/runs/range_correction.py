"""The calibration of a sensor's ranges in a sensors.toml, and what it makes of the ranges of a log."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from surfuse.errors import ConfigError, nearest
from surfuse.records import FloatArray, IntArray
from surfuse.runs.toml_file import number

CORRECTION_KEY = "range_correction"
READING_TO_TRUE, TRUE_TO_READING = "reading_to_true", "true_to_reading"
KEYS_OF_0_1_0 = (
    "kind",
    "beam_full_angle_deg",
    "range_min_m",
    "range_max_m",
    "sigma_m",
    "frequency_hz",
    "aperture_m",
    "incidence_limit_deg",
    "dead_length_m",
    "firing_time_s",
    "offset_m",
    "scale",
    "late_tilt_deg",
    "late_bias_m",
    "late_scatter_m",
)
"""The keys of a table that version 0.1.0 knew; it took offset and scale the other way round."""

ALONG, PERPENDICULAR = "ray", "perpendicular"
"""What a zone's number is: the distance along its own direction, or perpendicular to the face of the chip."""

ZONE_KEYS = ("off_axis_deg", "distance")
MOST_OFF_AXIS_DEG = 60.0

_SCALE_LIMITS = (0.5, 2.0)


@dataclass(frozen=True)
class RangeCorrection:
    """Calibration of a sensor's ranges: true range = scale x reading + offset_m.

    A zone looks `off_axis_rad` beside the axis of its chip; `perpendicular` says that its distance is measured along
    that axis and not along the zone. `by_age` : nobody said which way round the file means offset and scale, and its
    keys are those of version 0.1.0.
    """

    offset_m: float = 0.0
    scale: float = 1.0
    off_axis_rad: float = 0.0
    perpendicular: bool = False
    by_age: bool = field(default=False, compare=False)

    @property
    def inverse(self) -> RangeCorrection:
        """The other way round: offset and scale with which the sensor makes a reading of a true range."""
        return replace(self, offset_m=-self.offset_m / self.scale, scale=1.0 / self.scale)

    @property
    def stretch(self) -> float:
        """The distance along the zone over what it measures."""
        return 1.0 / math.cos(self.off_axis_rad) if self.perpendicular else 1.0


def correction_of(table: Mapping[str, object], where: str) -> RangeCorrection:
    """The correction in the table of a sensor, whichever way round it is meant.

    `range_correction` says it: "reading_to_true" is true range = scale x reading + offset_m, "true_to_reading" is
    reading = scale x true range + offset_m. Without it a table with nothing but the keys of version 0.1.0 is read as
    that version meant it, the second way, and any other one the first way.

    Raises
    ------
    ConfigError : wrong types, another word, a scale outside of 0.5 to 2.
    """
    scale, offset_m = number(table, "scale", where, 1.0), number(table, "offset_m", where, 0.0)
    low, high = _SCALE_LIMITS
    if not low <= scale <= high:
        raise ConfigError(f"scale = {scale:g}", where=where, cure=f"give a factor near 1, from {low:g} to {high:g}")
    typed, way = RangeCorrection(offset_m, scale, *_zone(table, where)), table.get(CORRECTION_KEY)
    if way is None:
        old = set(table) <= set(KEYS_OF_0_1_0) and typed != RangeCorrection()
        return replace(typed.inverse, by_age=True) if old else typed
    if way not in (READING_TO_TRUE, TRUE_TO_READING):
        cure = nearest(str(way), (READING_TO_TRUE, TRUE_TO_READING))
        raise ConfigError(f"{CORRECTION_KEY} = {way!r}", where=where, cure=cure)
    return typed if way == READING_TO_TRUE else typed.inverse


def _zone(table: Mapping[str, object], where: str) -> tuple[float, bool]:
    """How far (rad) a zone looks beside the axis of its chip, and whether it measures perpendicular to it."""
    off_axis_deg, distance = number(table, "off_axis_deg", where, 0.0), table.get("distance", ALONG)
    if not 0.0 <= off_axis_deg <= MOST_OFF_AXIS_DEG:
        raise ConfigError(
            f"off_axis_deg = {off_axis_deg:g}", where=where, cure=f"give 0 to {MOST_OFF_AXIS_DEG:g}: zone to chip axis"
        )
    if distance not in (ALONG, PERPENDICULAR):
        raise ConfigError(f"distance = {distance!r}", where=where, cure=f'write "{ALONG}" or "{PERPENDICULAR}"')
    return math.radians(off_axis_deg), distance == PERPENDICULAR


def corrected_m(range_m: FloatArray, sensor: IntArray, corrections: Sequence[RangeCorrection]) -> FloatArray:
    """True ranges (N,) of readings (N,) of sensors (N,); what is no number stays what it is."""
    offset = np.array([one.offset_m for one in corrections])[sensor]
    scale = np.array([one.scale for one in corrections])[sensor]
    stretch = np.array([one.stretch for one in corrections])[sensor]
    return np.asarray(stretch * (scale * range_m + offset), dtype=np.float64)


def corrects(corrections: Sequence[RangeCorrection]) -> bool:
    """Whether any of them says anything of the ranges."""
    return any(one != RangeCorrection() for one in corrections)


def shifts(corrections: Sequence[RangeCorrection]) -> bool:
    """Whether any of them changes a range."""
    return any(one.offset_m != 0.0 or one.scale != 1.0 or one.stretch != 1.0 for one in corrections)


def correction_note(name: str, corrections: Sequence[RangeCorrection]) -> str:
    """What the user should know of the calibration in the file of that name."""
    note = f"{name} holds a calibration: offset and scale are taken out of the ranges"
    if not any(one.by_age for one in corrections):
        return note
    return (
        f"{note}, as reading = scale x true range + offset_m, which is how version 0.1.0 wrote them; "
        f"{CORRECTION_KEY} = '{READING_TO_TRUE}' in the file says true range = scale x reading + offset_m"
    )


def correction_lines(correction: RangeCorrection) -> str:
    """The lines of a table of sensors.toml that say a correction."""
    scale = "" if correction.scale == 1.0 else f"scale = {float(correction.scale)!r}\n"
    return f'{CORRECTION_KEY} = "{READING_TO_TRUE}"\noffset_m = {float(correction.offset_m)!r}\n{scale}'
