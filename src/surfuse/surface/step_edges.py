"""Where a map puts the edges of steps, in any direction, against the truth on a fine raster."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter

from surfuse.errors import DataError
from surfuse.records import BoolArray, FloatArray, SurfaceMap

STEP_LEAST_M = 0.008
"""A step is where the truth changes by more than this ..."""

STEP_WITHIN_M = 0.006
"""... within this length."""

SLOPE_LONGEST_M = 0.02
"""Where the truth is that steep over a longer way it is a slope, which has no edge."""

_DIRECTION_M = 0.012  # side of the window whose gradients say how an edge runs
_LEAST_COSINE = 0.5  # a line that meets an edge flatter than 30 degrees says little about its place


@dataclass(frozen=True)
class StepEdges:
    """Signed errors (K,) in m across the edge, one a place where a line of the raster crosses a true edge.

    Positive: the higher side reaches out too far; nan: the map has no such edge on that line. `weight` (K,) is the
    length of edge that a crossing stands for, up to a common factor.
    """

    error_m: FloatArray
    weight: FloatArray

    @property
    def bias_m(self) -> float:
        """Mean signed error along all edges that were found; nan without any."""
        found = np.isfinite(self.error_m)
        return float(np.average(self.error_m[found], weights=self.weight[found])) if np.any(found) else float("nan")

    @property
    def rms_m(self) -> float:
        """Root mean square error along all edges that were found; nan without any."""
        found = np.isfinite(self.error_m)
        if not np.any(found):
            return float("nan")
        return float(np.sqrt(np.average(self.error_m[found] ** 2, weights=self.weight[found])))

    @property
    def found(self) -> float:
        """Share of the length of the true edges that the map has too; nan when truth has none."""
        return float(np.average(np.isfinite(self.error_m), weights=self.weight)) if len(self.error_m) else float("nan")


def step_edges(height_m: FloatArray, truth: SurfaceMap) -> StepEdges:
    """Edges of a map whose heights (R, C) are given at the nodes of the truth, nan where it has none.

    On every line of the raster, along u and along v, each true step (more than `STEP_LEAST_M` within `STEP_WITHIN_M`)
    is looked for at half its height: the map's nearest crossing in the same sense. The way to it, times the cosine
    between line and normal of the edge, is the error. The raster should be no coarser than 1 mm.

    Raises
    ------
    DataError : the heights are not on the nodes of the truth.
    """
    if height_m.shape != truth.grid.shape:
        raise DataError(f"heights {height_m.shape} for a truth on {truth.grid.shape}", cure="interpolate the map first")
    true_m = np.where(truth.mask, truth.height_m, np.nan)
    across_u, across_v = _direction(true_m, truth.grid.u_m, truth.grid.v_m)
    errors: list[tuple[float, float]] = []
    for along_v in (False, True):
        position = truth.grid.v_m if along_v else truth.grid.u_m
        # Lines become rows.
        true, heard, cosine = (true_m.T, height_m.T, across_v.T) if along_v else (true_m, height_m, across_u)
        for k in np.flatnonzero(_stepped(true, position)):
            errors += _errors_on_line(position, true[k], heard[k], cosine[k])
    found = np.array(errors, dtype=np.float64).reshape(-1, 2)
    return StepEdges(found[:, 0] * found[:, 1], found[:, 1])


def crossings(position_m: FloatArray, height_m: FloatArray, level_m: float) -> tuple[FloatArray, FloatArray]:
    """Where a profile (N,) crosses a level between neighbouring values, and +1 where it rises there, -1 where it falls.

    Linear between neighbours; a gap (nan) is not bridged. `position_m` (N,) increasing; both results are (K,) for K
    crossings, in the order of the profile.
    """
    above = np.where(np.isfinite(height_m), (height_m > level_m).astype(np.float64), np.nan)
    change = np.diff(above)
    at = np.flatnonzero(np.isfinite(change) & (change != 0.0))
    share = (level_m - height_m[at]) / (height_m[at + 1] - height_m[at])
    return position_m[at] + share * (position_m[at + 1] - position_m[at]), change[at]


def _half_window(position_m: FloatArray) -> int:
    """Half of `STEP_WITHIN_M` in nodes, at least one."""
    step = float(np.median(np.diff(position_m))) if len(position_m) > 1 else STEP_WITHIN_M
    return max(1, round(0.5 * STEP_WITHIN_M / step))


def _stepped(lines: FloatArray, position_m: FloatArray) -> BoolArray:
    """Which lines (K, N) hold a step (K,)."""
    half = _half_window(position_m)
    jump = np.abs(lines[:, 2 * half :] - lines[:, : -2 * half])
    return np.asarray(np.any(jump > STEP_LEAST_M, axis=1), dtype=np.bool_)


def _errors_on_line(
    position_m: FloatArray, true_m: FloatArray, heard_m: FloatArray, cosine: FloatArray
) -> list[tuple[float, float]]:
    """Way along the line from each true edge to that of the map, positive when the high side is too large; cosine."""
    half = _half_window(position_m)
    jump = np.nan_to_num(true_m[2 * half :] - true_m[: -2 * half])
    sense = np.where(np.abs(jump) > STEP_LEAST_M, np.sign(jump), 0.0)
    ends = np.flatnonzero(np.diff(sense, prepend=0.0, append=0.0))
    found = []
    for first, last in itertools.pairwise(ends):
        if sense[first] == 0.0 or position_m[last - 1] - position_m[first] > SLOPE_LONGEST_M:
            continue
        before, after = first, last - 1 + 2 * half
        level = 0.5 * (true_m[before] + true_m[after])
        at, senses = crossings(position_m[before : after + 1], true_m[before : after + 1], level)
        at = at[senses == sense[first]]
        if len(at) == 0:
            continue
        share = float(cosine[int(np.argmin(np.abs(position_m - at[0])))])
        if share < _LEAST_COSINE:
            continue
        places, heard_senses = crossings(position_m, heard_m, float(level))
        same = places[heard_senses == sense[first]]
        way = same[np.argmin(np.abs(same - at[0]))] - at[0] if len(same) else np.nan
        # Rising along the axis means that the high side lies ahead: too far back is too large.
        found.append((float(-sense[first] * way), share))
    return found


def _direction(true_m: FloatArray, u_m: FloatArray, v_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cosines (R, C), 0 to 1, between the normal of the nearest edge and u, and v."""
    slopes = []
    for axis, nodes in ((1, u_m), (0, v_m)):
        step = np.median(np.diff(nodes)) if len(nodes) > 1 else 1.0
        change = np.nan_to_num(np.diff(true_m, axis=axis))
        padded = np.concatenate([change, np.zeros_like(true_m[:, :1] if axis else true_m[:1])], axis=axis)
        slopes.append(uniform_filter(padded / step, size=max(1, round(_DIRECTION_M / step)), mode="constant"))
    length = np.hypot(*slopes)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.abs(slopes[0]) / length, np.abs(slopes[1]) / length
