"""The arm of the twin's cell refuses what would hurt it, and nothing that a default plan asks for."""

import numpy as np
import pytest

from surfuse.acquisition.smooth import lines_of, way_of
from surfuse.arm_models.puma560 import LIMITS, READY_RAD
from surfuse.errors import SafetyStopError
from surfuse.geometry.poses import pose
from surfuse.motion.obstacles import Box, Floor, RingTable, part_box
from surfuse.plan.approach import approach
from surfuse.plan.scan_plan import PlanParameters, scan_plan
from surfuse.records import Outline
from surfuse.rig.devices import JointMotion
from surfuse.rig.simulated.assembly import simulated_rig
from surfuse.settings import load

PLATE = np.array([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]])
DRIVERS = ("kinematic", "trident")


def cell(driver: str = "kinematic") -> JointMotion:
    return simulated_rig(load(None, [f"arm.driver={driver}", "scene.name=flat"])).joint_motion("this cell")


def plate(azimuth_deg: float, radius_m: float = 1.05) -> Outline:
    c, s = np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))
    w, v = np.array([-c, -s, 0.0]), np.array([0.0, 0.0, 1.0])
    return Outline(PLATE, pose(np.column_stack([np.cross(v, w), v, w]), [radius_m * c, radius_m * s, 1.0]))


@pytest.mark.parametrize("driver", DRIVERS)
def test_the_elbow_does_not_fold_into_the_base(driver: str) -> None:
    made = cell(driver)
    folded = np.radians([0.0, 220.0, 40.0, 0.0, -60.0, 0.0])
    with made.arm as arm:
        before = arm.true_joints_rad
        with pytest.raises(SafetyStopError, match=r"(inside|from) (the arm's|the table|the floor)"):
            arm.move_to(folded)
        assert np.allclose(arm.true_joints_rad, before, atol=1e-4)


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_move_through_the_table_is_refused_on_its_way(driver: str) -> None:
    with cell(driver).arm as arm, pytest.raises(SafetyStopError, match="percent into a move"):
        arm.move_to(np.radians([0.0, 170.0, -70.0, 0.0, 60.0, 0.0]))


@pytest.mark.parametrize("driver", DRIVERS)
def test_the_search_turns_as_far_as_joint_1_goes(driver: str) -> None:
    with cell(driver).arm as arm:
        for angle in (LIMITS.lower_rad[0], LIMITS.upper_rad[0], 0.0):
            arm.move_to(np.append(angle, READY_RAD[1:]))


@pytest.mark.parametrize("azimuth_deg", range(-180, 180, 45))
def test_no_default_plan_is_refused(azimuth_deg: float) -> None:
    made, outline = cell(), plate(azimuth_deg)
    around = (Floor(), RingTable(), part_box(outline))
    check = made.clearance(around)
    plan = scan_plan(outline, made.arm.kinematics, READY_RAD, check, PlanParameters(step_m=0.04))
    assert len(plan) > 30
    made.surround(around)
    for joints in approach(READY_RAD, plan.joints_rad[0], made.arm.kinematics, check):
        made.arm.move_to(joints)
    assert made.smooth is not None
    planner = made.smooth.planner(0.09)
    for line in lines_of(plan):
        planner(way_of(plan, line))
    for joints in plan.joints_rad:
        made.arm.move_to(joints)


def test_the_part_is_an_obstacle_once_it_is_known() -> None:
    made = cell()
    ahead = np.append(np.radians(30.0), READY_RAD[1:])
    made.arm.move_to(ahead)
    place = made.arm.true_tool_pose()[:3, 3]
    made.arm.move_to(READY_RAD)
    block = Box((-0.05, -0.05, -0.05), (0.05, 0.05, 0.05), pose(np.eye(3), place), name="the part")
    made.surround((block,))
    with pytest.raises(SafetyStopError, match="the part"):
        made.arm.move_to(ahead)
