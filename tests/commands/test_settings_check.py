"""Settings that contradict one another: refused before the arm moves, or told with value, limit and cure."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from surfuse.commands.acquire.settings_check import doubts, refuse_contradictions
from surfuse.commands.acquire.unused_settings import unused
from surfuse.commands.acquire.walking import smooth_pass
from surfuse.errors import ConfigError
from surfuse.geometry.poses import pose
from surfuse.records import Outline, ScanPlan, Status
from surfuse.rig.description import square_fixture, sweep_time
from surfuse.rig.devices import JointMotion, Rig, SmoothMotion
from surfuse.runs.scan_log import faulty_sensors, few_echoes
from surfuse.settings import load
from surfuse.settings.changes import changed

OUTWARDS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
QUICK = ("--set", "scan.step_m=0.04", "--arm-driver", "kinematic", "--method", "weighted_average")


def told(*assignments: str, size_m: tuple[float, float] = (0.2, 0.2), rows: int = 5) -> str:
    """The doubts about a scan of a part whose front is 1.12 m from the arm's axis."""
    settings = load(None, assignments)
    standoff = settings.scan.standoff_m
    heights = np.arange(rows) * 0.04
    grips = np.array([pose(OUTWARDS, [1.12 - standoff, 0.0, 1.0 + height]) for height in heights])
    part = pose(np.column_stack([[0, -1, 0], [0, 0, 1], [-1, 0, 0]]), [1.12, 0.0, 1.0])
    w, h = size_m
    outline = Outline([[-w / 2, 0], [w / 2, 0], [w / 2, h], [-w / 2, h]], part)
    uv = np.column_stack([np.zeros(rows), heights])
    plan = ScanPlan(grips, uv, np.arange(rows), np.zeros((rows, 6)), outline, settings.step_m, standoff)
    return "\n".join(doubts(settings, square_fixture(settings).specs, plan))


def test_the_default_cell_has_no_doubts():
    assert told() == ""


@pytest.mark.parametrize(
    ("assignments", "words"),
    [
        (
            ["scan.standoff_m=0.6"],
            ["table's near edge", "430 mm ahead", "326 mm", "170 mm too near", "at most 0.49"],
        ),
        (["scan.standoff_m=0.34"], ["only 14 mm more than the nearest range of 0.326 m", "0.36 or more"]),
        (["scan.step_m=0.12"], ["scan.step_m = 0.12", "98 mm", "0.05 or less"]),
        (["air.temperature_c=35.0"], ["air.assumed_temperature_c = 20", "has 35", "11.0 mm"]),
        (["array.trigger=simultaneous"], ["array.trigger = 'simultaneous'", "hear one another"]),
        (["kit.trigger=internal"], ["kit.trigger = 'internal'"]),
        (["scan.pings=4"], ["scan.pings has no effect", "scan.mode = 'stops'"]),
        (["arm.law=gravity_pd", "arm.driver=kinematic"], ["arm.law has no effect", "kinematic"]),
        (["scene.scale=0.001"], ["scene.scale has no effect", "'relief'"]),
    ],
)
def test_a_doubt_names_value_limit_and_cure(assignments, words):
    text = told(*assignments)
    for word in words:
        assert word in text
    assert len(text.splitlines()) == 1


def test_a_beam_that_is_wider_than_the_part_is_told():
    text = told(size_m=(0.06, 0.2))
    assert "98 mm wide" in text
    assert "only 60 mm" in text


def test_a_table_edge_that_is_blanked_or_below_the_beam_is_no_doubt():
    assert told("scan.standoff_m=0.49") == ""
    assert "at 2 of 5 stops" in told("scan.standoff_m=0.6")
    far = told("scan.standoff_m=0.6", "cell.table_inner_radius_m=1.11")
    assert "table's near edge" not in far


@pytest.mark.parametrize(
    ("assignments", "words"),
    [
        (
            ["kit.blanking_s=0.003"],
            ["scan.standoff_m = 0.43", "0.515 m", "kit.blanking_s = 0.003", "above 0.54"],
        ),
        (["kit.tube_length_m=0.45", "kit.blanking_s=0.0"], ["0.450 m of its tube", "kit.tube_length_m"]),
        (["scan.standoff_m=4.2"], ["beyond 4.000 m", "smaller standoff"]),
    ],
)
def test_a_standoff_at_which_nothing_is_heard_is_refused_before_the_scan(command, tmp_path, assignments, words):
    settings = load(None, assignments)
    with pytest.raises(ConfigError):
        refuse_contradictions(settings, square_fixture(settings).specs)
    sets = [word for text in assignments for word in ("--set", text)]
    command("acquire", "flat", *sets, *QUICK, "--out", tmp_path / "run").error(3, *words)
    assert not (tmp_path / "run").exists()
    answer = command("doctor", "--json", *sets)
    assert "configuration" in answer.json["problems"]


def test_doubts_are_on_stderr_in_the_summary_and_in_the_report(command, tmp_path):
    run = tmp_path / "run"
    answer = command("acquire", "flat", "--set", "scan.standoff_m=0.6", *QUICK, "--out", run)
    assert answer.status == 0
    assert "surfuse: note: at " in answer.err
    warnings = json.loads((run / "summary.json").read_text())["warnings"]
    assert any("table's near edge" in text for text in warnings)
    assert "near edge" in (run / "report.html").read_text()


def test_few_echoes_are_told(command, plate, tmp_path):
    assert few_echoes(np.full(4, int(Status.NO_ECHO))).startswith("only 0 of 4 readings")
    assert few_echoes(np.array([0, 0, 1, 1])) is None
    log = plate()
    lines = log.read_text().splitlines()
    column = lines[0].split(",").index("range_m")
    kept = [lines[0]]
    for number, line in enumerate(lines[1:]):
        cells = line.split(",")
        if number % 3:
            cells[column] = ""
            cells[lines[0].split(",").index("status")] = ""
        kept.append(",".join(cells))
    log.write_text("\n".join(kept) + "\n")
    answer = command("fuse", log, "--method", "mean", "--out", tmp_path / "run")
    assert "readings are echoes" in answer.err
    assert any("are echoes" in text for text in json.loads((tmp_path / "run" / "summary.json").read_text())["warnings"])


def test_a_pass_that_is_faster_than_its_bus_is_told_with_value_limit_and_cure():
    smooth = ["scan.mode=smooth", "scan.speed_m_s=0.06", "scan.step_m=0.012"]
    assert told(*smooth) == ""
    slow = told(*smooth, "bus.bitrate_bps=10000")
    for words in (
        "scan.speed_m_s = 0.06",
        "every 200 ms",
        "takes 248.5 ms",
        "148.5 ms of it on the bus",
        "0.0482 or less",
    ):
        assert words in slow
    assert "faster bus" in slow
    assert told(*smooth, "bus.bitrate_bps=20000") == ""
    assert "on the bus" not in told(*smooth, "scan.speed_m_s=0.2", "bus.interface=none")


def test_a_pass_without_a_given_speed_waits_for_its_bus():
    settings = load(None, ["scan.mode=smooth", "bus.bitrate_bps=10000"])
    time = sweep_time(settings, square_fixture(settings).specs)
    assert (time.firing_s, time.bus_s) == (pytest.approx(0.1), pytest.approx(0.1485))
    speeds = []
    motion = JointMotion(arm=None, smooth=SmoothMotion(None, speeds.append))
    array = SimpleNamespace(fixture=square_fixture(settings))
    for bitrate_bps in (10_000, 1_000_000):
        chosen = load(None, ["scan.mode=smooth", f"bus.bitrate_bps={bitrate_bps}"])
        smooth_pass(Rig(clock=None, array=array, motion=motion), chosen)
    assert speeds == [settings.step_m / time.total_s, 0.95 * settings.step_m / time.firing_s]


def test_only_what_differs_from_the_defaults_is_changed():
    assert changed(load()) == ()
    settings = load(None, ["scan.step_m=0.02", "seed=7", "arm.settle_s=0.15", "fusion.parameters.mean.x=1"])
    assert changed(settings) == ("seed", "scan.step_m", "fusion.parameters.mean")
    assert unused(load(None, ["bus.interface=none", "bus.node=3"])) == (
        "bus.node has no effect with bus.interface = 'none'",
    )
    assert unused(load(None, ["bus.interface=slcan", "bus.port=4000"])) == (
        "bus.port has no effect with bus.interface = 'slcan'",
    )


def test_sensors_that_report_only_faults_are_named():
    ok, none, fault = int(Status.OK), int(Status.NO_ECHO), int(Status.FAULT)
    status, sensor = np.array([fault, none, fault, fault, fault, ok]), np.array([0, 1, 2, 0, 1, 2])
    broken = faulty_sensors(status, sensor, ["left", "middle", "right", "unheard"])
    assert broken == ("left",)
    told = few_echoes(status, broken)
    assert told.endswith("'left' reported 'fault' in every reading: check its supply, its wiring and its program")
    assert "distance" not in told
