from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from surfuse.errors import DataError
from surfuse.records import MapGrid, SurfaceMap
from surfuse.surface.texture_parameters import areal_parameters, parameters_of

DATA = Path(__file__).parents[1] / "data"
REFERENCE = json.loads((DATA / "surface_params_reference.json").read_text())["cases"]
INPUTS = {
    "sine_x (a=2, 200 px/period, 10 periods, step 0.1)": "sine_x",
    "crossed_sines_noise (64x80, step 0.5)": "crossed_sines_noise",
    "gaussian_noise (64x80, step 1)": "gaussian_noise",
    "step_9cm_relief (40x40 grid, step 5 mm, heights mm)": "step_9cm_relief",
    "tilted_plane_20deg (40x40, step 5 mm)": "tilted_plane_20deg",
}
FIELDS = {"Sa": "sa_m", "Sq": "sq_m", "Ssk": "ssk", "Sku": "sku", "Sp": "sp_m", "Sv": "sv_m", "Sz": "sz_m"}


@pytest.mark.parametrize("case", INPUTS)
def test_agrees_with_the_reference(case: str) -> None:
    with np.load(DATA / "surface_params_inputs.npz") as inputs:
        height = inputs[INPUTS[case]]
    expected, step = REFERENCE[case], REFERENCE[case]["step"]
    got = parameters_of(height, np.arange(height.shape[1]) * step[0], np.arange(height.shape[0]) * step[1])
    for name, field in FIELDS.items():
        assert getattr(got, field) == pytest.approx(expected["direct_formula"][name], rel=1e-9, abs=1e-9), name
    assert 100 * got.sdr == pytest.approx(expected["direct_formula"]["Sdr_pct_2tri"], rel=1e-9)
    assert got.sdq == pytest.approx(expected["surfalize"]["Sdq"], rel=2e-3)


def surface_of(w: np.ndarray, u: np.ndarray, v: np.ndarray) -> SurfaceMap:
    mask = np.isfinite(w)
    return SurfaceMap(
        MapGrid(u, v, np.eye(4)), w, np.where(mask, 1e-3, np.nan), mask * 1.0, mask.astype(np.int64), mask,
        mask.astype(np.uint8), "test",
    )  # fmt: skip


def test_tilted_plane_by_closed_form_and_levelled_away() -> None:
    u, v = np.linspace(0.0, 0.2, 21), np.linspace(0.0, 0.1, 31)
    w = np.tan(np.radians(20.0)) * np.meshgrid(u, v)[0]
    w[3, 4:9] = np.nan
    got = areal_parameters(surface_of(w, u, v))
    assert got.sdq == pytest.approx(np.tan(np.radians(20.0)))
    assert got.sdr == pytest.approx(1 / np.cos(np.radians(20.0)) - 1)
    level = areal_parameters(surface_of(w, u, v), level="plane")
    assert level.sq_m < 1e-15
    assert level.sz_m < 1e-15


def test_a_level_surface_has_no_skewness_and_an_empty_one_nothing() -> None:
    u = np.arange(4.0)
    got = areal_parameters(surface_of(np.full((4, 4), 0.3), u, u))
    assert (got.sa_m, got.sdq, got.sdr) == (0.0, 0.0, 0.0)
    assert np.isnan(got.ssk)
    assert np.isnan(got.sku)
    with pytest.raises(DataError, match="no cell"):
        areal_parameters(surface_of(np.full((4, 4), np.nan), u, u))


def test_two_levels() -> None:
    u = np.arange(10) * 0.01
    w = np.where(np.meshgrid(u, u)[1] < 0.045, 0.09, 0.0)
    got = areal_parameters(surface_of(w, u, u))
    assert (got.sa_m, got.sq_m, got.sku) == (pytest.approx(0.045), pytest.approx(0.045), pytest.approx(1.0))
