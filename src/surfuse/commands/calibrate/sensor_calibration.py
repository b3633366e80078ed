"""A model of a sensor from scans of known surfaces: a facing plate, a tilted plate, a step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from surfuse import durable
from surfuse.commands.judge.truth_files import truth_mesh
from surfuse.commands.outcome import Outcome
from surfuse.errors import DataError, UsageError
from surfuse.records import FloatArray, IntArray, LateTable, SensorSpec, Status
from surfuse.runs.range_correction import RangeCorrection, correction_lines, corrects
from surfuse.runs.scan_log import ScanLog
from surfuse.runs.scan_source import load_scan
from surfuse.runs.side_files import read_corrections, sensors_toml
from surfuse.surface.beam_fan import BeamView, view
from surfuse.surface.casting import RayCaster
from surfuse.surface.sensor_fit import Capture, Facing, Late, fit_capture, fit_facing, fit_late

TRUTH_NAME, SENSORS_NAME = "truth.ply", "sensors.toml"


@dataclass(frozen=True)
class SensorModel:
    """What the logs determined; None where they did not, `open_questions` says why."""

    specs: tuple[SensorSpec, ...]
    facing: Facing
    late: Late | None
    capture: Capture | None
    open_questions: tuple[str, ...]


@dataclass(frozen=True)
class _Heard:
    """Echoes of all logs together, with what their beams could meet."""

    range_m: FloatArray
    sensor: IntArray
    seen: BeamView


def calibrate_sensor(logs: Sequence[Path], truths: Sequence[Path], out: Path, force: bool) -> Outcome:
    """Fit the model of a sensor to logs of known surfaces and write it as a sensors.toml.

    A log without a mesh in `truths` (in the same order) uses the truth.ply beside it.

    Raises
    ------
    UsageError : more meshes than logs.
    DataError : the logs hold different sensors, or cannot determine offset and sigma; the message says why.
    StorageError : the file exists and `force` is false.
    """
    durable.refuse_existing(out, force)
    scans = [_loaded(log) for log in logs]
    model = fit_model(scans, [truth_mesh(_truth_of(k, logs, truths)) for k in range(len(logs))])
    durable.write_text(out, model_toml(model), overwrite=force)
    summary = _summary(model) | {"logs": [str(log) for log in logs], "model": str(out)}
    return Outcome(summary, [*_rows(model), ("model", str(out))])


def fit_model(scans: Sequence[ScanLog], meshes: Sequence[tuple[FloatArray, IntArray]]) -> SensorModel:
    """The model of the sensors of some scans over meshes in the world frame of their readings."""
    specs = scans[0].readings.specs
    for scan in scans[1:]:
        if [spec.name for spec in scan.readings.specs] != [spec.name for spec in specs]:
            raise DataError("the logs hold different sensors", cure="calibrate the sensors of one rig at a time")
    kinds = sorted({spec.kind for spec in specs})
    if len(kinds) > 1:
        raise DataError(f"the logs hold sensors of the kinds {', '.join(kinds)}", cure="calibrate one kind at a time")
    heard = _gathered(scans, meshes)
    facing = fit_facing(heard.seen, heard.range_m, heard.sensor, len(specs))
    open_questions = [] if math.isfinite(facing.scale) else [_no_scale(facing)]
    offset = np.where(np.isfinite(facing.offset_m), facing.offset_m, float(np.nanmedian(facing.offset_m)))
    for spec, own in zip(specs, facing.offset_m, strict=True):
        if not math.isfinite(own):
            open_questions.append(f"sensor '{spec.name}' has too few facing echoes: it takes the offset of the others")
    scale = facing.scale if math.isfinite(facing.scale) else 1.0
    corrected = (heard.range_m - offset[heard.sensor]) / scale
    late: Late | None = None
    capture: Capture | None = None
    try:
        late = fit_late(heard.seen, corrected)
    except DataError as error:
        open_questions.append(str(error))
    try:
        capture = fit_capture(heard.seen, corrected)
    except DataError as error:
        open_questions.append(str(error))
    return SensorModel(specs, replace(facing, offset_m=offset), late, capture, tuple(open_questions))


def model_toml(model: SensorModel) -> str:
    """The model as a sensors.toml: `fuse` takes offset and scale out of the ranges and believes all the rest."""
    blocks = ["# written by 'surfuse calibrate sensor'; use it with 'surfuse fuse LOG --sensors THIS FILE'\n"]
    blocks += [f"# not determined: {' '.join(text.split())}\n" for text in model.open_questions]
    for k, spec in enumerate(model.specs):
        beam = 2.0 * model.capture.angle_rad if model.capture is not None else spec.beam_full_angle_rad
        own = replace(
            spec, sigma_m=max(model.facing.sigma_m, 1e-6), beam_full_angle_rad=beam, late=late_table(model.late)
        )
        blocks.append(sensors_toml((own,)) + correction_lines(_correction(model.facing, k)))
    return "\n".join(blocks)


def _correction(facing: Facing, k: int) -> RangeCorrection:
    """What makes true ranges of the readings of sensor k; the fit says how the sensor makes readings of ranges."""
    scale = facing.scale if math.isfinite(facing.scale) else 1.0
    return RangeCorrection(float(facing.offset_m[k]), scale).inverse


def late_table(late: Late | None) -> LateTable | None:
    """What was measured on tilt as fusion takes it; None where nothing was."""
    if late is None:
        return None
    return LateTable(tuple(late.tilt_rad.tolist()), tuple(late.bias_m.tolist()), tuple(late.scatter_m.tolist()))


def _loaded(log: Path) -> ScanLog:
    beside = (log if log.is_dir() else log.parent) / SENSORS_NAME
    if beside.is_file() and corrects(read_corrections(beside)):
        raise DataError(
            "the sensors.toml of the log holds a calibration already", where=str(beside), cure="remove offset and scale"
        )
    return load_scan(log)


def _truth_of(k: int, logs: Sequence[Path], truths: Sequence[Path]) -> Path:
    if len(truths) > len(logs):
        raise UsageError(f"{len(truths)} meshes for {len(logs)} logs", cure="give one --truth for each LOG, in order")
    if k < len(truths):
        return truths[k]
    return (logs[k] if logs[k].is_dir() else logs[k].parent) / TRUTH_NAME


def _gathered(scans: Sequence[ScanLog], meshes: Sequence[tuple[FloatArray, IntArray]]) -> _Heard:
    ranges, sensors, views = [], [], []
    for scan, mesh in zip(scans, meshes, strict=True):
        one = scan.readings
        rows = np.flatnonzero((one.status == int(Status.OK)) & np.isfinite(one.range_m))
        ranges.append(one.range_m[rows])
        sensors.append(one.sensor[rows])
        views.append(view(RayCaster(*mesh), one.position_m[rows], one.axis[rows]))
    seen = BeamView(
        np.concatenate([one.axis_range_m for one in views]),
        np.concatenate([one.incidence_rad for one in views]),
        np.concatenate([one.nearest_m for one in views]),
        np.concatenate([one.flat for one in views]),
    )
    return _Heard(np.concatenate(ranges), np.concatenate(sensors), seen)


def _no_scale(facing: Facing) -> str:
    sigma = f"{100 * facing.scale_sigma:.2g} %" if math.isfinite(facing.scale_sigma) else "no bound"
    return f"all facing echoes come from about one distance (sigma of the scale: {sigma}), so the scale stays open (1)"


def _summary(model: SensorModel) -> dict[str, object]:
    names = [spec.name for spec in model.specs]
    found: dict[str, object] = {
        "offset_mm": dict(zip(names, (1e3 * model.facing.offset_m).tolist(), strict=True)),
        "scale": model.facing.scale,
        "scale_sigma": model.facing.scale_sigma,
        "sigma_mm": 1e3 * model.facing.sigma_m,
        "facing_echoes": model.facing.echoes,
        "not_determined": list(model.open_questions),
    }
    if model.capture is not None:
        edges = (model.capture.angle_rad, model.capture.low_rad, model.capture.high_rad)
        found["capture_angle_deg"], *interval = (math.degrees(edge) for edge in edges)
        found["capture_interval_deg"] = interval
    if model.late is not None:
        found["late_tilt_deg"] = np.degrees(model.late.tilt_rad).tolist()
        found["late_bias_mm"] = (1e3 * model.late.bias_m).tolist()
        found["late_scatter_mm"] = (1e3 * model.late.scatter_m).tolist()
    return found


def _rows(model: SensorModel) -> list[tuple[str, str]]:
    offsets = ", ".join(f"{1e3 * own:+.2f}" for own in model.facing.offset_m)
    rows = [("offset", f"{offsets} mm"), ("sigma", f"{1e3 * model.facing.sigma_m:.2f} mm, facing")]
    if math.isfinite(model.facing.scale):
        rows.append(("scale", f"{model.facing.scale:.5f} +- {model.facing.scale_sigma:.5f}"))
    if model.capture is not None:
        low, high = math.degrees(model.capture.low_rad), math.degrees(model.capture.high_rad)
        angle = f"{math.degrees(model.capture.angle_rad):.2f} deg ({low:.2f} to {high:.2f})"
        rows.append(("capture angle", f"{angle}, {model.capture.echoes} readings beside a step"))
    if model.late is not None:
        bands = zip(model.late.tilt_rad, model.late.bias_m, model.late.scatter_m, model.late.echoes, strict=True)
        for tilt, bias, scatter, echoes in bands:
            text = f"bias {1e3 * bias:+.2f} mm, scatter {1e3 * scatter:.2f} mm, {echoes} echoes"
            rows.append((f"tilt {math.degrees(tilt):.1f} deg", text))
    return rows + [("not determined", text) for text in model.open_questions]
