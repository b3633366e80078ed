"""The files beside a readings CSV: sensors.toml, frame.toml, outline.csv."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surfuse.errors import ConfigError, DataError
from surfuse.geometry.poses import FloatArray, frame_from_axes
from surfuse.records import LateTable, Outline, SensorSpec
from surfuse.runs.log_files import read_whole
from surfuse.runs.range_correction import CORRECTION_KEY, KEYS_OF_0_1_0, ZONE_KEYS, RangeCorrection, correction_of
from surfuse.runs.toml_file import number, read_toml, refuse_unknown, vector

METRES_LIMIT = 50.0
"""Positions and ranges beyond this are taken for millimetres and refused."""

SENSOR_KEYS = (*KEYS_OF_0_1_0, CORRECTION_KEY, *ZONE_KEYS)
_LATE_KEYS = ("late_tilt_deg", "late_bias_m", "late_scatter_m")


@dataclass(frozen=True)
class DescribedSensor:
    """All that a table of sensors.toml says of a sensor: what it is, and its calibration.

    `correction` is applied to the ranges of the log before they are fused.
    """

    spec: SensorSpec
    correction: RangeCorrection


@dataclass(frozen=True)
class GivenPart:
    """What is known of the part before the readings: its frame (4, 4) and its outline in it (None: unknown)."""

    world_from_part: FloatArray | None = None
    outline: Outline | None = None


def read_described_sensors(path: Path) -> tuple[DescribedSensor, ...]:
    """The sensors of a sensors.toml, one table a sensor, in the order of the file.

    Raises
    ------
    ConfigError : unknown or missing keys, wrong types, no sensor, a scale outside of 0.5 to 2.
    DataError : values outside their limits.
    """
    found = []
    for name, table in read_toml(path).items():
        if not isinstance(table, Mapping):
            raise ConfigError(f"'{name}' is not a table", where=str(path), cure="write one table [name] a sensor")
        found.append(described_sensor(name, table, f"{path}:[{name}]"))
    if not found:
        raise ConfigError("the file names no sensor", where=str(path), cure="write one table [name] a sensor")
    return tuple(found)


def read_sensors(path: Path) -> tuple[SensorSpec, ...]:
    """The specifications alone; see `read_described_sensors`."""
    return tuple(one.spec for one in read_described_sensors(path))


def read_corrections(path: Path) -> tuple[RangeCorrection, ...]:
    """The calibration of each sensor alone, one that changes nothing where the file has none."""
    return tuple(one.correction for one in read_described_sensors(path))


def described_sensor(name: str, table: Mapping[str, object], where: str) -> DescribedSensor:
    """The sensor `name` from the keys of its table; `where` stands before every message.

    Raises
    ------
    ConfigError : unknown or missing keys, wrong types, a scale outside of 0.5 to 2.
    DataError : values outside their limits.
    """
    refuse_unknown(table, SENSOR_KEYS, where)
    try:
        return DescribedSensor(_spec(name, table, where), correction_of(table, where))
    except DataError as error:
        raise DataError(error.what, where=where, cure=error.cure) from error


def _spec(name: str, table: Mapping[str, object], where: str) -> SensorSpec:
    kind = table.get("kind")
    if not isinstance(kind, str) or not kind:
        raise ConfigError(f"kind = {kind!r}", where=where, cure='write for example kind = "ultrasonic"')
    optional = {key: number(table, key, where) for key in ("frequency_hz", "aperture_m") if key in table}
    for key, value in optional.items():
        if not value > 0.0:
            raise ConfigError(f"{key} = {value:g}", where=where, cure="give a value > 0, or leave the key out")
    return SensorSpec(
        name=name,
        kind=kind,
        range_min_m=number(table, "range_min_m", where),
        range_max_m=number(table, "range_max_m", where),
        beam_full_angle_rad=math.radians(number(table, "beam_full_angle_deg", where)),
        sigma_m=number(table, "sigma_m", where),
        incidence_limit_rad=math.radians(number(table, "incidence_limit_deg", where, 25.0)),
        firing_time_s=number(table, "firing_time_s", where, 0.05),
        frequency_hz=optional.get("frequency_hz"),
        aperture_m=optional.get("aperture_m"),
        dead_length_m=number(table, "dead_length_m", where, 0.0),
        late=_late(table, where),
    )


def _late(table: Mapping[str, object], where: str) -> LateTable | None:
    """The measured lateness on tilt; None where the file has none."""
    given = [key for key in _LATE_KEYS if key in table]
    if not given:
        return None
    columns = []
    for key in _LATE_KEYS:
        value = table.get(key)
        if not isinstance(value, list) or not all(
            isinstance(x, int | float) and not isinstance(x, bool) for x in value
        ):
            raise ConfigError(
                f"{key} = {value!r}", where=where, cure=f"give {', '.join(_LATE_KEYS)}, a list of numbers each"
            )
        columns.append(tuple(float(x) for x in value))
    return LateTable(tuple(math.radians(x) for x in columns[0]), *columns[1:])


def read_frame(path: Path) -> FloatArray:
    """`world_from_part` (4, 4) from the keys origin, u and v.

    Raises
    ------
    ConfigError : unknown or missing keys, not three numbers.
    DataError : axes that are zero or parallel.
    """
    return described_frame(read_toml(path), str(path))


def described_frame(table: Mapping[str, object], where: str) -> FloatArray:
    """`world_from_part` (4, 4) from the keys origin, u and v of a table; errors as `read_frame`.

    Raises
    ------
    ConfigError : a key is missing or is no list of three numbers, or the origin looks like millimetres.
    DataError : the axes are zero or parallel.
    """
    refuse_unknown(table, ("origin", "u", "v"), where)
    origin, u, v = (vector(table, key, where) for key in ("origin", "u", "v"))
    if max(map(abs, origin)) > METRES_LIMIT:
        raise ConfigError(f"origin = {list(origin)} looks like millimetres", where=where, cure="give metres")
    try:
        return frame_from_axes(origin, u, v)
    except DataError as error:
        raise DataError(error.what, where=where, cure=error.cure) from error


def read_outline(path: Path, world_from_part: FloatArray) -> Outline:
    """The part's outline from a CSV with the columns u and v, in metres, made counter-clockwise.

    `world_from_part` (4, 4) is the part frame in which u and v are meant.

    Raises
    ------
    DataError : other columns, text, values that are not finite or look like millimetres, fewer than 3 vertices.
    """
    try:
        text = read_whole(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"byte {error.start} is not UTF-8", where=str(path), cure="save the file as UTF-8") from error
    rows = csv.reader(io.StringIO(text, newline=""))
    try:
        header = [name.strip() for name in next(rows, [])]
        if sorted(header) != ["u", "v"]:
            shown = ",".join(header)[:60]
            raise DataError(f"the columns are '{shown}'", where=str(path), cure="an outline has the columns u,v")
        vertices = [_vertex(row, header, f"{path}:{rows.line_num}") for row in rows if row]
    except csv.Error as error:
        raise DataError(f"not a CSV file: {error}", where=f"{path}:{rows.line_num}") from error
    return described_outline(vertices, world_from_part, str(path))


def described_outline(vertices: list[tuple[float, float]], world_from_part: FloatArray, where: str) -> Outline:
    """The outline through finite vertices (u, v) in metres, made counter-clockwise; a last one like the first is left.

    Raises
    ------
    DataError : fewer than 3 vertices, or no area.
    """
    if len(vertices) > 1 and vertices[0] == vertices[-1]:
        vertices = vertices[:-1]
    if len(vertices) < 3:
        raise DataError(f"the outline has {len(vertices)} vertices", where=where, cure="give at least 3")
    points = np.array(vertices)
    u, v = points.T
    twice_area = float(np.sum(u * np.roll(v, -1) - np.roll(u, -1) * v))
    if twice_area == 0.0:
        raise DataError("the outline has no area", where=where, cure="give vertices around the part")
    return Outline(vertices_m=points if twice_area > 0.0 else points[::-1], world_from_part=world_from_part)


def read_part(frame: Path | None, outline: Path | None) -> GivenPart:
    """The part frame and the outline of the files that there are.

    Raises
    ------
    DataError, ConfigError : a file cannot be used, or an outline comes without a frame.
    """
    if frame is None:
        if outline is not None:
            raise DataError("an outline without a part frame", where=str(outline), cure="add frame.toml beside it")
        return GivenPart()
    world_from_part = read_frame(frame)
    return GivenPart(world_from_part, None if outline is None else read_outline(outline, world_from_part))


def _vertex(row: list[str], header: list[str], where: str) -> tuple[float, float]:
    if len(row) != 2:
        raise DataError(f"{len(row)} values instead of 2", where=where, cure="give u,v in each line")
    values = {}
    for name, cell in zip(header, row, strict=True):
        try:
            values[name] = float(cell if cell.isascii() and "_" not in cell else "text")
        except ValueError as error:
            raise DataError(f"'{cell[:40]}' is not a number", where=f"{where}:{name}", cure="give metres") from error
        if not math.isfinite(values[name]):
            raise DataError(f"{cell} is not finite", where=f"{where}:{name}", cure="give metres")
        if abs(values[name]) > METRES_LIMIT:
            raise DataError(f"{cell} looks like millimetres", where=f"{where}:{name}", cure="divide by 1000")
    return values["u"], values["v"]


def sensors_toml(specs: tuple[SensorSpec, ...]) -> str:
    """Text of a sensors.toml that `read_sensors` reads back."""
    blocks = []
    for spec in specs:
        lines = [
            f"[{json.dumps(spec.name, ensure_ascii=False)}]",
            f"kind = {json.dumps(spec.kind, ensure_ascii=False)}",
            f"beam_full_angle_deg = {exact_degrees(spec.beam_full_angle_rad)!r}",
            f"range_min_m = {float(spec.range_min_m)!r}",
            f"range_max_m = {float(spec.range_max_m)!r}",
            f"sigma_m = {float(spec.sigma_m)!r}",
            f"incidence_limit_deg = {exact_degrees(spec.incidence_limit_rad)!r}",
            f"firing_time_s = {float(spec.firing_time_s)!r}",
        ]
        if spec.dead_length_m > 0.0:
            lines.append(f"dead_length_m = {float(spec.dead_length_m)!r}")
        if spec.frequency_hz is not None:
            lines.append(f"frequency_hz = {float(spec.frequency_hz)!r}")
        if spec.aperture_m is not None:
            lines.append(f"aperture_m = {float(spec.aperture_m)!r}")
        if spec.late is not None:
            lines.append(f"late_tilt_deg = {[exact_degrees(tilt) for tilt in spec.late.tilt_rad]!r}")
            lines.append(f"late_bias_m = {list(spec.late.bias_m)!r}")
            lines.append(f"late_scatter_m = {list(spec.late.scatter_m)!r}")
        blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)


def exact_degrees(angle_rad: float) -> float:
    """Degrees that `math.radians` turns back into exactly this angle where such a number exists."""
    guess = math.degrees(angle_rad)
    for candidate in (round(guess, 9), guess, math.nextafter(guess, math.inf), math.nextafter(guess, -math.inf)):
        if math.radians(candidate) == angle_rad:
            return candidate
    return guess


def frame_toml(world_from_part: FloatArray) -> str:
    """Text of a frame.toml that `read_frame` reads back.

    `world_from_part` (4, 4): origin in m, axes u and v as they are, to the last bit.
    """
    origin, u, v = world_from_part[:3, 3], world_from_part[:3, 0], world_from_part[:3, 1]
    return "".join(f"{key} = {value.tolist()!r}\n" for key, value in (("origin", origin), ("u", u), ("v", v)))


def outline_csv(outline: Outline) -> str:
    """Text of an outline.csv that `read_outline` reads back."""
    return "u,v\n" + "".join(f"{u!r},{v!r}\n" for u, v in outline.vertices_m.tolist())
