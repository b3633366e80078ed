"""The constants of the paper's method on a recorded scan: errors of each change, and the best common setting."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from surfuse.commands.acquire.constants_shown import constants_data, constants_rows, constants_table
from surfuse.commands.acquire.paper_constants import (
    PAPER,
    SHOWN,
    Constant,
    TrialScan,
    configured_constants,
    study_constants,
    with_constants,
)
from surfuse.commands.fuse.map_of_log import fused, grid_of
from surfuse.commands.fuse.methods import create_method
from surfuse.errors import ConfigError, InterruptError
from surfuse.runs.scan_source import load_scan
from surfuse.settings import FusionSettings
from surfuse.surface.dense_score import dense_score, dense_truth_of_mesh
from surfuse.surface.truth import read_truth_mesh

RUN = Path(__file__).parents[1] / "data" / "golden" / "v0.1.0" / "relief_paper"


@pytest.fixture(scope="module")
def trial_scan() -> TrialScan:
    scan = load_scan(RUN)
    grid = grid_of(scan)
    return TrialScan("relief", scan, grid, dense_truth_of_mesh(*read_truth_mesh(RUN / "truth.ply"), grid))


@pytest.fixture(scope="module")
def study(trial_scan):
    return study_constants([trial_scan], FusionSettings(), lambda: None)


def error_mm(trial_scan: TrialScan, constants: tuple[Constant, ...]) -> float:
    method = create_method(with_constants(FusionSettings(), constants), PAPER)
    _, surface = fused(trial_scan.scan, method, trial_scan.grid)
    return 1e3 * dense_score(surface, trial_scan.dense).rmse_m


def test_every_number_of_the_method_is_tried_and_no_switch():
    names = {one.name for one in configured_constants(FusionSettings())}
    assert {"change_m", "allowed_m", "gate_allowance_m", "error_memory"} <= names
    assert not {"use_dc1", "use_dc2", "use_dc3"} & names
    given = FusionSettings(parameters={PAPER: {"change_m": 0.05, "use_dc2": False}})
    assert Constant("change_m", 0.05) in configured_constants(given)
    assert with_constants(given, (Constant("change_m", 0.2),)).parameters[PAPER] == {"change_m": 0.2, "use_dc2": False}


def test_each_change_alone_has_the_error_that_a_fusion_with_it_has(trial_scan, study):
    assert study.configured.dense_rmse_mm == (pytest.approx(error_mm(trial_scan, ()), rel=1e-12),)
    (change,) = (one for one in study.sensitivity if one.constant.name == "change_m")
    for factor, trial in zip(SHOWN, change.trials, strict=True):
        assert trial is not None
        wanted = error_mm(trial_scan, (Constant("change_m", factor * 0.03),))
        assert trial.dense_rmse_mm == (pytest.approx(wanted, rel=1e-12),)
    assert len(study.sensitivity) == len(study.configured.constants)


def test_the_best_setting_is_better_and_leaves_no_more_of_the_part_out(trial_scan, study):
    alone = [trial for one in study.sensitivity for trial in one.trials if trial is not None]
    whole = [trial for trial in alone if trial.coverage[0] >= study.configured.coverage[0] - 0.005]
    assert study.best.mean_mm <= min(trial.mean_mm for trial in whole) * 1.001
    assert study.best.mean_mm < study.configured.mean_mm
    assert study.best.coverage[0] >= study.configured.coverage[0] - 0.005
    assert error_mm(trial_scan, study.best.constants) == pytest.approx(study.best.dense_rmse_mm[0], rel=1e-12)
    assert study.changed
    assert all(one.value != {c.name: c.value for c in study.configured.constants}[one.name] for one in study.changed)


def test_one_setting_serves_all_scans(trial_scan, study):
    """On two scans the mean is geometric, and a scan without any map is no success."""
    twice = study_constants([trial_scan, trial_scan], FusionSettings(), lambda: None)
    assert twice.configured.dense_rmse_mm == study.configured.dense_rmse_mm * 2
    assert twice.best.mean_mm == pytest.approx(study.best.mean_mm, rel=1e-12)
    assert replace(study.best, dense_rmse_mm=(1.0, 4.0)).mean_mm == pytest.approx(2.0)
    assert replace(study.best, dense_rmse_mm=(1.0, np.nan)).mean_mm == np.inf


def test_what_is_not_allowed_is_said_so_and_the_study_can_be_stopped(trial_scan):
    settings = FusionSettings(parameters={PAPER: {"error_memory": 1.0}})
    few = study_constants([trial_scan], settings, lambda: None)
    (memory,) = (one for one in few.sensitivity if one.constant.name == "error_memory")
    assert memory.trials[:2] == (None, None)
    table = constants_table(few, ["relief"])
    assert ("error_memory", "0.5 (halved)", "not allowed") in table.rows

    def stop() -> None:
        raise InterruptError("stopped")

    with pytest.raises(InterruptError):
        study_constants([trial_scan], settings, stop)
    with pytest.raises(ConfigError):
        study_constants([trial_scan], FusionSettings(parameters={PAPER: {"error_memory": 0.0}}), lambda: None)


def test_data_lines_and_table_say_the_same(study):
    data = constants_data(study, ["relief"])
    assert data["configured"]["dense_rmse_mm"] == {"relief": study.configured.dense_rmse_mm[0]}
    assert data["best_common"]["setting"] == {one.name: one.value for one in study.best.constants}
    assert (
        data["sensitivity"]["change_m"]["doubled"]["relief"]
        == study.sensitivity[[one.constant.name for one in study.sensitivity].index("change_m")]
        .trials[SHOWN.index(2.0)]
        .dense_rmse_mm[0]
    )
    lines = constants_rows(study, ["relief"])
    assert len(lines) == len(study.sensitivity) + 2
    assert f"{study.best.dense_rmse_mm[0]:.2f}" in lines[-1][1]
    table = constants_table(study, ["Relief of 9 cm"])
    assert len(table.rows) == 2 + len(SHOWN) * len(study.sensitivity)
    assert table.rows[0][-1] == f"{study.configured.dense_rmse_mm[0]:.2f}"
