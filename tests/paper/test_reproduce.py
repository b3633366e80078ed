"""`reproduce` on a coarse raster: the paper's constants at their best, the same in table, page and data."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from surfuse.commands.acquire.reproduction import BEST, PAPER, SPLINE, reproduce
from surfuse.commands.outcome import Outcome, SilentWatcher
from surfuse.settings import load

SCENES = ("flat", "tilted", "relief")


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    settings = load(None, ["scan.step_m=0.05", "arm.driver=kinematic"])
    return reproduce(settings, tmp_path_factory.mktemp("reproduce") / "run", SilentWatcher())


def test_the_papers_method_stands_at_its_defaults_and_at_its_best_common_setting(outcome: Outcome) -> None:
    scenes, constants = outcome.summary["scenes"], outcome.summary["constants"]
    assert isinstance(scenes, dict)
    assert isinstance(constants, dict)
    assert tuple(scenes) == SCENES
    for scene in SCENES:
        methods = scenes[scene]["methods"]
        assert {PAPER, BEST, SPLINE, "beam", "carving"} <= set(methods)
        for name, key in ((PAPER, "configured"), (BEST, "best_common")):
            wanted = constants[key]["dense_rmse_mm"][scene]
            assert methods[name]["dense_rmse_mm"] == pytest.approx(wanted, rel=1e-9)
    assert constants["best_common"]["setting"] != constants["configured"]["setting"]
    product = dict.fromkeys(("configured", "best_common"), 1.0)
    for key in product:
        for scene in SCENES:
            product[key] *= constants[key]["dense_rmse_mm"][scene]
    assert product["best_common"] < product["configured"]


def test_summary_page_and_table_say_the_same(outcome: Outcome) -> None:
    run = Path(str(outcome.summary["run"]))
    stored = json.loads((run / "summary.json").read_text("utf-8"))
    assert set(stored) == {*SCENES, "constants"}
    assert stored["constants"] == outcome.summary["constants"]
    page = (run / "report.html").read_text("utf-8")
    constants = outcome.summary["constants"]
    assert isinstance(constants, dict)
    best = constants["best_common"]["dense_rmse_mm"]["relief"]
    rows = dict(outcome.table)
    for text in (f"{best:.2f}", "Constants of the paper", "best common setting"):
        assert text in page
    assert f"{best:.2f}" in rows["best common setting"]
    assert f"relief {BEST}" in rows
    assert len(constants["sensitivity"]) == len(constants["configured"]["setting"])
