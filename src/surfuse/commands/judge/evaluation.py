"""Maps against truth: scores as numbers, rows of a table, and plain data."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from surfuse.commands.judge.truth_files import EDGE_REFINEMENT, TruthFrame, edge_truth, nothing_in_common, read_truth
from surfuse.commands.maps.map_files import map_path, read_map
from surfuse.commands.outcome import Outcome
from surfuse.records import FloatArray, IntArray, Score, SurfaceMap
from surfuse.surface.grids import refined
from surfuse.surface.score import edge_error, score, share_within
from surfuse.surface.truth import truth_around

STEP_LEAST_M = 0.02
NEAR_M = 0.003


def evaluate(surface_path: Path, truth_path: Path, scale: float, frame: TruthFrame = TruthFrame.AUTO) -> Outcome:
    """Error of a map file or run against a mesh or another map; `frame`: the one that the truth lies in.

    Raises
    ------
    DataError : map or truth cannot be used, or they have no cell in common in that frame.
    """
    surface = read_map(surface_path)
    truth = read_truth(truth_path, surface.grid, scale, frame)
    found = score(surface, truth)
    if found.cells == 0:
        raise nothing_in_common(truth_path, frame)
    near = share_within(surface, truth, NEAR_M)
    summary: dict[str, object] = {"map": str(map_path(surface_path)), "truth": str(truth_path), **score_data(found)}
    summary |= {"method": surface.method, "within_3mm": near}
    rows = [*score_rows(found), ("within 3 mm", f"{100.0 * near:.1f} % of the true part")]
    edge = edge_of(surface, edge_truth(truth_path, surface.grid, scale, frame))
    if not math.isnan(edge):
        summary["edge_mm"] = 1e3 * edge
        rows.append(("edge of the step", f"{1e3 * edge:+.1f} mm"))
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
