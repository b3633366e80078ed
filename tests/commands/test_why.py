from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from surfuse.cli import why as why_command
from surfuse.commands.explain.why import why
from surfuse.commands.fuse.fuse_log import fuse
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import DataError, UsageError
from surfuse.exporters import nc

CELLS = [(-60.0, 0.0), (-20.0, 40.0), (0.0, 80.0), (60.0, 30.0), (-50.0, 0.0)]


def run_of(log: Path, method: str) -> Path:
    run = log.parent / f"run-{method}"
    fuse(log, run, SilentWatcher(), overrides=(f'fusion.method="{method}"',))
    return run


@pytest.mark.parametrize("method", ["weighted_average", "mean", "median", "inverse_variance"])
def test_fusing_the_printed_readings_gives_the_cell_back(plate: Callable[..., Path], method: str) -> None:
    run = run_of(plate(tilt_deg=8.0), method)
    for u, v in CELLS:
        told = json.loads(json.dumps(why(run, u, v).summary))
        assert told["has_value"]
        assert told["recomputed_mm"] == pytest.approx(told["height_mm"], abs=1e-6)
        heights, weights = [], []
        for stop in told["stops"]:
            grip = np.array(stop["grip_m"])
            used = [reading for reading in stop["readings"] if reading["used"]]
            # From position, axis and range alone: the own hit point, seen along the grip axis.
            hits = [np.array(r["position_m"]) + r["range_m"] * np.array(r["axis"]) for r in used]
            values = np.array([(hit - grip[:3, 3]) @ grip[:3, 2] for hit in hits])
            depth = np.median(values) if method == "median" else np.average(values, weights=[r["dc"] for r in used])
            heights.append((grip[:3, 3] + depth * grip[:3, 2])[2])
            weights.append(stop["sigma_mm"] ** -2)
        assert 1e3 * np.average(heights, weights=weights) == pytest.approx(told["height_mm"], abs=1e-6)


def test_the_paper_method_tells_its_three_factors_and_its_refusals(plate: Callable[..., Path]) -> None:
    run = run_of(plate(), "weighted_average")
    told = why(run, -50.0, 0.0).summary
    readings = [reading for stop in told["stops"] for reading in stop["readings"]]
    for reading in readings:
        if reading["used"]:
            assert reading["dc"] == pytest.approx(reading["dc1"] * reading["dc2"] * reading["dc3"])
    # Two readings of the first stops of the scan were broken on purpose: 5 cm, and no echo at all.
    verdicts = {reading["verdict"] for reading in readings if not reading["used"]}
    assert verdicts == {
        "refused: outside of the range that the sensor can give",
        "refused: no echo",
    }
    assert told["refused"] == dict.fromkeys(verdicts, 1)
    assert sum(stop["share"] for stop in told["stops"]) == pytest.approx(1.0)


def test_a_method_that_uses_all_readings_lists_the_beams_over_the_cell(plate: Callable[..., Path]) -> None:
    log = plate()
    run = run_of(log, "own_axis_median")
    told = why(run, 0.0, 40.0).summary
    assert told["rule"] == "all readings"
    surface = nc.read(run / "surface.nc")
    angles = [reading["off_axis_deg"] for reading in told["readings"]]
    assert angles == sorted(angles)
    assert max(angles) <= 6.5
    # A plain count of the cones of 13 degrees that hold the cell.
    table = np.genfromtxt(log, delimiter=",", names=True, usecols=(2, 3, 4), encoding="utf-8")
    towards = np.array([0.0, 0.04, float(surface.height_m[4, 6])]) - np.column_stack(
        [table[n] for n in table.dtype.names]
    )
    cosine = -towards[:, 2] / np.linalg.norm(towards, axis=1)
    assert len(angles) == int(np.sum(cosine >= np.cos(np.radians(6.5))))
    near = [r for r in told["readings"] if r["off_axis_deg"] < 1.0 and r["used"]]
    assert near
    assert all(abs(r["beyond_cell_mm"]) < 5.0 for r in near)


def test_a_cell_without_value_says_so(plate: Callable[..., Path]) -> None:
    log = plate()
    rows = log.read_text("utf-8").splitlines()
    # No echo at all at the stops of the left half of the scan.
    silent = [rows[0]] + [
        ",".join([*row.split(",")[:8], "inf", "no_echo", *row.split(",")[10:]]) if float(row.split(",")[2]) < 0 else row
        for row in rows[1:]
    ]
    log.write_text("\n".join(silent) + "\n", "utf-8")
    run = run_of(log, "mean")
    told = why(run, -50.0, 40.0)
    assert not told.summary["has_value"]
    assert told.summary["stops"] == []
    assert dict(told.table)["value"].startswith("none")


def test_what_cannot_be_answered_is_refused_with_a_cure(plate: Callable[..., Path], tmp_path: Path) -> None:
    log = plate()
    run = run_of(log, "mean")
    with pytest.raises(UsageError, match=r"v runs from -?0\.0 to 80\.0 mm"):
        why(run, 0.0, 200.0)
    moved = log.rename(tmp_path / "moved.csv")
    with pytest.raises(DataError, match=r"no longer there; .* --log"):
        why(run, 0.0, 40.0)
    assert why(run, 0.0, 40.0, moved).summary["has_value"]
    rows = moved.read_text("utf-8").splitlines()
    (tmp_path / "other.csv").write_text("\n".join(rows[:-4]) + "\n", "utf-8")
    with pytest.raises(DataError, match="other readings"):
        why(run, 0.0, 40.0, tmp_path / "other.csv")
    (run / "run.toml").unlink()
    with pytest.raises(DataError, match="neither a log nor a run"):
        why(run, 0.0, 40.0)


def test_negative_coordinates_are_coordinates_on_the_command_line(plate: Callable[..., Path]) -> None:
    run = run_of(plate(), "mean")
    app = typer.Typer()
    why_command.register(app)
    result = CliRunner().invoke(app, [str(run), "-20", "40", "--json"])
    assert result.exit_code == 0
    assert json.loads(result.stdout)["u_mm"] == pytest.approx(-20.0)


@pytest.mark.parametrize(("method", "within_mm"), [("own_axis_median", 0.5), ("beam", 0.5)])
def test_the_beams_over_a_cell_fused_alone_give_it_back(
    plate: Callable[..., Path], method: str, within_mm: float
) -> None:
    run = run_of(plate(tilt_deg=4.0), method)
    for u, v in CELLS[1:3]:
        told = why(run, u, v).summary
        assert told["rule"] == "all readings"
        assert told["recomputed_mm"] == pytest.approx(told["height_mm"], abs=within_mm)
