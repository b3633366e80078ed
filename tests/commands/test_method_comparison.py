"""Methods on equal readings: the table, the page, and errors measured as acquisitions measure them."""

from __future__ import annotations

import math

import pytest

from surfuse.commands.judge import method_comparison
from surfuse.commands.outcome import SilentWatcher


@pytest.fixture
def two_methods(monkeypatch):
    few = ("median", "weighted_average")
    monkeypatch.setattr(method_comparison, "usable_methods", lambda warn: few)


def test_every_method_has_a_row_a_map_and_a_place_on_the_page(command, tmp_path, two_methods):
    run = tmp_path / "run"
    assert command("acquire", "relief", "--method", "weighted_average", "--set", "scan.step_m=0.04",
                   "--out", run, "--quiet").status == 0  # fmt: skip
    out = tmp_path / "methods"
    outcome = method_comparison.compare(run, method_comparison.TruthFile(run / "truth.ply"), out, (), SilentWatcher())
    assert [name for name, _ in outcome.table] == ["method", "median", "weighted_average", "page"]
    assert {path.name for path in out.iterdir()} >= {"median.nc", "weighted_average.nc", "comparison.html"}
    page = (out / "comparison.html").read_text("utf-8")
    assert "weighted_average" in page
    assert "edge off by" in page
    # The same map against the same truth has the same errors, whichever command says so.
    told = outcome.summary["methods"]["weighted_average"]
    evaluated = command("evaluate", run, "--truth", run / "truth.ply", "--json").json
    for name in ("rmse_mm", "bias_mm", "coverage", "edge_mm", "within_3mm"):
        assert told[name] == pytest.approx(evaluated[name], rel=1e-12), name
    assert 0.0 < told["within_3mm"] < 1.0
    assert not math.isnan(told["edge_mm"])


def test_without_truth_cells_and_sigma_are_told(command, tmp_path, two_methods):
    run = tmp_path / "run"
    assert command("acquire", "flat", "--method", "weighted_average", "--set", "scan.step_m=0.05",
                   "--out", run, "--quiet").status == 0  # fmt: skip
    outcome = method_comparison.compare(run, None, None, (), SilentWatcher())
    assert "rmse_mm" not in outcome.summary["methods"]["median"]
    assert outcome.summary["methods"]["median"]["cells"] > 5
