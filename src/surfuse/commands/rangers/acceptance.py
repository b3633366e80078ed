"""Acceptance of a ranger: trials in the twin or from logs, a verdict with limits, and a model of the sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from surfuse import __version__, durable
from surfuse.commands.outcome import Outcome
from surfuse.commands.rangers import acceptance_checks as checks
from surfuse.commands.rangers.acceptance_checks import AcceptanceLimits, Check
from surfuse.commands.rangers.acceptance_trials import STEEPEST_DEG, Trials, log_trials, twin_trials
from surfuse.commands.rangers.sensor_sheet import spec_of
from surfuse.errors import UsageError
from surfuse.records import ULTRASONIC, SensorSpec, Status
from surfuse.report.line_charts import Chart, Series, page
from surfuse.rig.simulated.acceptance_bench import USUAL_MATERIAL, planted
from surfuse.rig.simulated.transducer_beam import two_way_beam_rad
from surfuse.runs.range_correction import RangeCorrection, correction_lines
from surfuse.runs.side_files import exact_degrees, sensors_toml

_LEAST_DISTANCES = 3


@dataclass(frozen=True)
class TrialSource:
    """Where the trials of a ranger come from: a log of a facing plate, else the twin.

    A log holds the plate at the `distances_m`, in their order, and `warm_up` is another log, of a plate that stands
    still from switching on. The twin can have a fault `plant`ed, has a `seed`, and a plate of some `material` that is
    tilted.
    """

    log: Path | None = None
    distances_m: tuple[float, ...] = ()
    warm_up: Path | None = None
    plant: str | None = None
    seed: int | None = None
    material: str | None = None

    def trials(self, spec: SensorSpec) -> Trials:
        """The trials of the sensor.

        Raises
        ------
        UsageError : what belongs to the twin is given with a log, or the other way round.
        """
        if self.log is not None:
            if self.plant is not None:
                raise UsageError("--plant with --log", cure="faults can be planted in the twin only")
            if self.seed is not None:
                raise UsageError("--seed with --log", cure="only the twin has a seed")
            if self.material is not None:
                raise UsageError("--material with --log", cure="the log's plate is what it is")
            return log_trials(spec, self.log, self.distances_m, self.warm_up)
        for option, given in (("--distances", self.distances_m), ("--warm-up", self.warm_up)):
            if given:
                raise UsageError(f"{option} without --log", cure="give the log of a facing plate that it belongs to")
        ranger = planted(spec, self.plant)
        return twin_trials(ranger, 1 if self.seed is None else self.seed, self.material or USUAL_MATERIAL)


THE_TWIN = TrialSource()


def accept(
    name: str,
    table: str | None,
    out: Path | None,
    model: Path | None,
    source: TrialSource = THE_TWIN,
    *,
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
    trials = source.trials(spec)
    results = judge(spec, trials, wanted)
    faults = [check.fault for check in results if not check.passed]
    where = "the twin" if source.log is None else str(source.log)
    data: dict[str, object] = {
        "surfuse": __version__,
        "sensor": spec.name,
        "source": where,
        "passed": not faults,
        "faults": faults,
        "checks": [asdict(check) for check in results],
        "bias_mm": 1e3 * bias_m(spec, trials),
        "usable_incidence_deg": None if trials.usable_rad is None else float(np.degrees(trials.usable_rad)),
        "material": trials.material or None,
        "crosstalk": None if trials.crosstalk is None else trials.crosstalk.tolist(),
    }
    result = "accepted" if not faults else f"refused: {', '.join(faults)}"
    rows = [(check.name, check.text()) for check in results]
    if trials.usable_rad is not None:
        rows.append(("usable up to", usable_text(spec, trials.usable_rad, trials.material)))
    rows.append(("result", result))
    if model is not None:
        durable.write_text(model, model_text(spec, trials), overwrite=force)
    if out is not None:
        intro = f"Result: {result}. Source: {where}. Every check has one limit and names one fault."
        durable.write_text(out, _page(spec, intro, results, trials), overwrite=force)
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


def usable_text(spec: SensorSpec, usable_rad: float, material: str) -> str:
    """The largest usable incidence that was found, beside what the spec says."""
    found = float(np.degrees(usable_rad))
    least = "at least " if found >= STEEPEST_DEG else ""
    says = exact_degrees(spec.incidence_limit_rad)
    return f"{least}{found:.1f} degrees on a plate of '{material}'; the spec says {says}"


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
    """The spec with what was measured: sigma, beam, aperture, and the usable incidence that was found."""
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
        incidence_limit_rad=usable,
    )


def correction(spec: SensorSpec, trials: Trials) -> RangeCorrection:
    """What makes true ranges of the readings: a line through the median error at each distance, slips apart.

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
        return RangeCorrection(-float(middle.mean()))
    slope, offset = np.polyfit(places, middle, 1)
    return RangeCorrection(float(offset), 1.0 + float(slope)).inverse


def model_text(spec: SensorSpec, trials: Trials) -> str:
    """A sensors.toml of what was measured, with the offset and scale by which the ranges of a log are corrected."""
    found = correction(spec, trials)
    table = sensors_toml((measured_model(spec, trials),))
    return table + correction_lines(RangeCorrection(round(found.offset_m, 6), round(found.scale, 6)))


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


def _page(spec: SensorSpec, intro: str, results: Sequence[Check], trials: Trials) -> str:
    rows = [check.cells() for check in results]
    for sender, shares in enumerate([] if trials.crosstalk is None else trials.crosstalk.tolist()):
        changed = ", ".join(f"{100.0 * share:.0f}" for share in shares)
        rows.append((f"cross-talk of sender {sender} with receivers 0 to {len(shares) - 1}", f"{changed} %", "", ""))
    heads = ("check", "measured", "limit", "verdict")
    return page(f"Acceptance: {spec.name}", intro, heads, rows, charts_of(trials), f"surfuse {__version__}")
