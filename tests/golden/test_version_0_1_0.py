"""What version 0.1.0 wrote still opens, resumes, fuses and gives the same numbers.

The files are those of that version, made by its own commands: `acquire` at a coarse step (`flat_beam`, `relief_paper`,
`smooth_tilted`), an acquisition killed in the middle (`killed`, with the map that an unbroken one gave), a readings CSV
with the files beside it, and maps in other formats. They are never made again.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from surfuse.commands.acquire.acquisition import resume
from surfuse.commands.fuse.map_of_log import fused, grid_of
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.maps.map_files import read_map
from surfuse.commands.maps.report import report
from surfuse.commands.outcome import SilentWatcher
from surfuse.exporters import nc
from surfuse.records import SurfaceMap
from surfuse.runs.configuration import read_configuration
from surfuse.runs.scan_source import load_scan
from surfuse.settings import FusionSettings, from_tree
from surfuse.surface.resample import thinned

GOLDEN = Path(__file__).parents[1] / "data" / "golden" / "v0.1.0"
# An iterative method may amplify the last bit of another processor's arithmetic.
CLOSE_M = {"beam": 1e-6}


def same_map(found: SurfaceMap, kept: SurfaceMap) -> None:
    close_m = CLOSE_M.get(kept.method, 1e-9)
    assert found.method == kept.method
    np.testing.assert_allclose(found.grid.u_m, kept.grid.u_m, atol=1e-12)
    np.testing.assert_allclose(found.grid.v_m, kept.grid.v_m, atol=1e-12)
    np.testing.assert_allclose(found.grid.world_from_part, kept.grid.world_from_part, atol=1e-12)
    np.testing.assert_array_equal(found.mask, kept.mask)
    np.testing.assert_array_equal(found.count, kept.count)
    np.testing.assert_array_equal(found.regime, kept.regime)
    np.testing.assert_allclose(found.height_m, kept.height_m, atol=close_m, rtol=0.0)
    np.testing.assert_allclose(found.sigma_m, kept.sigma_m, atol=close_m, rtol=1e-6)


def fused_again(log: Path, method: str) -> SurfaceMap:
    scan = load_scan(log)
    return fused(scan, create_method(FusionSettings(), method), grid_of(scan))[1]


@pytest.mark.parametrize(
    ("log", "kept"),
    [
        ("relief_paper", "relief_paper/surface.nc"),
        ("smooth_tilted", "smooth_tilted/surface.nc"),
        ("csv/readings.csv", "csv/gaussian_process.nc"),
    ],
)
def test_its_logs_fuse_to_the_same_map(log, kept):
    expected = nc.read(GOLDEN / kept)
    same_map(fused_again(GOLDEN / log, expected.method), expected)


@pytest.mark.parametrize(
    ("log", "kept"), [("flat_beam", "flat_beam/surface.nc"), ("relief_paper", "relief_fused_by_beam.nc")]
)
def test_its_logs_fuse_by_beam_to_the_same_surface(log, kept):
    """The method has become better since: its maps agree within what both of them say of themselves."""
    expected = nc.read(GOLDEN / kept)
    found = thinned(fused_again(GOLDEN / log, "beam"), expected.grid)
    both = found.mask & expected.mask
    assert np.mean(both[expected.mask]) > 0.95
    apart = np.abs(found.height_m - expected.height_m)[both]
    assert np.mean(apart < 3.0 * np.hypot(found.sigma_m, expected.sigma_m)[both]) > 0.9


def test_its_csv_holds_the_readings_of_its_run():
    from_csv, from_run = (
        load_scan(GOLDEN / "csv" / "readings.csv").readings,
        load_scan(GOLDEN / "relief_paper").readings,
    )
    for column in ("t_s", "sensor", "position_m", "axis", "range_m", "status", "amplitude", "start", "stop"):
        np.testing.assert_array_equal(getattr(from_csv, column), getattr(from_run, column), err_msg=column)


@pytest.mark.parametrize("run", ["flat_beam", "relief_paper", "smooth_tilted", "killed"])
def test_its_configurations_are_understood(run):
    tables, seed = read_configuration(GOLDEN / run / "run.toml")
    assert from_tree({**tables, "seed": seed}).seed == seed


def test_its_killed_run_is_resumed_to_the_map_of_an_unbroken_one(tmp_path):
    run = tmp_path / "killed"
    shutil.copytree(GOLDEN / "killed", run)
    before = len(load_scan(run).readings.stop)
    outcome = resume(run, SilentWatcher())
    assert outcome.complete
    assert 0 < before < outcome.summary["stops"]
    same_map(nc.read(run / "surface.nc"), nc.read(GOLDEN / "killed_resumed.nc"))


@pytest.mark.parametrize("run", ["flat_beam", "smooth_tilted"])
def test_a_report_is_made_of_its_runs(run, tmp_path):
    copy = tmp_path / run
    shutil.copytree(GOLDEN / run, copy)
    page = tmp_path / "page.html"
    report(copy, page, overwrite=False)
    assert page.stat().st_size > 100_000


@pytest.mark.parametrize("suffix", ["csv", "sdf", "x3p"])
def test_its_maps_in_other_formats_hold_the_same_heights(suffix):
    kept, found = nc.read(GOLDEN / "relief_paper" / "surface.nc"), read_map(GOLDEN / "maps" / f"relief.{suffix}")
    there = kept.mask & found.mask if suffix == "csv" else found.mask
    assert np.count_nonzero(there) > 0.9 * np.count_nonzero(kept.mask)
    np.testing.assert_allclose(found.height_m[there], kept.height_m[there], atol=1e-6)
