"""The data sheet of a ranger: in the twin before plates, or from a measured log with a mesh of the truth."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from surfuse import __version__, durable
from surfuse.commands.outcome import Outcome, finite
from surfuse.commands.rangers.measured_readings import readings_in_log
from surfuse.errors import ConfigError, DataError, UsageError, nearest
from surfuse.records import ULTRASONIC, FloatArray, SensorSpec
from surfuse.report.line_charts import Chart, Series, page, picture
from surfuse.rig.simulated.ranger_bench import Bench, KnownReadings
from surfuse.rig.simulated.transducer_beam import beam_pattern
from surfuse.runs.side_files import read_sensors
from surfuse.sensors import polaroid

NAMED = {"polaroid": polaroid.SPEC, "polaroid_bare": polaroid.BARE_SPEC}
STANDOFF_M = 0.43
_SPOTS = 16
_PINGS = (1, 2, 3, 5, 8, 12, 20, 31)
_FARTHEST_M = 3.0
_USABLE_SHARE = 0.5
_RIGHT_M = 0.005
_DIRECTIVITY_FLOOR_DB = -60.0


@dataclass(frozen=True)
class Curve:
    """Columns over x: mean error and its standard deviation in mm, and the share of readings with a number."""

    x: tuple[float, ...]
    error_mm: tuple[float, ...]
    spread_mm: tuple[float, ...]
    heard: tuple[float, ...]


@dataclass(frozen=True)
class SensorSheet:
    """All numbers of a data sheet; what does not apply or was not measured is None or empty.

    beam_deg, beam_db : angle from the axis, two-way directivity.
    beam_full_angle_deg : between the -6 dB points of the two-way directivity.
    over_range : facing matte plate, x in m. over_incidence_rough, _smooth : x in degrees at `standoff_m`.
    limit_rough_deg, limit_smooth_deg : largest incidence up to which at least half of the readings have a number.
    nearest_m : nearest facing plate that is read to 5 mm.
    pings, noise_mm : standard deviation of a reading from one place against the pings averaged.
    """

    sensor: str
    kind: str
    source: str
    standoff_m: float
    beam_deg: tuple[float, ...] = ()
    beam_db: tuple[float, ...] = ()
    beam_full_angle_deg: float | None = None
    over_range: Curve | None = None
    over_incidence_rough: Curve | None = None
    over_incidence_smooth: Curve | None = None
    limit_rough_deg: float | None = None
    limit_smooth_deg: float | None = None
    nearest_m: float | None = None
    pings: tuple[int, ...] = ()
    noise_mm: tuple[float, ...] = ()


@dataclass(frozen=True)
class SheetSource:
    """What a sheet is measured from: a log with the true surface (a mesh in the log's frame), else the twin."""

    log: Path | None = None
    truth: Path | None = None
    seed: int | None = None

    def sheet(self, spec: SensorSpec) -> SensorSheet:
        """The sheet of the sensor.

        Raises
        ------
        UsageError : a log without a truth, or the other way round; a seed with a log.
        """
        if (self.log is None) != (self.truth is None):
            raise UsageError("--log and --truth belong together", cure="give both, or none for the twin")
        if self.log is None or self.truth is None:
            return twin_sheet(spec, 1 if self.seed is None else self.seed)
        if self.seed is not None:
            raise UsageError("--seed with --log", cure="only the twin has a seed")
        return log_sheet(spec, self.log, self.truth)


THE_TWIN = SheetSource()


def sensor_sheet(
    name: str,
    table: str | None,
    out: Path | None,
    numbers: Path | None,
    source: SheetSource = THE_TWIN,
    force: bool = False,
) -> Outcome:
    """Make the sheet; `out` is a page (.html) or a picture (.svg), `numbers` a JSON file.

    Raises
    ------
    UsageError, ConfigError, DataError : no such sensor, file or suffix; a log without truth.
    """
    if out is not None and out.suffix.lower() not in (".html", ".svg"):
        raise UsageError(f"--out '{out.name}'", cure="give a name that ends in .html or .svg")
    sheet = source.sheet(spec_of(name, table))
    data = {"surfuse": __version__, **asdict(sheet)}
    if out is not None:
        charts = charts_of(sheet)
        title = f"Sensor sheet: {sheet.sensor}"
        text = picture(charts, title) if out.suffix.lower() == ".svg" else _html(sheet, title, charts)
        durable.write_text(out, text, overwrite=force)
    if numbers is not None:
        durable.write_text(numbers, json.dumps(finite(data), indent=2) + "\n", overwrite=force)
    files = [("written", str(path)) for path in (out, numbers) if path is not None]
    return Outcome(data, facts_of(sheet) + files)


def spec_of(name: str, table: str | None = None) -> SensorSpec:
    """A sensor by name, or from a sensors.toml (`table` names one when there are several)."""
    if name in NAMED:
        if table not in (None, name):
            raise UsageError(f"--sensor '{table}' of '{name}'", cure="--sensor chooses a table of a sensors.toml")
        return NAMED[name]
    path = Path(name)
    if path.suffix.lower() != ".toml":
        raise UsageError(f"unknown sensor '{name}'", cure=f"{nearest(name, NAMED)}; or give a sensors.toml")
    specs = {spec.name: spec for spec in read_sensors(path)}
    if table is None and len(specs) == 1:
        return next(iter(specs.values()))
    if table is None or table not in specs:
        raise ConfigError(f"sensor '{table}'", where=name, cure=f"--sensor: {nearest(table or '', specs)}")
    return specs[table]


def twin_sheet(spec: SensorSpec, seed: int = 1) -> SensorSheet:
    """Measure a sensor in the twin, as its spec describes it."""
    nearest_m = _nearest(spec, seed)
    low = max(spec.range_min_m, nearest_m or 0.0, spec.dead_length_m) + 0.01
    high = min(spec.range_max_m, max(_FARTHEST_M, 2.0 * low))
    standoff_m = float(np.clip(max(STANDOFF_M, low), low, 0.98 * spec.range_max_m))
    matte, smooth = Bench(spec, seed=seed), Bench(spec, material="metal", seed=seed)
    tilts = np.arange(0.0, 46.0, 1.5)
    rough_curve = _over_incidence(matte, standoff_m, tilts)
    smooth_curve = _over_incidence(smooth, standoff_m, tilts)
    noise = [matte.measure(standoff_m, 0.0, 64, pings, moving=False).errors_m() for pings in _PINGS]
    beam, distances = beam_pattern(spec), np.linspace(low, high, 25)
    return SensorSheet(
        sensor=spec.name,
        kind=spec.kind,
        source="the twin, 20 degrees Celsius",
        standoff_m=standoff_m,
        beam_deg=beam.beam_deg,
        beam_db=beam.beam_db,
        beam_full_angle_deg=beam.beam_full_angle_deg,
        over_range=_curve(distances, [matte.measure(distance, 0.0, _SPOTS) for distance in distances.tolist()]),
        over_incidence_rough=rough_curve,
        over_incidence_smooth=smooth_curve,
        limit_rough_deg=_limit(rough_curve),
        limit_smooth_deg=_limit(smooth_curve),
        nearest_m=nearest_m,
        pings=_PINGS,
        noise_mm=tuple(1e3 * float(np.std(errors, ddof=1)) if len(errors) > 1 else np.nan for errors in noise),
    )


def log_sheet(spec: SensorSpec, log: Path, truth: Path) -> SensorSheet:
    """What can be told of a sensor from a log of readings of a known surface."""
    known = readings_in_log(spec, log, truth)
    if not len(known.axis_m):
        raise DataError(f"no reading of '{spec.name}' meets the true surface", cure="check frame and unit of the mesh")
    tilt = np.degrees(known.incidence_rad)
    over_incidence = _binned(known, tilt, 2.5)
    return SensorSheet(
        sensor=spec.name,
        kind=spec.kind,
        source=f"{log.name} against {truth.name}, {len(tilt)} readings",
        standoff_m=float(np.median(known.axis_m)),
        over_range=_binned(known, known.axis_m, max(0.01, float(np.ptp(known.axis_m)) / 25.0)),
        over_incidence_rough=over_incidence,
        limit_rough_deg=_limit(over_incidence),
    )


def charts_of(sheet: SensorSheet) -> list[Chart]:
    """The drawings of a sheet; those without numbers are left out."""
    charts = []
    if sheet.beam_deg:
        points = tuple(zip(sheet.beam_deg, sheet.beam_db, strict=True))
        charts.append(Chart("Beam pattern", "angle from the axis, degrees", "two-way, dB", (Series("piston", points),)))
    if sheet.over_range:
        charts.append(_error_chart("Error against range", "distance, m", (("mean", sheet.over_range),)))
    kinds = [("rough", sheet.over_incidence_rough), ("smooth", sheet.over_incidence_smooth)]
    curves = tuple((name, curve) for name, curve in kinds if curve is not None)
    if curves:
        at = f"at {sheet.standoff_m:.2f} m"
        charts.append(_error_chart(f"Error against incidence, {at}", "incidence, degrees", curves))
        shares = tuple(Series(name, tuple(zip(c.x, (100.0 * h for h in c.heard), strict=True))) for name, c in curves)
        charts.append(Chart("Readings with a number", "incidence, degrees", "share, %", shares, (0.0, 100.0)))
    if sheet.pings:
        points = tuple((float(n), noise) for n, noise in zip(sheet.pings, sheet.noise_mm, strict=True))
        charts.append(
            Chart("Noise against averaging", "pings averaged", "sigma, mm", (Series("sigma", points),), (0, 0))
        )
    return charts


def facts_of(sheet: SensorSheet) -> list[tuple[str, str]]:
    """Label and text of the figures that have a number."""
    rows = [("sensor", f"{sheet.sensor}, {sheet.kind}"), ("measured in", sheet.source)]
    if sheet.beam_full_angle_deg is not None:
        rows.append(("beam, full angle at -6 dB two-way", f"{sheet.beam_full_angle_deg:.1f} degrees"))
    if sheet.nearest_m is not None:
        rows.append(("nearest range", f"{sheet.nearest_m:.3f} m"))
    for kind, limit in (("rough", sheet.limit_rough_deg), ("smooth", sheet.limit_smooth_deg)):
        if limit is not None:
            least = "at least " if sheet.over_incidence_rough and limit == sheet.over_incidence_rough.x[-1] else ""
            rows.append((f"detection limit, {kind} plate", f"{least}{limit:.0f} degrees"))
    if sheet.over_range is not None:
        errors = np.array(sheet.over_range.error_mm)
        if np.any(np.isfinite(errors)):
            worst = float(np.nanmax(np.abs(errors)))
            rows.append(("largest mean error, facing plate", f"{worst:.2f} mm"))
    if sheet.noise_mm:
        rows.append(("noise of one ping, of five", f"{sheet.noise_mm[0]:.2f} mm, {sheet.noise_mm[3]:.2f} mm"))
    return rows


def _html(sheet: SensorSheet, title: str, charts: list[Chart]) -> str:
    text = (
        "Errors of an ultrasonic ranger are against the perpendicular distance of the plate from the place where the "
        "beam starts, those of an optical one against the distance along its axis."
    )
    return page(title, text, ("figure", "value"), facts_of(sheet), charts, f"surfuse {__version__}")


def _error_chart(title: str, x_title: str, curves: tuple[tuple[str, Curve], ...]) -> Chart:
    series = []
    for name, curve in curves:
        series.append(Series(name, tuple(zip(curve.x, curve.error_mm, strict=True))))
        series.append(
            Series(
                f"{name}, deviation" if len(curves) > 1 else "standard deviation",
                tuple(zip(curve.x, curve.spread_mm, strict=True)),
            )
        )
    return Chart(title, x_title, "mm", tuple(series), (0.0, 0.0))


def _over_incidence(bench: Bench, standoff_m: float, tilts_deg: FloatArray) -> Curve:
    return _curve(tilts_deg, [bench.measure(standoff_m, float(np.radians(tilt)), _SPOTS) for tilt in tilts_deg])


def _curve(x: FloatArray, known: list[KnownReadings]) -> Curve:
    errors = [1e3 * one.errors_m() for one in known]
    return Curve(
        tuple(x.tolist()),
        tuple(float(np.mean(one)) if len(one) else np.nan for one in errors),
        tuple(float(np.std(one, ddof=1)) if len(one) > 1 else np.nan for one in errors),
        tuple(one.heard for one in known),
    )


def _binned(known: KnownReadings, x: FloatArray, width: float) -> Curve:
    """Curve over bins of x that hold readings."""
    number = np.floor(x / width + 1e-9).astype(np.int64)
    groups = np.unique(number)
    chosen = [known.subset(number == group) for group in groups]
    return _curve(np.asarray((groups + 0.5) * width, dtype=np.float64), chosen)


def _limit(curve: Curve) -> float | None:
    """Largest x up to which, without a gap, at least half of the readings have a number."""
    usable = np.array(curve.heard) >= _USABLE_SHARE
    if not usable[0]:
        return None
    return curve.x[int(np.argmin(usable)) - 1] if not usable.all() else curve.x[-1]


def _nearest(spec: SensorSpec, seed: int) -> float | None:
    """Nearest distance of a facing plate that is read to 5 mm, to 1 mm; limits of the spec are not heeded."""
    bench = Bench(replace(spec, range_min_m=spec.dead_length_m), seed=seed)
    for distance in np.arange(spec.dead_length_m + 0.01, min(1.0, spec.range_max_m), 0.001):
        errors = bench.measure(float(distance), 0.0, 1).errors_m()
        if len(errors) and abs(errors[0]) < _RIGHT_M:
            return float(max(distance, spec.range_min_m)) if spec.kind != ULTRASONIC else float(distance)
    return None
