"""Acceptance of a ranger: trials in the twin or from logs, a verdict with limits, and a model of the sensor."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from surfuse import __version__, durable
from surfuse.errors import UsageError, nearest
from surfuse.geometry.poses import pose
from surfuse.pipeline import acceptance_checks as checks
from surfuse.pipeline.acceptance_checks import AcceptanceLimits, Check
from surfuse.pipeline.measured_shots import facing_shots
from surfuse.pipeline.outcome import Outcome, finite
from surfuse.pipeline.ranger_bench import LOOK, Bench, Shots
from surfuse.pipeline.sensor_sheet import STANDOFF_M, spec_of, two_way_beam_rad
from surfuse.records import FloatArray, SensorSpec, Status
from surfuse.report.line_charts import Chart, Series, page
from surfuse.runs.scan_source import load_scan
from surfuse.runs.side_files import RangeCorrection, sensors_toml
from surfuse.world.acoustics.air import AirParameters
from surfuse.world.acoustics.noise import AcousticNoise
from surfuse.world.materials import Material
from surfuse.world.scene import Body, Scene
from surfuse.world.twin import ULTRASONIC, Twin, TwinParameters, transducer_of

FAULTS = ("bias", "noise", "drift", "dropout", "wrong beam", "cycle slips", "cross-talk")
WARM_UP_S = 3600.0
_STEP_M = 0.09
_LEAST_DISTANCES = 3
_SIDE_M = 0.05
_CHANGED_M = 0.005
_EARLY_M, _LATE_M, _USABLE_SHARE = 0.005, 0.02, 0.75


@dataclass(frozen=True)
class Trials:
    """What was tried: a facing plate at several distances with single pings, and what else could be done.

    `warm_up` is a plate that stands still from switching on, `beam_rad` the full -6 dB angle, `usable_rad` the
    largest usable incidence, `crosstalk` (S, S) the share of the receiver's (column) readings that the sender changes.
    """

    facing: Shots
    warm_up: Shots | None = None
    beam_rad: float | None = None
    usable_rad: float | None = None
    crosstalk: FloatArray | None = None


def accept(
    name: str,
    table: str | None,
    out: Path | None,
    model: Path | None,
    *,
    log: Path | None = None,
    distances_m: tuple[float, ...] = (),
    warm_up: Path | None = None,
    plant: str | None = None,
    seed: int = 1,
    limits: AcceptanceLimits | None = None,
    force: bool = False,
) -> Outcome:
    """Try a ranger and judge it; `out` is a page (.html), `model` a sensors.toml with what was measured.

    Raises
    ------
    UsageError, ConfigError, DataError : no such sensor, fault or file; a log without distances.
    """
    spec, wanted = spec_of(name, table), limits or AcceptanceLimits()
    if out is not None and out.suffix.lower() != ".html":
        raise UsageError(f"--out '{out.name}'", cure="give a name that ends in .html")
    if log is not None and plant is not None:
        raise UsageError("--plant with --log", cure="faults can be planted in the twin only")
    if log is None:
        trials = twin_trials(spec, *planted(spec, plant), seed=seed)
    else:
        trials = log_trials(spec, log, distances_m, warm_up)
    results = judge(spec, trials, wanted)
    faults = [check.fault for check in results if not check.passed]
    data: dict[str, object] = {
        "surfuse": __version__,
        "sensor": spec.name,
        "source": "the twin" if log is None else str(log),
        "passed": not faults,
        "faults": faults,
        "checks": [asdict(check) for check in results],
        "bias_mm": 1e3 * bias_m(spec, trials),
        "crosstalk": None if trials.crosstalk is None else trials.crosstalk.tolist(),
    }
    rows = [(check.name, check.text()) for check in results]
    rows.append(("result", "accepted" if not faults else f"refused: {', '.join(faults)}"))
    if model is not None:
        durable.write_text(model, model_text(spec, trials), overwrite=force)
    if out is not None:
        durable.write_text(out, _page(spec, rows, charts_of(trials), data), overwrite=force)
    rows += [("written", str(path)) for path in (out, model) if path is not None]
    return Outcome(data, rows)


def judge(spec: SensorSpec, trials: Trials, limits: AcceptanceLimits | None = None) -> tuple[Check, ...]:
    """All checks of a ranger."""
    wanted = limits or AcceptanceLimits()
    found = checks.residuals(trials.facing, spec)
    expected = two_way_beam_rad(spec) if spec.kind == ULTRASONIC else None
    return (
        checks.bias_check(found, wanted),
        checks.noise_check(found, spec, wanted),
        checks.dropout_check(trials.facing, wanted),
        checks.slip_check(found, wanted),
        checks.drift_check(trials.warm_up, wanted),
        checks.beam_check(trials.beam_rad, expected, wanted),
        checks.incidence_check(trials.usable_rad, spec, wanted),
        checks.crosstalk_check(trials.crosstalk, wanted),
    )


def planted(spec: SensorSpec, fault: str | None) -> tuple[TwinParameters, bool]:
    """Physics with one fault planted, and whether the sensors fire together; None: a good sensor.

    Raises
    ------
    UsageError : no such fault.
    """
    usual = TwinParameters()
    other = transducer_of(spec)
    faulty = {
        None: usual,
        "bias": replace(usual, air=AirParameters(assumed_temperature_c=32.0)),
        "noise": replace(usual, noise=AcousticNoise(timing_m=2e-3)),
        "drift": replace(usual, noise=AcousticNoise(drift_m=5e-3)),
        "dropout": replace(usual, noise=AcousticNoise(dropout=0.2)),
        "wrong beam": replace(usual, transducers={spec.name: replace(other, aperture_m=0.6 * other.aperture_m)}),
        "cycle slips": replace(usual, noise=AcousticNoise(slip=0.2)),
        "cross-talk": usual,
    }
    if fault not in faulty:
        raise UsageError(f"unknown fault '{fault}'", cure=nearest(str(fault), FAULTS))
    return faulty[fault], fault == "cross-talk"


def twin_trials(spec: SensorSpec, physics: TwinParameters, together: bool = False, seed: int = 1) -> Trials:
    """Everything that can be tried, in the twin: first the warm-up, then the rest with a warm sensor."""
    matte, smooth = Bench(spec, physics, seed=seed), Bench(spec, physics, smooth=True, seed=seed)
    low = max(spec.range_min_m, spec.dead_length_m) + 0.02
    standoff_m = float(np.clip(STANDOFF_M, low, 0.98 * spec.range_max_m))
    warm_up = []
    while matte.clock.now_s() < WARM_UP_S:
        warm_up.append(matte.shoot(standoff_m, 0.0, 1, moving=False))
        matte.clock.advance(30.0)
    smooth.clock.advance(WARM_UP_S)
    distances = np.linspace(low, min(1.2, 0.95 * spec.range_max_m), 10)
    facing = [matte.shoot(distance, 0.0, 40, 1, moving=False) for distance in distances.tolist()]
    sound = spec.kind == ULTRASONIC
    return Trials(
        facing=_joined(facing),
        warm_up=_joined(warm_up),
        beam_rad=_beam_rad(smooth, standoff_m) if sound else None,
        usable_rad=_usable_rad(matte, standoff_m),
        crosstalk=_crosstalk(spec, physics, together, standoff_m, seed) if sound else None,
    )


def log_trials(spec: SensorSpec, log: Path, distances_m: tuple[float, ...], warm_up: Path | None) -> Trials:
    """What a log of a facing plate at known distances tells, and one of the warm-up."""
    if not distances_m:
        raise UsageError("--log without --distances", cure="give the distances in metres, in the order of the log")
    facing = facing_shots(load_scan(log).readings, distances_m, spec, str(log))
    if warm_up is None:
        return Trials(facing)
    return Trials(facing, facing_shots(load_scan(warm_up).readings, (STANDOFF_M,), spec, str(warm_up)))


def metres(text: str | None) -> tuple[float, ...]:
    """Distances from `0.4,0.6`.

    Raises
    ------
    UsageError : not numbers between 0 and 50 m.
    """
    try:
        found = tuple(float(word) for word in text.split(",")) if text else ()
    except ValueError as error:
        raise UsageError(f"--distances '{text}'", cure="write for example 0.4,0.6,0.8") from error
    if not all(0.0 < one <= 50.0 for one in found):
        raise UsageError(f"--distances '{text}'", cure="give metres, more than 0 and at most 50")
    return found


def bias_m(spec: SensorSpec, trials: Trials) -> float:
    """Median error of a facing plate over all distances, slips apart."""
    found = checks.residuals(trials.facing, spec)
    kept = found.error_m[found.slips == 0]
    return float(np.median(kept)) if len(kept) else float("nan")


def measured_model(spec: SensorSpec, trials: Trials) -> SensorSpec:
    """The spec with what was measured: sigma, beam, aperture, and an incidence that the spec does not exceed."""
    found = checks.residuals(trials.facing, spec)
    if not np.isfinite(found.sigma_m):
        return spec
    # The spec's beam is scaled: it need not be the -6 dB angle.
    wider = 1.0 if trials.beam_rad is None else trials.beam_rad / two_way_beam_rad(spec)
    usable = spec.incidence_limit_rad if trials.usable_rad is None else trials.usable_rad
    return replace(
        spec,
        sigma_m=max(found.sigma_m, 1e-6),
        beam_full_angle_rad=float(min(spec.beam_full_angle_rad * wider, np.pi)),
        aperture_m=None if spec.aperture_m is None else spec.aperture_m / wider,
        incidence_limit_rad=min(usable, spec.incidence_limit_rad),
    )


def correction(spec: SensorSpec, trials: Trials) -> RangeCorrection:
    """Offset and scale of the ranges: a line through the median error at each distance, slips apart.

    With fewer than three distances the scale is taken for right.
    """
    found = checks.residuals(trials.facing, spec)
    kept = found.slips == 0
    good = trials.facing.status == int(Status.OK)
    distance, error = trials.facing.expected_m[good][kept], found.error_m[kept]
    if not len(error):
        return RangeCorrection()
    places = np.unique(distance)
    middle = np.array([np.median(error[distance == place]) for place in places])
    if len(places) < _LEAST_DISTANCES:
        return RangeCorrection(float(middle.mean()))
    slope, offset = np.polyfit(places, middle, 1)
    return RangeCorrection(float(offset), 1.0 + float(slope))


def model_text(spec: SensorSpec, trials: Trials) -> str:
    """A sensors.toml of what was measured, with the offset and scale by which the ranges of a log are corrected."""
    found = correction(spec, trials)
    table = sensors_toml((measured_model(spec, trials),))
    return f"{table}offset_m = {found.offset_m:.6f}\nscale = {found.scale:.6f}\n"


def charts_of(trials: Trials) -> list[Chart]:
    """Errors of the facing plate over distance, and the warm-up."""
    facing = trials.facing
    good = facing.status == int(Status.OK)
    distances = np.unique(facing.axis_m[good])
    errors = [1e3 * (facing.range_m - facing.expected_m)[good & (facing.axis_m == one)] for one in distances]
    middle = tuple((float(d), float(np.median(e))) for d, e in zip(distances, errors, strict=True))
    spread = tuple((float(d), float(np.std(e))) for d, e in zip(distances, errors, strict=True))
    lines = (Series("median", middle), Series("standard deviation", spread))
    charts = [Chart("Error against distance", "distance, m", "mm", lines, (0.0, 0.0))]
    if trials.warm_up is not None:
        warm = trials.warm_up.subset(trials.warm_up.status == int(Status.OK))
        change = 1e3 * (warm.range_m - np.median(warm.range_m[-max(len(warm.range_m) // 3, 1) :]))
        points = tuple(zip(((warm.t_s - warm.t_s.min(initial=np.inf)) / 60.0).tolist(), change.tolist(), strict=True))
        charts.append(Chart("Warm-up", "minutes", "mm", (Series("range minus that of the warm sensor", points),)))
    return charts


def _joined(shots: list[Shots]) -> Shots:
    names = ("axis_m", "incidence_rad", "expected_m", "range_m", "status", "t_s", "amplitude")
    return Shots(*(np.concatenate([getattr(one, name) for one in shots]) for name in names))


def _beam_rad(smooth: Bench, standoff_m: float) -> float | None:
    """Full angle within which the echo of a mirror is stronger than half: the -6 dB beam."""
    tilts = np.radians(np.arange(0.0, 40.0, 0.25))
    strength = np.array([np.nanmean(np.append(smooth.shoot(standoff_m, tilt, 4).amplitude, 0.0)) for tilt in tilts])
    weak = strength < 0.5 * strength[0]
    if not weak.any() or strength[0] <= 0.0:
        return None
    k = int(np.argmax(weak))
    part = (strength[k - 1] - 0.5 * strength[0]) / (strength[k - 1] - strength[k])
    return float(2.0 * (tilts[k - 1] + part * (tilts[k] - tilts[k - 1])))


def _usable_rad(matte: Bench, standoff_m: float) -> float | None:
    """Largest incidence up to which three of four readings lie between foot and axis, or shortly behind.

    Readings that a facing plate does not answer either are no matter of incidence.
    """
    usable, facing = None, 0.0
    for tilt in np.radians(np.arange(0.0, 42.5, 2.5)).tolist():
        shots = matte.shoot(standoff_m, tilt, 48)
        good = (shots.status == int(Status.OK)) & (shots.range_m > shots.expected_m - _EARLY_M)
        good &= shots.range_m < np.maximum(shots.axis_m, shots.expected_m) + _LATE_M
        share = float(np.mean(good))
        facing = share if usable is None else facing
        if share == 0.0 or share < _USABLE_SHARE * facing:
            break
        usable = tilt
    return usable


def _crosstalk(spec: SensorSpec, physics: TwinParameters, together: bool, near_m: float, seed: int) -> FloatArray:
    """Share (S, S) of the readings of a receiver (column) over a step that a sender (row) changes by over 5 mm."""
    world = Twin(Scene([_sheet(0.0, -1.0, 0.0), _sheet(_STEP_M, 0.0, 1.0)]), physics, seed)
    corners = [(y, z) for z in (-0.5 * _SIDE_M, 0.5 * _SIDE_M) for y in (-0.5 * _SIDE_M, 0.5 * _SIDE_M)]
    specs = [spec] * len(corners)
    shifts = np.linspace(-0.08, 0.08, 17).tolist()
    changed = np.zeros((len(corners), len(corners)))
    for number, shift in enumerate(shifts):
        poses = np.stack([pose(LOOK, [-near_m, y + shift, z]) for y, z in corners])
        for receiver in range(len(corners)):
            alone = _one(world, number, poses[[receiver]], specs[:1], together=False)
            for sender in set(range(len(corners))) - {receiver}:
                both = _one(world, number, poses[[receiver, sender]], specs[:2], together=together)
                differs = not (alone == both or abs(alone - both) < _CHANGED_M)
                changed[sender, receiver] += differs / len(shifts)
    return changed


def _one(world: Twin, number: int, poses: FloatArray, specs: list[SensorSpec], *, together: bool) -> float:
    """The first sensor's reading of one ping, the same random numbers whoever else sends."""
    world.begin("cross-talk", number)
    named = [replace(spec, name=f"{spec.name}{'' if k == 0 else k}") for k, spec in enumerate(specs)]
    if together:
        return float(world.ping_together(poses, named, 1, WARM_UP_S)[0][0, 0])
    first = float(world.ping(poses[0], named[0], 1, WARM_UP_S)[0][0])
    for place, other in zip(poses[1:], named[1:], strict=True):
        world.ping(place, other, 1, WARM_UP_S)
    return first


def _sheet(x: float, y_low: float, y_high: float) -> Body:
    corners = np.array([[x, y_low, -1.0], [x, y_high, -1.0], [x, y_high, 1.0], [x, y_low, 1.0]])
    return Body(corners, np.array([[0, 2, 1], [0, 3, 2]]), Material.PART_SMOOTH, np.eye(4))


def _page(spec: SensorSpec, rows: list[tuple[str, str]], charts: list[Chart], data: dict[str, object]) -> str:
    text = f"Source: {data['source']}. Every check has one limit and names one fault."
    numbers = json.dumps(finite(data["crosstalk"]))
    shown = [*rows, ("cross-talk, sender by receiver", numbers)] if data["crosstalk"] is not None else rows
    return page(f"Acceptance: {spec.name}", text, ("check", "verdict"), shown, charts, f"surfuse {__version__}")
