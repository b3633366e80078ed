"""What is to be estimated from what: stations, tables of their sensors, raster; and the arrivals over a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.beam_model.echo.arrivals import MIRROR, NONE, RIM, Cells, Hearing, Surface, predict
from surfuse.beam_model.echo.detector import LEVELS, OFF_AXIS, TILTS, BeamTable, half_plane
from surfuse.beam_model.echo.free_space import carve
from surfuse.beam_model.echo.loudness import Strength, loudest
from surfuse.beam_model.heard.stations import Stations
from surfuse.beam_model.heard.wavefronts import Surfels, find_surfels
from surfuse.beam_model.prior.raster import Raster, slopes, tangents
from surfuse.beam_model.prior.smoothness import Plate, plate
from surfuse.records import BoolArray, FloatArray, IntArray

ANGLE_STEP = float(OFF_AXIS[1])
DIFFRACTION_STEP = 0.02
DIFFRACTION = half_plane(np.arange(0.0, 12.0, DIFFRACTION_STEP) / 2.0, np.ones(1), 1.0)
# Row of the tables (20 degrees) that stands for a tilted matte patch.
TYPICAL = 8
# Speckle that competes with an earlier mirror-like echo, as a share of its own peak.
MURMUR = 0.8
MODEL_ERROR_M = 0.0001
# Degrees of freedom of the residuals' heavy-tailed distribution.
TAIL = 4.0
# Information of a station beside the part, and of a rim about the height of its cell.
OFF_PART = 0.05
RIM_SHARE = 0.05
# Logarithm of amplitude over prediction that means nothing, its deviation beyond that, and the most that it can cost.
LOUD_SLACK = 0.7
LOUD_SIGMA = 0.5
LOUD_MOST = 3.0


@dataclass(frozen=True)
class Arrivals:
    """What every station should hear over one surface: M rows.

    `range_m` (inf: nothing), `gain` d range / d height of the cell, `scatter_m` of the model; `kind`,
    `row`, `column` of what is heard.

    Columns (M,), ranges and scatter in m. Row and column are -1 where nothing is heard, and those of the cell that the
    echo comes from elsewhere; a station's range changes by `gain` times the change of that cell's height.
    """

    range_m: FloatArray
    gain: FloatArray
    scatter_m: FloatArray
    kind: IntArray
    row: IntArray
    column: IntArray


@dataclass(frozen=True)
class Estimation:
    """Stations and raster; `level` (M,) logarithm of amplitude over threshold, nan where unknown.

    `weight` (M,) is the share of its information that a station is given: less where its axis misses the part, because
    it then hears a rim whose shape and place inside a cell the raster does not hold; and less where it shares no
    wavefront with its neighbours, because the speckle that they hear is partly the same. The share depends on what was
    heard and not on what is believed, so that explanations can be compared. `surfels` are the oriented points.

    `tables` has one entry a kind of sensor, `plate` is the prior over the raster, `spacing_m` the distance between
    neighbouring places.
    """

    stations: Stations
    tables: tuple[BeamTable, ...]
    raster: Raster
    plate: Plate
    spacing_m: float
    level: FloatArray
    weight: FloatArray
    surfels: Surfels


def problem(stations: Stations, tables: tuple[BeamTable, ...], raster: Raster, spacing_m: float) -> Estimation:
    """Put a problem together.

    `level` is ln(amplitude / threshold of the sensor's kind). `tables` has one entry for each index in `stations.spec`;
    `spacing_m` is the distance between neighbouring own-axis points, see `spacing`.
    """
    threshold = np.array([table.threshold for table in tables])[stations.spec]
    with np.errstate(invalid="ignore", divide="ignore"):
        level = np.log(stations.amplitude / threshold)
    middle = stations.position_m + stations.axis * stations.range_m[:, None]
    steepest = np.array([np.sin(np.arctan(reach(t))) for t in tables])[stations.spec]
    surfels = find_surfels(stations, spacing_m, steepest)
    weight = np.where(raster.holds(middle), 1.0, OFF_PART) / np.where(
        surfels.coherent, 1.0, crowd(stations, tables, spacing_m)
    )
    return Estimation(stations, tables, raster, plate(raster.domain, raster.g_m), spacing_m, level, weight, surfels)


def crowd(stations: Stations, tables: tuple[BeamTable, ...], spacing_m: float) -> FloatArray:
    """How many neighbours (M,) hear the same speckle: those within its correlation length, for a beam of that width.

    It is 1 + pi (grain / spacing)^2, with the correlation length wavelength / (4 sin(half angle)) of speckle; 1 for
    light.
    """
    grain = np.array([0.0 if t.optical else t.wavelength_m / (4.0 * np.sin(t.half_angle_rad)) for t in tables])
    return np.asarray(1.0 + np.pi * (grain[stations.spec] / max(spacing_m, 1e-4)) ** 2, dtype=np.float64)


def reach(table: BeamTable) -> float:
    """Tangent of the largest off-axis angle at which anything but speckle can be heard."""
    audible = np.nonzero(table.directivity > table.threshold)[0]
    return float(np.tan(min(OFF_AXIS[audible[-1]] if len(audible) else 0.0, 1.6 * table.half_angle_rad)))


def hearing(table: BeamTable) -> Hearing:
    """A table as the kernels take it."""
    return Hearing(
        mirror=table.mirror,
        rim_wave=table.rim,
        diffraction=DIFFRACTION,
        angle_step=ANGLE_STEP,
        diffraction_step=DIFFRACTION_STEP,
        tilts=TILTS,
        levels=LEVELS,
        speckle=table.speckle_m,
        scatter=table.scatter_m,
        threshold=table.threshold,
        rise=table.rise_m,
        wavelength=table.wavelength_m,
        reach=reach(table),
        diffuse=table.rim_speckle,
        murmur=float(MURMUR * table.level[TYPICAL]),
        grain=float(table.scatter_m[TYPICAL, -1]),
        optical=table.optical,
    )


def _cells(raster: Raster) -> Cells:
    return Cells(raster.domain, raster.u0_m, raster.v0_m, raster.g_m)


def arrivals(p: Estimation, height: FloatArray, crease_m: float, only: BoolArray | None = None) -> Arrivals:
    """First arrivals at all stations, or at those marked by `only`, over a surface (R, C).

    A drop of more than `crease_m` between cells is a rim.
    """
    s, r = p.stations, p.raster
    su, sv, cu, cv, rim = slopes(height, r.domain, r.g_m, crease_m)
    surface = Surface(height, su, sv, cu, cv, rim, tangents(rim), _cells(r))
    out = np.full((len(s), 3), np.inf)
    station = np.hstack([s.position_m, s.axis])
    cell = np.zeros((len(s), 3), dtype=np.int64)
    chosen = np.ones(len(s), dtype=bool) if only is None else only
    for k, table in enumerate(p.tables):
        rows = np.flatnonzero((s.spec == k) & chosen)
        predict(rows, station, (s.range_m, p.level), surface, hearing(table), out, cell)
    return Arrivals(out[:, 0], out[:, 1], out[:, 2], cell[:, 0], cell[:, 1], cell[:, 2])


def loudness(p: Estimation, height: FloatArray, crease_m: float, only: BoolArray | None = None) -> FloatArray:
    """Cost (M,) of the amplitudes over a surface (R, C), in units of log likelihood; 0 for readings without one.

    Those of stations that `only` (M,) does not mark mean nothing.
    """
    if not np.any(np.isfinite(p.level)):
        return np.zeros(len(p.stations))
    s, r = p.stations, p.raster
    su, sv, cu, cv, rim = slopes(height, r.domain, r.g_m, crease_m)
    surface = Surface(height, su, sv, cu, cv, rim, tangents(rim), _cells(r))
    expected = np.ones(len(s))
    station = np.hstack([s.position_m, s.axis])
    quiet = np.zeros(len(s), dtype=bool)
    chosen = np.ones(len(s), dtype=bool) if only is None else only
    for k, table in enumerate(p.tables):
        murmur = np.maximum(np.interp(OFF_AXIS, TILTS, table.level), table.threshold)
        strength = Strength(np.hypot(table.directivity, murmur), murmur)
        loudest(np.flatnonzero((s.spec == k) & chosen), station, s.range_m, surface, hearing(table), strength, expected)
        quiet |= (s.spec == k) & table.optical
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(np.log(s.amplitude / expected))
    excess = np.maximum(np.where(quiet | ~np.isfinite(off), 0.0, off) - LOUD_SLACK, 0.0) / LOUD_SIGMA
    over = np.where(p.weight > OFF_PART, 1.0, OFF_PART)
    return np.asarray(over * LOUD_MOST * -np.expm1(-0.5 * excess**2 / LOUD_MOST))


def free_space(p: Estimation, trusted: IntArray) -> FloatArray:
    """Height (R, C) above which a cell would have been heard by at least two of the trusted stations (inf: none)."""
    s, r = p.stations, p.raster
    lowest = np.full((*r.shape, 2), np.inf)
    station = np.hstack([s.position_m, s.axis])
    for k, table in enumerate(p.tables):
        if not table.optical:
            carve(trusted[s.spec[trusted] == k], station, s.range_m, _cells(r), hearing(table), lowest)
    return np.where(np.isfinite(lowest[..., 1]), lowest[..., 1], lowest[..., 0])


def deviation(p: Estimation, heard: Arrivals, temper_m: float) -> FloatArray:
    """Standard deviation (M,) of the residuals: timing, model, temper."""
    model = np.where(heard.kind == MIRROR, MODEL_ERROR_M, 0.0)
    variance = p.stations.sigma_m**2 + model**2 + heard.scatter_m**2 + temper_m**2
    return np.asarray(np.sqrt(variance), dtype=np.float64)


def residuals(p: Estimation, heard: Arrivals) -> tuple[FloatArray, FloatArray]:
    """Measured minus predicted range (M,), 0 where nothing is predicted, and where something is (1.0 or 0.0)."""
    known = (heard.kind != NONE) & np.isfinite(heard.range_m)
    return np.where(known, p.stations.range_m - np.where(known, heard.range_m, 0.0), 0.0), known.astype(np.float64)


def misfit(p: Estimation, heard: Arrivals, temper_m: float) -> FloatArray:
    """Minus log likelihood (M,) with heavy tails; a reading that nothing explains costs as much as a gross outlier.

    Student's t with the tail `TAIL`, times the station's share of information; in units of log likelihood.
    """
    sigma = deviation(p, heard, temper_m)
    e, known = residuals(p, heard)
    x = np.where(known > 0.0, (e / sigma) ** 2, 60.0)
    return np.asarray(p.weight * (0.5 * TAIL * np.log1p(x / TAIL) + np.log(sigma / (3.0 * MODEL_ERROR_M))))


def pulls(p: Estimation, heard: Arrivals, height: FloatArray, temper_m: float) -> tuple[FloatArray, FloatArray]:
    """Weights and target heights by cell (R, C): the linearised, robustly weighted observations.

    Weights in 1/m^2, targets in m, both 0 in cells that no station hears. The weights are those of iterated least
    squares for Student's t; a rim counts with the share `RIM_SHARE`, because where it lies in its cell is unknown.
    """
    sigma = deviation(p, heard, temper_m)
    e, known = residuals(p, heard)
    gain = np.maximum(np.abs(heard.gain), 0.2)
    share = p.weight * np.where(heard.kind == RIM, RIM_SHARE, 1.0)
    weight = known * share * (gain / sigma) ** 2 / (1.0 + (e / sigma) ** 2 / TAIL)
    rows, cols = p.raster.shape
    flat = np.where(known > 0.0, heard.row * cols + heard.column, 0)
    total = np.bincount(flat, weights=weight, minlength=rows * cols)
    summed = np.bincount(flat, weights=weight * (height.ravel()[flat] - e / gain), minlength=rows * cols)
    target = np.where(total > 0.0, summed / np.where(total > 0.0, total, 1.0), 0.0)
    return total.astype(np.float64).reshape(rows, cols), target.astype(np.float64).reshape(rows, cols)
