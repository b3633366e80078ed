"""Large parts in tiles: overlapping rasters that are estimated one by one and pasted together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from surfuse.beam_model.heard.stations import Stations
from surfuse.beam_model.map.layers import layers
from surfuse.beam_model.prior.raster import Raster, slopes
from surfuse.beam_model.search.descent import Solution
from surfuse.beam_model.search.edges import offsets, rivals
from surfuse.beam_model.search.estimation import Estimation
from surfuse.records import BoolArray, ByteArray, FloatArray, IntArray

LARGEST_CELLS = 1700
CORE_CELLS = 24


@dataclass(frozen=True)
class Tile:
    """A part of a raster with its overlap; its cells `rows`, `cols` are kept, and go to `row`, `col`."""

    raster: Raster
    rows: slice
    cols: slice
    row: int
    col: int


@dataclass(frozen=True)
class RasterLayers:
    """The layers of a solution over one raster, all (R, C); `known` marks the cells that have a value.

    Heights and `sigma_m` in m, slopes dw/du and dw/dv, `confidence` in [0, 1], `regime` as in `Regime`; `second_m` is
    the rival height of a cell (nan: none), `second_weight` its probability. `edge_u`, `edge_v`: see `offsets`.
    """

    raster: Raster
    height_m: FloatArray
    slope_u: FloatArray
    slope_v: FloatArray
    sigma_m: FloatArray
    confidence: FloatArray
    count: IntArray
    regime: ByteArray
    known: BoolArray
    second_m: FloatArray
    second_weight: FloatArray
    edge_u: FloatArray
    edge_v: FloatArray


LAYERS = (
    "height_m", "slope_u", "slope_v", "sigma_m", "confidence", "count", "regime", "known", "second_m", "second_weight",
    "edge_u", "edge_v",
)  # fmt: skip


def blank(raster: Raster) -> RasterLayers:
    """A sheet without a value."""
    zero = np.zeros(raster.shape)
    whole, small = zero.astype(np.int64), zero.astype(np.uint8)
    return RasterLayers(raster, zero, zero, zero, zero, zero, whole, small, zero > 1.0, zero * np.nan, zero, zero, zero)


def sheet_of(p: Estimation, solution: Solution, doubt_m: FloatArray | None = None) -> RasterLayers:
    """All layers of a solution; `doubt_m` (R, C) says how far other explanations are from it."""
    su, sv, _, _, _ = slopes(solution.height_m, p.raster.domain, p.raster.g_m, solution.crease_m)
    rest = layers(p, solution, doubt_m)
    second, weight = rivals(p, solution.height_m, solution.stiffness, solution.crease_m)
    # The cell may belong to the other surface: the error would then be the whole step.
    across = np.where(np.isfinite(second), weight * (second - solution.height_m) ** 2, 0.0)
    sigma = np.sqrt(rest.sigma_m**2 + across)
    return RasterLayers(
        p.raster, solution.height_m, su, sv, sigma, rest.confidence, rest.count, rest.regime, p.raster.domain,
        second, weight, *offsets(p, solution.height_m, solution.stiffness, solution.crease_m),
    )  # fmt: skip


def tiles(raster: Raster, overlap: int) -> list[Tile]:
    """One tile for a small raster, else tiles of `CORE_CELLS` with an overlap (cells) on every side."""
    rows, cols = raster.shape
    if np.count_nonzero(raster.domain) <= LARGEST_CELLS:
        return [Tile(raster, slice(0, rows), slice(0, cols), 0, 0)]
    found = []
    tall, wide = -(-rows // CORE_CELLS), -(-cols // CORE_CELLS)
    for j, j1 in _cuts(rows, tall):
        for i, i1 in _cuts(cols, wide):
            if not np.any(raster.domain[j:j1, i:i1]):
                continue
            a, b = max(0, j - overlap), max(0, i - overlap)
            part = raster.domain[a : min(rows, j1 + overlap), b : min(cols, i1 + overlap)]
            own = Raster(raster.u0_m + b * raster.g_m, raster.v0_m + a * raster.g_m, raster.g_m, part)
            found.append(Tile(own, slice(j - a, j1 - a), slice(i - b, i1 - b), j, i))
    return found


def _cuts(length: int, parts: int) -> list[tuple[int, int]]:
    """Borders of nearly equal parts."""
    return [(k * length // parts, (k + 1) * length // parts) for k in range(parts)]


def pasted(sheet: RasterLayers, piece: RasterLayers, tile: Tile) -> RasterLayers:
    """The sheet with the kept cells of one tile's sheet in their place."""
    if piece.raster.shape == sheet.raster.shape:
        return piece
    changed = {}
    for name in LAYERS:
        layer = getattr(sheet, name).copy()
        kept = getattr(piece, name)[tile.rows, tile.cols]
        layer[tile.row : tile.row + kept.shape[0], tile.col : tile.col + kept.shape[1]] = kept
        changed[name] = layer
    return replace(sheet, **changed)


def sparse(stations: Stations, raster: Raster, most: int) -> BoolArray:
    """Stations (M,) such that no cell holds more than `most` of them, evenly taken from each cell."""
    middle = stations.foot_m
    i = np.floor((middle[:, 0] - raster.u0_m) / raster.g_m + 0.5).astype(np.int64)
    j = np.floor((middle[:, 1] - raster.v0_m) / raster.g_m + 0.5).astype(np.int64)
    _, cell, size = np.unique(np.column_stack([i, j]), axis=0, return_inverse=True, return_counts=True)
    cell = cell.ravel()
    order = np.argsort(cell, kind="stable")
    first = np.concatenate([[0], np.cumsum(size)[:-1]])
    rank = np.empty(len(cell), dtype=np.int64)
    rank[order] = np.arange(len(cell)) - first[cell[order]]
    stride = np.maximum(1, -(-size // most))[cell]
    return np.asarray(rank % stride == 0, dtype=np.bool_)
