"""Acquisitions of the Python door."""

from __future__ import annotations

from pathlib import Path

import pytest

import surfuse as sf

QUICK = {"scan.step_m": 0.04, "arm.driver": "kinematic"}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> sf.Run:
    """The scan of the fixture `flat_run`, by a call."""
    folder = tmp_path_factory.mktemp("door") / "flat"
    return sf.acquire("flat", out=folder, method="weighted_average", settings=QUICK)


def test_acquiring_gives_the_run_of_the_command(run, flat_run, map_bits):
    assert map_bits(run.path) == map_bits(flat_run)
    assert run.complete
    assert run.warnings == ()
    assert run.summary["scene"] == "flat"
    assert run.summary["method"] == "weighted_average"
    assert {"stops", "robot_time_s", "rmse_mm", "seed"} <= set(run.summary)
    assert run.surface.trust == "good"
    assert run.surface.record.mask.sum() == run.summary["cells"]


def test_a_run_shows_its_log_and_explains_its_map(run):
    assert run.log.readings.n_sweeps == run.summary["stops"]
    v, u = (nodes[len(nodes) // 2] for nodes in (run.surface.v_m, run.surface.u_m))
    assert run.surface.why(1e3 * u, 1e3 * v).has_value
    # The stored truth is a mesh in single precision.
    rmse_mm = sf.evaluate(run.surface, run.path / "truth.ply").rmse_mm
    assert rmse_mm == pytest.approx(run.summary["rmse_mm"], abs=1e-4)


def test_resuming_a_complete_run_leaves_it(run, map_bits):
    before = map_bits(run.path)
    again = sf.resume(str(run.path))
    assert again.complete
    assert map_bits(run.path) == before
    assert again.path == run.path


def test_a_cell_file_and_a_seed(tmp_path):
    cell = tmp_path / "cell.toml"
    cell.write_text('seed = 9\n[scene]\nname = "flat"\n[scan]\nstep_m = 0.09\n[arm]\ndriver = "kinematic"\n')
    one = sf.acquire(out=tmp_path / "one", cell=cell, method="mean")
    two = sf.acquire(out=tmp_path / "two", cell=cell, method="mean", seed=2, settings={"scan.step_m": 0.05})
    assert (one.summary["scene"], one.summary["seed"], two.summary["seed"]) == ("flat", 9, 2)
    assert two.summary["stops"] > one.summary["stops"]


def test_settings_may_be_nested_and_stay_the_caller_s(tmp_path):
    given = {"scene": {"roughness": 0.5}, "scan": {"step_m": 0.09}, "arm.driver": "kinematic"}
    run = sf.acquire("flat", out=tmp_path / "run", method="mean", settings=given)
    assert given == {"scene": {"roughness": 0.5}, "scan": {"step_m": 0.09}, "arm.driver": "kinematic"}
    text = (run.path / "run.toml").read_text("utf-8")
    assert "roughness = 0.5" in text
    assert "step_m = 0.09" in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"scene": "flatt"}, "flatt"),
        ({"scene": 3}, "scene = 3"),
        ({"seed": -1}, "seed = -1"),
        ({"seed": 1.5}, "seed = 1.5"),
        ({"method": "maen"}, "did you mean 'mean'"),
        ({"settings": {"scan.stpe_m": 1}}, "scan.stpe_m"),
        ({"settings": {"scan.step_m": "far"}}, "scan.step_m"),
        ({"settings": {"scan.step_m.x": 1}}, "scan.step_m"),
        ({"settings": [1]}, "settings"),
        ({"settings": {3: 1}}, "settings"),
        ({"cell": "nowhere.toml"}, r"nowhere\.toml"),
        ({"out": 3}, "out = 3"),
    ],
)
def test_wrong_calls_are_refused_before_anything_is_written(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(sf.SurfuseError, match=words):
        sf.acquire(**({"scene": "flat", "out": tmp_path / "run"} | arguments))
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_use_is_kept(run):
    with pytest.raises(sf.SurfuseError, match="not empty"):
        sf.acquire("flat", out=run.path)


def test_resuming_nothing_is_refused(tmp_path: Path):
    for wrong in (tmp_path, tmp_path / "nowhere", 3):
        with pytest.raises(sf.SurfuseError):
            sf.resume(wrong)
