from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.arm_models import puma560_volume as volume
from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, LIMITS, READY_RAD, STAND_HEIGHT_M, Puma560
from surfuse.errors import SafetyStopError
from surfuse.geometry.poses import pose
from surfuse.motion.body import body_of, fixture_capsules
from surfuse.motion.clearance import ClearanceModel, Clearances, check_move
from surfuse.motion.obstacles import Box, Floor, RingTable, part_box
from surfuse.plan.approach import approach
from surfuse.plan.scan_plan import PlanParameters, scan_plan
from surfuse.records import Fixture, Outline, SensorSpec

SPEC = SensorSpec("s", "sonar", 0.35, 4.0, 0.4, 0.001)
SENSORS = Fixture(
    np.array([pose(np.eye(3), [x, y, 0.0]) for x in (-0.025, 0.025) for y in (-0.025, 0.025)]), (SPEC,) * 4
)
ARM = Puma560(pose(np.eye(3), [0, 0, STAND_HEIGHT_M]), pose(np.eye(3), [0, 0, 0.08 - FLANGE_OFFSET_M]))
BODY = body_of([*volume.CAPSULES, *fixture_capsules(SENSORS, volume.TOOL_LINK)])
CELL = (RingTable(), Floor(), volume.column(STAND_HEIGHT_M))


def plate(azimuth_deg: float) -> Outline:
    c, s = np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))
    facing = np.column_stack([[s, -c, 0.0], [0.0, 0.0, 1.0], [-c, -s, 0.0]])
    return Outline([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]], pose(facing, [1.05 * c, 1.05 * s, 1.0]))


@pytest.mark.parametrize("azimuth_deg", [*range(-180, 180, 45), 170])
def test_every_place_on_the_ring_has_a_clear_way_to_its_first_stop(azimuth_deg: float) -> None:
    outline = plate(azimuth_deg)
    model = ClearanceModel(ARM.link_poses, BODY, (*CELL, part_box(outline)))
    goal = scan_plan(outline, ARM, READY_RAD, model, PlanParameters(step_m=0.05)).joints_rad[0]
    way = approach(READY_RAD, goal, ARM, model)
    assert_allclose(way[-1], goal)
    assert np.all((way >= LIMITS.lower_rad) & (way <= LIMITS.upper_rad))
    for start, end in zip([READY_RAD, *way[:-1]], way, strict=True):
        check_move(model, start, end, 0.005)


def test_the_direct_move_is_taken_when_it_is_clear() -> None:
    model = ClearanceModel(ARM.link_poses, BODY, CELL)
    goal = scan_plan(plate(35.0), ARM, READY_RAD, model, PlanParameters(step_m=0.05)).joints_rad[0]
    assert_allclose(approach(READY_RAD, goal, ARM, model), [goal])


def test_a_detour_is_taken_around_what_blocks_the_direct_move() -> None:
    outline = plate(180.0)
    model = ClearanceModel(ARM.link_poses, BODY, (*CELL, part_box(outline)))
    goal = scan_plan(outline, ARM, READY_RAD, model).joints_rad[0]
    with pytest.raises(SafetyStopError):
        check_move(model, READY_RAD, goal, 0.005)
    assert len(approach(READY_RAD, goal, ARM, model)) > 1


def test_an_arm_walled_in_has_no_way_and_the_direct_one_is_named() -> None:
    goal = scan_plan(plate(90.0), ARM, READY_RAD, None, PlanParameters(step_m=0.05)).joints_rad[0]
    wall = Box((-1.0, 0.35, 0.0), (1.0, 0.37, 3.0), np.eye(4), name="the wall")
    model = ClearanceModel(ARM.link_poses, BODY, (wall,))
    with pytest.raises(SafetyStopError, match="the wall"):
        approach(READY_RAD, goal, ARM, model)


def says_clear(where) -> Callable[[np.ndarray], Clearances]:
    """A clearance check that knows at which joints (N, J) the arm is clear."""

    def check(joints: np.ndarray) -> Clearances:
        n = len(joints)
        return Clearances(np.where(where(joints), 1.0, -1.0), np.zeros(n, int), np.zeros(n, int), ("arm",), ("it",))

    return check


GOAL = scan_plan(plate(35.0), ARM, READY_RAD, None, PlanParameters(step_m=0.05)).joints_rad[0]


def test_where_only_the_way_along_the_grip_s_axis_is_clear_the_arm_comes_from_behind() -> None:
    goal = ARM.forward(GOAL)

    def clear(joints: np.ndarray) -> np.ndarray:
        away = ARM.forward(joints)[:, :3, 3] - goal[:3, 3]
        along = away @ goal[:3, 2]
        beside = np.linalg.norm(away - along[:, None] * goal[:3, 2], axis=1)
        return (np.linalg.norm(away, axis=1) > 0.09) & (along < 0.05) | (beside < 0.02) & (along < 1e-6)

    way = approach(READY_RAD, GOAL, ARM, says_clear(clear))  # type: ignore[arg-type]
    back = np.linalg.inv(goal) @ ARM.forward(way[-2])
    assert_allclose(back[:3, :3], np.eye(3), atol=1e-9)
    assert_allclose(back[:2, 3], 0.0, atol=1e-9)
    assert -0.2 - 1e-9 <= back[2, 3] < -0.09


def test_the_last_centimetres_are_never_a_swing_from_another_configuration() -> None:
    class Turned(Puma560):
        """Reaches poses only in configurations other than that of the goal."""

        def inverse(self, world_from_tool: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            joints, valid = super().inverse(world_from_tool)
            return joints, valid & (np.abs(joints - GOAL).max(axis=-1) > np.radians(70.0))

    arm = Turned(pose(np.eye(3), [0, 0, STAND_HEIGHT_M]), pose(np.eye(3), [0, 0, 0.08 - FLANGE_OFFSET_M]))

    def off_the_direct_line(joints: np.ndarray) -> np.ndarray:
        others = np.abs(joints - READY_RAD)[:, 1:].max(axis=1), np.abs(joints - GOAL)[:, 1:].max(axis=1)
        share = (joints - READY_RAD) @ (GOAL - READY_RAD) / np.sum((GOAL - READY_RAD) ** 2)
        direct = np.abs(joints - READY_RAD - share[:, None] * (GOAL - READY_RAD)).max(axis=1) < 1e-6
        ends = (np.abs(joints - READY_RAD).max(axis=1) < 1e-9) | (np.abs(joints - GOAL).max(axis=1) < 1e-9)
        return ends | ~(direct | (others[0] < 1e-6) | (others[1] < 1e-6))

    with pytest.raises(SafetyStopError):
        approach(READY_RAD, GOAL, arm, says_clear(off_the_direct_line))  # type: ignore[arg-type]
