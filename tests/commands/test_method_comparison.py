"""Methods on equal readings: the table, the page, and errors measured as acquisitions measure them."""

from __future__ import annotations

import math
import time

import pytest

from surfuse.commands.judge import method_comparison
from surfuse.commands.outcome import SilentWatcher
from surfuse.fusing.sweepwise import SweepwiseFusion
from surfuse.settings import FusionSettings


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


def test_the_clock_starts_when_the_method_has_fused_once(command, tmp_path, monkeypatch):
    """Kernels are compiled at their first use, which is no part of a method's seconds."""
    run = tmp_path / "run"
    assert command("acquire", "flat", "--method", "mean", "--arm-driver", "kinematic", "--set", "scan.step_m=0.05",
                   "--out", run, "--quiet").status == 0  # fmt: skip
    happened = []
    clock, fused, replay = time.perf_counter, method_comparison.fused, SweepwiseFusion.replay
    monkeypatch.setattr(SweepwiseFusion, "replay", lambda *given: happened.append("fuse") or replay(*given))
    monkeypatch.setattr(method_comparison, "fused", lambda *scan: happened.append("timed") or fused(*scan))
    monkeypatch.setattr(method_comparison.time, "perf_counter", lambda: happened.append("clock") or clock())
    scan = method_comparison.opened(method_comparison.LogSource(run), SilentWatcher())
    method_comparison.result_of(scan, FusionSettings(), "mean", method_comparison.grid_of(scan), None)
    assert happened[:2] == ["fuse", "clock"]
    assert happened.index("clock") < happened.index("timed")
