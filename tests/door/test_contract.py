"""The Python door as its contract writes it."""

from __future__ import annotations

import inspect
import shutil
from pathlib import Path

import numpy as np
import pytest

import surfuse as sf

DATA = Path(__file__).parents[2] / "examples" / "data"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with readings.csv, its side files, and the true part."""
    for file in DATA.glob("*.*"):
        shutil.copy(file, tmp_path / ("part.ply" if file.name == "truth.ply" else file.name))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    return tmp_path


def test_the_contract_runs_as_it_is_written(here):
    log = sf.read("readings.csv")
    assert isinstance(log, sf.Log)
    assert len(log.readings.t_s) == 2200
    assert list(log.sensors) == ["us0", "us1", "us2", "us3"]
    assert log.frame.u.shape == (3,)
    assert log.outline.shape == (4, 2)
    surface = sf.fuse(log, method="beam")
    assert isinstance(surface, sf.SurfaceMap)
    shape = (len(surface.v_m), len(surface.u_m))
    assert surface.height_m.shape == surface.sigma_m.shape == shape
    assert surface.trust in ("good", "doubtful", "bad")
    assert all(finding.severity in ("note", "warning", "alarm") for finding in surface.findings)
    assert surface.to_xarray()["height"].attrs["units"] == "m"
    assert surface.why(u_mm=20, v_mm=110).readings_used > 0
    surface.save("surface.nc")
    assert np.array_equal(sf.open_map("surface.nc").height_m, surface.height_m, equal_nan=True)
    surface.export("part-again.ply")
    surface.plot()
    score = sf.evaluate(surface, truth="part.ply")
    assert 0.0 < score.mae_mm < score.rmse_mm


def test_arrays_as_the_contract_writes_them():
    t_s, sensor, axis = np.arange(4) * 0.1, ["us0"] * 4, np.tile([0.0, 0.0, -1.0], (4, 1))
    position_m, range_m = np.column_stack([0.01 * np.arange(4), np.zeros(4), np.full(4, 0.4)]), np.full(4, 0.4)
    us0 = sf.Sensor(
        kind="ultrasonic", beam_full_angle_deg=13, range_min_m=0.2, range_max_m=4.0, sigma_m=0.001, frequency_hz=63e3
    )
    log = sf.log(t_s, sensor, position_m, axis, range_m, sensors={"us0": us0})
    assert log.sensors == {"us0": us0}


def test_acquiring_takes_the_arguments_of_the_contract():
    call = inspect.signature(sf.acquire)
    assert call.bind("relief", out="runs/first", seed=1).arguments == {
        "scene": "relief",
        "out": "runs/first",
        "seed": 1,
    }
    assert call.bind(cell="rig.toml").arguments == {"cell": "rig.toml"}
