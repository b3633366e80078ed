"""Maps against truth: scores as numbers, rows of a table, and plain data."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surfuse.commands.judge.truth_files import EDGE_REFINEMENT, TruthFrame, edge_truth, nothing_in_common, read_truth
from surfuse.commands.maps.map_files import map_path, read_map
from surfuse.commands.outcome import Outcome
from surfuse.records import FloatArray, IntArray, Score, SurfaceMap
from surfuse.surface.grids import refined
from surfuse.surface.score import edge_error, error_map, score, share_within
from surfuse.surface.truth import truth_around

STEP_LEAST_M = 0.02
NEAR_M = 0.003


@dataclass(frozen=True)
class MapScore:
    """How far a map is from the truth: errors at the nodes, share of near cells, position of the step's edge.

    `within_3mm` is the share (0 to 1) of the true part's cells whose height is right to 3 mm; `edge_m` the mean signed
    error of a step's position along v (positive: the higher side reaches too far), nan where truth has no step.
    """

    nodes: Score
    within_3mm: float
    edge_m: float

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
    def edge_mm(self) -> float:
        """Error of the step's position, mm."""
        return 1e3 * self.edge_m


def map_score(surface: SurfaceMap, truth: SurfaceMap, fine_truth: SurfaceMap) -> MapScore:
    """Score of a map against truth near its grid, and against finer truth for the edge (see `edge_truth`).

    With no cell in common all errors are nan and `cells` is 0.
    """
    return MapScore(score(surface, truth), share_within(surface, truth, NEAR_M), edge_of(surface, fine_truth))


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
    return map_score(surface, truth, edge_truth(truth_path, surface.grid, scale, frame))


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
    rows = [*score_rows(found.nodes), ("within 3 mm", f"{100.0 * found.within_3mm:.1f} % of the true part")]
    if not math.isnan(found.edge_m):
        summary["edge_mm"] = found.edge_mm
        rows.append(("edge of the step", f"{found.edge_mm:+.1f} mm"))
    return Outcome(summary, rows)


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


def edge_m(surface: SurfaceMap, vertices_m: FloatArray, triangles: IntArray) -> float:
    """Mean signed error of a step's position along v, against a truth mesh; nan where truth has no step."""
    return edge_of(surface, truth_around(vertices_m, triangles, refined(surface.grid, EDGE_REFINEMENT)))


def edge_of(surface: SurfaceMap, truth: SurfaceMap) -> float:
    """The same against a truth map in the part frame of the surface; nan in any other frame."""
    same = np.allclose(truth.grid.world_from_part, surface.grid.world_from_part, rtol=0.0, atol=1e-9)
    return edge_error(surface, truth, "v").bias_m if same and has_step(truth) else float("nan")


def has_step(truth: SurfaceMap) -> bool:
    """Whether truth jumps along v between neighbouring nodes by more than `STEP_LEAST_M`."""
    jump = np.abs(np.diff(np.where(truth.mask, truth.height_m, np.nan), axis=0))
    return bool(np.nanmax(jump, initial=0.0) > STEP_LEAST_M)
