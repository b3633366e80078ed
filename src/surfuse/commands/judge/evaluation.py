"""Maps against truth: scores as numbers, rows of a table, and plain data."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surfuse.commands.judge.truth_files import TruthFrame, dense_truth, nothing_in_common, read_truth
from surfuse.commands.maps.map_files import map_path, read_map
from surfuse.commands.outcome import Outcome
from surfuse.records import DenseScore, FloatArray, IntArray, Score, SurfaceMap
from surfuse.surface.dense_score import NEAR_M, dense_score, dense_truth_of_mesh
from surfuse.surface.grids import place_in
from surfuse.surface.score import error_map, score, share_within

STEP_LEAST_M = 0.02


@dataclass(frozen=True)
class MapScore:
    """How far a map is from the truth: errors at its nodes, and between them, with the position of the steps' edges.

    `within_3mm` is the share (0 to 1) of the true part's cells whose height is right to 3 mm; `dense` the score
    against truth that is sampled every millimetre.
    """

    nodes: Score
    within_3mm: float
    dense: DenseScore

    @property
    def rmse_mm(self) -> float:
        """Root mean square error, mm."""
        return 1e3 * self.nodes.rmse_m

    @property
    def mae_mm(self) -> float:
        """Mean absolute error, mm."""
        return 1e3 * self.nodes.mae_m

    @property
    def bias_mm(self) -> float:
        """Mean error, map minus truth, mm."""
        return 1e3 * self.nodes.bias_m

    @property
    def p95_mm(self) -> float:
        """95th percentile of the absolute error, mm."""
        return 1e3 * self.nodes.p95_m

    @property
    def coverage(self) -> float:
        """Share (0 to 1) of the true part's cells that have a value."""
        return self.nodes.coverage

    @property
    def cells(self) -> int:
        """Cells where map and truth both have a value."""
        return self.nodes.cells

    @property
    def dense_rmse_mm(self) -> float:
        """Root mean square error with the truth sampled every millimetre and the map interpolated, mm."""
        return 1e3 * self.dense.rmse_m

    @property
    def off_edge_rmse_mm(self) -> float:
        """The same without the places where the truth steps by more than 8 mm within 6 mm, mm."""
        return 1e3 * self.dense.off_edge_rmse_m

    @property
    def within_3_mm(self) -> float:
        """Share (0 to 1) of the true part, sampled every millimetre, whose height is right to 3 mm."""
        return self.dense.within

    @property
    def edge_mm(self) -> float:
        """Error of the position of the steps' edges, mm; positive: the higher side reaches too far; nan: no step."""
        return 1e3 * self.dense.edge_m

    @property
    def edge_m(self) -> float:
        """The same in m."""
        return self.dense.edge_m


def map_score(surface: SurfaceMap, truth: SurfaceMap, fine_truth: SurfaceMap) -> MapScore:
    """Score of a map against truth near its grid, and against the same truth on the dense raster (see `dense_truth`).

    With no cell in common all errors are nan and `cells` is 0. A map on a finer raster than the truth is compared with
    the dense one at its nodes.
    """
    near = truth if place_in(truth.grid, surface.grid) is not None else fine_truth
    return MapScore(score(surface, near), share_within(surface, near, NEAR_M), dense_score(surface, fine_truth))


def have_common_cells(surface: SurfaceMap, truth: SurfaceMap) -> bool:
    """Whether there is a cell where map and truth both have a value."""
    return bool(np.any(np.isfinite(error_map(surface, truth))))


def file_score(
    surface: SurfaceMap, truth_path: Path, scale: float = 1.0, frame: TruthFrame = TruthFrame.AUTO
) -> MapScore:
    """Score of a map against a truth file; `frame`: the one that the truth lies in.

    Raises
    ------
    DataError : the truth cannot be used, or there is no cell in common in that frame.
    """
    truth = read_truth(truth_path, surface.grid, scale, frame)
    if not have_common_cells(surface, truth):
        raise nothing_in_common(truth_path, frame)
    return map_score(surface, truth, dense_truth(truth_path, surface.grid, scale, frame))


def evaluate(surface_path: Path, truth_path: Path, scale: float, frame: TruthFrame = TruthFrame.AUTO) -> Outcome:
    """Error of a map against a mesh or another map; `frame`: the one that the truth lies in.

    Raises
    ------
    DataError : map or truth cannot be used, or they have no cell in common in that frame.
    """
    surface = read_map(surface_path)
    found = file_score(surface, truth_path, scale, frame)
    summary: dict[str, object] = {"map": str(map_path(surface_path)), "truth": str(truth_path)}
    summary |= {**score_data(found.nodes), "method": surface.method, "within_3mm": found.within_3mm}
    summary |= dense_data(found.dense)
    return Outcome(summary, [*score_rows(found.nodes), *dense_rows(found.dense)])


def score_data(found: Score) -> dict[str, object]:
    """A score as plain data, in millimetres."""
    return {
        "rmse_mm": 1e3 * found.rmse_m,
        "mae_mm": 1e3 * found.mae_m,
        "bias_mm": 1e3 * found.bias_m,
        "p95_mm": 1e3 * found.p95_m,
        "coverage": found.coverage,
        "cells": found.cells,
    }


def score_rows(found: Score) -> list[tuple[str, str]]:
    """A score as lines of a table."""
    return [
        ("RMSE", f"{1e3 * found.rmse_m:.2f} mm"),
        ("mean absolute error", f"{1e3 * found.mae_m:.2f} mm"),
        ("bias", f"{1e3 * found.bias_m:+.2f} mm"),
        ("95th percentile", f"{1e3 * found.p95_m:.2f} mm"),
        ("coverage", f"{100.0 * found.coverage:.1f} % of the true part"),
        ("cells", str(found.cells)),
    ]


def dense_data(found: DenseScore) -> dict[str, object]:
    """A dense score as plain data, in millimetres; `edge_mm` only where truth has a step that the map has too."""
    data: dict[str, object] = {
        "dense_rmse_mm": 1e3 * found.rmse_m,
        "off_edge_rmse_mm": 1e3 * found.off_edge_rmse_m,
        "within_3_mm": found.within,
    }
    return data if math.isnan(found.edge_m) else {**data, "edge_mm": 1e3 * found.edge_m}


def dense_rows(found: DenseScore) -> list[tuple[str, str]]:
    """A dense score as lines of a table."""
    rows = [
        ("dense RMSE", f"{1e3 * found.rmse_m:.2f} mm, truth sampled every millimetre"),
        ("off the edges", f"{1e3 * found.off_edge_rmse_m:.2f} mm, without the places within a step"),
        ("within 3 mm", f"{100.0 * found.within:.1f} % of the true part"),
    ]
    return rows if math.isnan(found.edge_m) else [*rows, ("edge of the step", f"{1e3 * found.edge_m:+.1f} mm")]


def mesh_dense_score(surface: SurfaceMap, vertices_m: FloatArray, triangles: IntArray) -> DenseScore:
    """Dense score against a truth mesh: `vertices_m` (V, 3) in the world, `triangles` (F, 3)."""
    return dense_score(surface, dense_truth_of_mesh(vertices_m, triangles, surface.grid))


def has_step(truth: SurfaceMap) -> bool:
    """Whether truth jumps along v between neighbouring nodes by more than `STEP_LEAST_M`."""
    jump = np.abs(np.diff(np.where(truth.mask, truth.height_m, np.nan), axis=0))
    return bool(np.nanmax(jump, initial=0.0) > STEP_LEAST_M)
