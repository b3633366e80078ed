"""Dominant points of a contour: candidates by splitting, then selection by slope, then placement by least squares."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError, DataError
from surfuse.records import FloatArray, IntArray
from surfuse.vision.dominant_points.chords import Curve, running_sums
from surfuse.vision.dominant_points.order import shape_order
from surfuse.vision.dominant_points.refinement import refined, resized
from surfuse.vision.dominant_points.selection import Corner, repaired, selected, turns
from surfuse.vision.dominant_points.splitting import candidates

_SLACK = 1e-10
_REPAIRS = 3
_RESELECTIONS = 3


@dataclass(frozen=True)
class DominantPointParameters:
    """How closely dominant points follow a contour.

    `tolerance_px`: largest distance of a contour point to the polygon, the one scale of the method;
    `corner_rad`: a change of the fitted slope that makes a corner, kept even where the tolerance does not need it;
    `spacing_px`: closest corners (0: twice the tolerance); `rounds`: limit of the placement's work.
    """

    tolerance_px: float = 1.0
    corner_rad: float = math.radians(30.0)
    spacing_px: float = 0.0
    rounds: int = 4

    def __post_init__(self) -> None:
        if not (self.tolerance_px > 0.0 and math.isfinite(self.tolerance_px)):
            raise ConfigError(f"tolerance_px = {self.tolerance_px}", cure="give a distance > 0, in pixels")
        if not 0.0 < self.corner_rad <= math.pi:
            raise ConfigError(f"corner_deg = {math.degrees(self.corner_rad):g}", cure="give 0 < angle <= 180")
        if not (self.spacing_px >= 0.0 and math.isfinite(self.spacing_px)):
            raise ConfigError(f"spacing_px = {self.spacing_px}", cure="give a distance >= 0, in pixels")
        if self.rounds < 0:
            raise ConfigError(f"rounds = {self.rounds}", cure="give a count >= 0")


@dataclass(frozen=True)
class DominantPoints:
    """Dominant points of one contour: `indices` (K,) into it, increasing; `points_px` (K, 2); `turn_rad` (K,).

    `candidates` (C,) are the indices that splitting proposed. `turn_rad` is the change of the fitted slope.
    """

    indices: IntArray
    points_px: FloatArray
    turn_rad: FloatArray
    candidates: IntArray


def dominant_points(
    contour_px: FloatArray,
    parameters: DominantPointParameters | None = None,
    *,
    closed: bool = True,
    n_points: int | None = None,
    row_scale: float = 1.0,
) -> DominantPoints:
    """Dominant points of a contour (N, 2), its last point not repeated when it is closed.

    With `n_points` there are exactly so many and the tolerance only sets the candidates; without it, as many as
    tolerance and corners ask for. `row_scale` is the height of a pixel by its width, so that lengths and slopes are
    those of the part; lengths are counted in columns. The result depends on the shape, not on start point, direction,
    place or scale (when the tolerance is scaled too).

    Raises
    ------
    DataError : fewer than 3 points (2 when open), a value that is not finite, or `n_points` out of reach.
    """
    chosen = parameters or DominantPointParameters()
    contour = _checked(contour_px, closed, n_points)
    n = len(contour)
    square = contour * [1.0, row_scale]
    order = shape_order(square, closed)
    points = square[order] - square.mean(axis=0)
    points = np.concatenate([points, points]) if closed else points
    curve = Curve(points, running_sums(points), n, closed)
    scale2 = float(np.mean(points**2))
    slack, slack2 = _SLACK * math.sqrt(scale2), _SLACK * scale2
    found = candidates(curve, chosen.tolerance_px, slack)
    if closed and len(found) < 3:
        found = resized(curve, found, 3, slack2)
    if n_points is None:
        vertices = _within_tolerance(curve, found, chosen, slack, slack2)
    else:
        vertices = resized(curve, found, n_points, slack2)
        vertices = np.sort(refined(curve, vertices, found, slack2, chosen.rounds))
    turn_rad = turns(curve, vertices)
    indices = order[vertices]
    rank = np.argsort(indices)
    return DominantPoints(indices[rank], contour[indices[rank]], turn_rad[rank], np.sort(order[found]))


def _within_tolerance(
    curve: Curve,
    found: IntArray,
    chosen: DominantPointParameters,
    slack: float,
    slack2: float,
) -> IntArray:
    """Select by slope and place, again while that spares points, then add points where the tolerance is not kept."""
    tolerance = chosen.tolerance_px
    corner = Corner(tolerance, chosen.corner_rad, chosen.spacing_px or 2.0 * tolerance, slack)
    vertices = selected(curve, found, corner)
    for _ in range(_RESELECTIONS):
        placed = np.sort(refined(curve, vertices, found, slack2, 0))
        fewer = selected(curve, placed, corner)
        if len(fewer) == len(placed):
            break
        vertices = fewer
    for _ in range(_REPAIRS):
        placed = np.sort(refined(curve, vertices, found, slack2, chosen.rounds))
        vertices = repaired(curve, placed, tolerance, slack)
        if len(vertices) == len(placed):
            break
    return vertices


def _checked(contour_px: FloatArray, closed: bool, n_points: int | None) -> FloatArray:
    contour = np.ascontiguousarray(contour_px, dtype=np.float64)
    least = 3 if closed else 2
    if contour.ndim != 2 or contour.shape[1] != 2 or len(contour) < least:
        raise DataError(
            f"a contour of shape {contour.shape} has no dominant points", cure=f"give at least {least} points x, y"
        )
    if not np.all(np.isfinite(contour)):
        raise DataError("the contour has points that are not finite", cure="remove them")
    if n_points is not None and not least <= n_points <= len(contour):
        raise DataError(
            f"{n_points} dominant points asked for on a contour of {len(contour)}",
            cure=f"ask for {least} to {len(contour)}",
        )
    return contour


__all__ = ["DominantPointParameters", "DominantPoints", "dominant_points"]
