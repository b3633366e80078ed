"""The touch probe on a small Marlin and a small GRBL, alone and together with the arm on the same line."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.acquisition.scan import WalkHooks, scan
from surfuse.acquisition.stop_arm import PoseStopArm
from surfuse.arms import gcode
from surfuse.errors import ConfigError, SafetyStopError
from surfuse.geometry.poses import pose
from surfuse.records import Fixture, Outline, ScanPlan, Status
from surfuse.rig import sequential_array
from surfuse.sensors.gcode_probe import Parameters, create

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")
DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(params=["marlin", "grbl"])
def dialect(request):
    return request.param


@pytest.fixture
def board(dialect):
    pytest.importorskip("serial")
    sys.path.insert(0, str(Path(__file__).parents[1] / "stand_ins"))
    from gcode_boards import Grbl, Marlin

    with {"marlin": Marlin, "grbl": Grbl}[dialect]() as made:
        made.part_mm = 70.0
        yield made


@pytest.fixture
def rig(board, dialect):
    arm = gcode.Parameters(board.port, dialect, (0.0, 0.0, 0.0), (0.3, 0.3, 0.3), settle_s=0.0)
    probe = Parameters(board.port, dialect, probe_feed_mm_min=3000.0)
    with gcode.create(arm) as opened_arm, create(probe) as opened_probe:
        yield opened_arm, opened_probe


def test_the_range_is_the_way_to_the_contact_and_the_arm_finds_the_machine_where_it_was(rig, board):
    arm, probe = rig
    for height_m in (0.1, 0.09, 0.1):
        arm.move_to_pose(pose(DOWN, [0.02, 0.03, height_m]))
        echo = probe.fire()
        assert (echo.status, echo.range_m) == (Status.OK, pytest.approx(height_m - 0.07, abs=1e-5))
        assert_allclose(arm.tool_state().world_from_tool[:3, 3], [0.02, 0.03, height_m], atol=1e-5)


def test_a_scan_by_touch_maps_the_part_stop_by_stop(rig, board):
    arm, probe = rig
    places = [(0.02 * i, 0.03 * j, 0.1) for j in range(2) for i in range(3)]
    outline = Outline([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]], np.eye(4))
    grips = np.array([pose(DOWN, [*place]) for place in places])
    uv, rows = np.array(places)[:, :2], np.array([0, 0, 0, 1, 1, 1])
    plan = ScanPlan(grips, uv, rows, np.zeros((6, 0)), outline, 0.02, 0.03)
    array = sequential_array.create(Fixture(np.eye(4)[None], (probe.spec,)), [probe])
    heights = {0: 70.0, 1: 71.5, 2: 72.0, 3: 80.0, 4: 60.0, 5: 70.0}
    found = {}

    def raise_part(stop):
        board.part_mm = heights[stop]

    def keep(sweep):
        found[sweep.stop] = 100.0 - 1e3 * sweep.range_m[0]

    outcome = scan(plan, PoseStopArm(arm, np.eye(4)), array, WalkHooks(keep, raise_part))
    assert outcome.finished
    assert found == {stop: pytest.approx(height, abs=0.01) for stop, height in heights.items()}


def test_nothing_within_reach_is_an_answer(rig, board):
    arm, probe = rig
    arm.move_to_pose(pose(DOWN, [0.02, 0.03, 0.13]))
    echo = probe.fire()
    assert (echo.status, echo.range_m) == (Status.NO_ECHO, float("inf"))
    assert_allclose(arm.tool_state().world_from_tool[2, 3], 0.13, atol=1e-5)
    depths = [line for line in board.told if line.startswith("G38.3")]
    assert "Z80.000" in depths[0]


def test_work_coordinates_do_not_disturb_it(rig, board, dialect):
    if dialect == "grbl":
        board.offset_mm = (1.0, 2.0, -30.0)
        arm, probe = rig
        arm.move_to_pose(pose(DOWN, [0.02, 0.03, 0.1]))
        assert probe.fire().range_m == pytest.approx(0.03, abs=1e-5)


def test_a_probe_that_touches_already_is_a_safety_stop(rig, board, dialect):
    if dialect == "grbl":
        _, probe = rig
        board.complaint = b"ALARM:4\r\n"
        with pytest.raises(SafetyStopError, match="rest state"):
            probe.fire()


def test_directions_are_unit_vectors(board, dialect):
    with pytest.raises(ConfigError, match="length 2"):
        replace(Parameters(board.port, dialect), towards=(0.0, 0.0, -2.0))
