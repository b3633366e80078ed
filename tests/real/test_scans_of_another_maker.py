"""Terraces and treads in scans by another simulator: the default method finds them, where averages see a dome."""

from __future__ import annotations

from pathlib import Path

import pytest

from surfuse.commands.fuse.map_of_log import fused, grid_of
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.judge.evaluation import file_score
from surfuse.runs.scan_source import load_scan
from surfuse.settings import FusionSettings

SCANS = Path(__file__).parents[3] / "shared" / "data" / "scans"


@pytest.mark.parametrize("scene", ["pyramid_tube_low", "stairs_tube_low"])
def test_levels_are_found_where_the_average_sees_a_slope(scene):
    folder = SCANS / scene
    if not folder.is_dir():
        pytest.skip(f"{scene} is not here")
    scan = load_scan(folder)
    errors = []
    for method in ("beam", "weighted_average"):
        surface = fused(scan, create_method(FusionSettings(), method), grid_of(scan))[1]
        errors.append(file_score(surface, folder / "truth.ply").dense.rmse_m)
    assert errors[0] < 0.5 * errors[1]
