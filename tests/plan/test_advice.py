"""What is said about stops that cannot be visited: where they are, why, and a move of the part after which they can."""

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

sys.path.insert(0, str(Path(__file__).parent))
from test_scan_plan import ARM, BODY, PLATE, part_frame, plate

from surfuse.arm_models import puma560_volume as volume
from surfuse.arm_models.puma560 import READY_RAD, STAND_HEIGHT_M
from surfuse.geometry.poses import pose, rotation_about
from surfuse.motion.clearance import ClearanceModel
from surfuse.motion.obstacles import Floor, RingTable, part_box
from surfuse.plan.advice import PartMove, way_to_move, where_and_why
from surfuse.plan.scan_plan import PlanParameters, scan_plan, skipped_by_kind
from surfuse.records import Outline, SkippedStop

COARSE = PlanParameters(step_m=0.04)


def around(outline: Outline) -> ClearanceModel:
    stand = volume.column(STAND_HEIGHT_M)
    return ClearanceModel(ARM.link_poses, BODY, (RingTable(), Floor(), stand, part_box(outline)))


def planned(outline: Outline):
    return scan_plan(outline, ARM, READY_RAD, around(outline), COARSE)


@pytest.mark.parametrize("radius_m", [1.45, 1.7, 0.55])
def test_after_the_move_every_stop_is_visited(radius_m: float) -> None:
    outline = plate(30.0, radius_m)
    plan = planned(outline)
    missing = sum(count for kind, count in skipped_by_kind(plan) if not kind.startswith("below"))
    assert missing > 0
    move = way_to_move(plan, ARM, READY_RAD, around)
    assert move is not None
    assert (move.shift_m < 0.0) == (radius_m > 1.0)
    again = planned(Outline(PLATE, move.applied(outline.world_from_part)))
    assert all(stop.reason.startswith("below") for stop in again.skipped)


def test_a_part_that_looks_away_is_turned() -> None:
    frame = part_frame(30.0)
    frame[:3, :3] = rotation_about([0.0, 0.0, 1.0], np.radians(70.0)) @ frame[:3, :3]
    outline = Outline(PLATE, frame)
    plan = planned(outline)
    assert len(plan.skipped) > 7
    move = way_to_move(plan, ARM, READY_RAD, around)
    assert move is not None
    assert move.turn_rad < 0.0
    assert "degrees clockwise as seen from above" in move.describe()
    again = planned(Outline(PLATE, move.applied(frame)))
    assert all(stop.reason.startswith("below") for stop in again.skipped)


def test_where_no_move_helps_none_is_invented() -> None:
    huge = Outline(8.0 * PLATE, part_frame(30.0))
    assert way_to_move(scan_plan(huge, ARM, READY_RAD, None, PlanParameters(step_m=0.2)), ARM, READY_RAD) is None


def test_a_move_is_about_the_foot_and_along_the_line_of_sight() -> None:
    frame = part_frame(90.0, radius_m=1.0)
    moved = PartMove(0.1, np.radians(15.0)).applied(frame)
    assert_allclose(moved[:3, 3], [0.0, 1.1, 1.0], atol=1e-12)
    assert_allclose(moved[:3, :3], rotation_about([0, 0, 1], np.radians(15.0)) @ frame[:3, :3], atol=1e-12)
    assert PartMove(-0.05, 0.0).describe() == "move the part 50 mm towards the arm"
    assert_allclose(PartMove(0.1, 0.0).applied(pose(np.eye(3), [0, 0, 1.0])), pose(np.eye(3), [0, 0, 1.0]))


def test_stops_are_named_with_place_and_reason() -> None:
    plan = planned(plate(30.0, 1.45))
    kind = skipped_by_kind(plan)[0][0]
    words = where_and_why(plan.skipped, kind)
    assert words.startswith("u -")
    assert " mm, v " in words


def test_a_reason_without_details_leaves_nothing_dangling():
    skipped = [SkippedStop(0.06, 0.0, "out of the arm's reach"), SkippedStop(0.12, 0.06, "out of the arm's reach")]
    assert where_and_why(skipped, "out of the arm's reach") == "u 60 to 120 mm, v 0 to 60 mm"
