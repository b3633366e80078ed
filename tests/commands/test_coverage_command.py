from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from surfuse.commands.fuse.fuse_log import fuse
from surfuse.commands.judge.coverage import coverage
from surfuse.commands.outcome import SilentWatcher

MEAN = ('fusion.method="mean"',)


def test_a_log_and_the_run_made_from_it_have_the_same_coverage(plate: Callable[..., Path], tmp_path: Path) -> None:
    log = plate()
    truth = log.with_name("truth.ply")
    fuse(log, tmp_path / "run", SilentWatcher(), overrides=MEAN)
    fresh = coverage(log, truth, 1.0, MEAN, SilentWatcher()).summary
    stored = coverage(tmp_path / "run", truth, 1.0, (), SilentWatcher()).summary
    file = coverage(tmp_path / "run" / "surface.nc", truth, 1.0, (), SilentWatcher()).summary
    assert fresh["regimes"] == stored["regimes"] == file["regimes"]
    assert fresh["method"] == stored["method"] == "mean"


def test_the_mean_of_a_facing_plate_states_what_it_knows(plate: Callable[..., Path]) -> None:
    log = plate()
    outcome = coverage(log, log.with_name("truth.ply"), 1.0, MEAN, SilentWatcher())
    found = outcome.summary["regimes"]["all"]
    assert found["cells"] > 100
    assert found["within_50"] < found["within_90"] <= found["within_99"]
    assert found["within_90"] == pytest.approx(0.9, abs=0.12)
    assert [label for label, _ in outcome.table] == ["method", "cells within", "all", "measured"]


def test_a_run_is_fused_again_when_a_method_is_named(plate: Callable[..., Path], tmp_path: Path) -> None:
    log = plate(tilt_deg=10.0)
    fuse(log, tmp_path / "run", SilentWatcher(), overrides=MEAN)
    # A fused run keeps no log: naming a method needs the log itself.
    again = coverage(log, log.with_name("truth.ply"), 1.0, ('fusion.method="median"',), SilentWatcher())
    assert again.summary["method"] == "median"
