import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.arm_models import puma560_volume as volume
from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, LIMITS, READY_RAD, STAND_HEIGHT_M, Puma560
from surfuse.errors import ConfigError
from surfuse.geometry.poses import pose
from surfuse.motion.body import body_of, fixture_capsules
from surfuse.motion.clearance import ClearanceModel
from surfuse.motion.obstacles import Box, Floor, RingTable
from surfuse.plan.raster import grip_targets
from surfuse.plan.reach import ReachParameters, reach
from surfuse.plan.scan_plan import PlanParameters, scan_plan, skipped_by_kind
from surfuse.records import Fixture, Outline, SensorSpec

SPEC = SensorSpec("s", "sonar", 0.35, 4.0, 0.4, 0.001)
SENSORS = Fixture(
    np.array([pose(np.eye(3), [x, y, 0.0]) for x in (-0.025, 0.025) for y in (-0.025, 0.025)]), (SPEC,) * 4
)
PLATE = np.array([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]])
ARM = Puma560(pose(np.eye(3), [0, 0, STAND_HEIGHT_M]), pose(np.eye(3), [0, 0, 0.08 - FLANGE_OFFSET_M]))
BODY = body_of([*volume.CAPSULES, *fixture_capsules(SENSORS, volume.TOOL_LINK)])
CELL = ClearanceModel(ARM.link_poses, BODY, (RingTable(), Floor(), volume.column(STAND_HEIGHT_M)))


def part_frame(azimuth_deg: float, radius_m: float = 1.05, height_m: float = 1.0) -> np.ndarray:
    c, s = np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))
    w = np.array([-c, -s, 0.0])
    v = np.array([0.0, 0.0, 1.0])
    return pose(np.column_stack([np.cross(v, w), v, w]), [radius_m * c, radius_m * s, height_m])


def plate(azimuth_deg: float = 30.0, radius_m: float = 1.05) -> Outline:
    return Outline(PLATE, part_frame(azimuth_deg, radius_m))


def step_away(turns: np.ndarray) -> float:
    return float(np.max(np.abs(np.diff(turns, axis=0))))


def test_the_default_plate_is_scanned_whole_from_the_table_up() -> None:
    plan = scan_plan(plate(), ARM, READY_RAD, CELL)
    assert len(plan) == 23 * 25
    assert skipped_by_kind(plan) == (("below the table top", 50),)
    assert_allclose(ARM.forward(plan.joints_rad), plan.world_from_grip, atol=1e-9)
    assert np.all((plan.joints_rad >= LIMITS.lower_rad) & (plan.joints_rad <= LIMITS.upper_rad))
    assert np.all(ARM.singularity_distance(plan.joints_rad) >= 0.05)
    assert np.all(CELL(plan.joints_rad).distance_m >= 0.005)
    assert step_away(plan.joints_rad) < np.radians(6.0)
    assert plan.outline.margin_m == 0.02


@pytest.mark.parametrize("azimuth_deg", range(-180, 180, 30))
def test_every_place_on_the_ring_can_be_scanned(azimuth_deg: float) -> None:
    plan = scan_plan(plate(azimuth_deg), ARM, READY_RAD, CELL, PlanParameters(step_m=0.04, lowest_v_m=-np.inf))
    assert len(plan) == 42
    assert plan.skipped == ()


def test_lines_below_the_table_are_planned_when_asked_for() -> None:
    plan = scan_plan(plate(), ARM, READY_RAD, CELL, PlanParameters(lowest_v_m=-np.inf))
    assert len(plan) == 625
    assert plan.skipped == ()


def test_a_part_out_of_reach_gives_no_stops_and_says_why() -> None:
    plan = scan_plan(plate(radius_m=3.0), ARM, READY_RAD, CELL, PlanParameters(step_m=0.04))
    assert len(plan) == 0
    assert plan.joints_rad.shape == (0, 6)
    assert dict(skipped_by_kind(plan))["out of reach"] == len(plan.skipped)


def test_tubes_over_the_table_are_reported_as_clearance() -> None:
    low = Outline(PLATE, part_frame(30.0, radius_m=1.21))
    plan = scan_plan(low, ARM, READY_RAD, CELL, PlanParameters(step_m=0.02))
    kinds = dict(skipped_by_kind(plan))
    assert kinds["clearance to the table"] > 10
    lowest = min(v for _, v in plan.uv_m.tolist())
    # The tubes reach 4.5 cm below the grip axis: rows below that height must be missing.
    assert 0.04 <= lowest <= 0.08
    reasons = [stop.reason for stop in plan.skipped if stop.reason.startswith("clearance")]
    assert "sensor tube" in reasons[0]
    assert "at least 5 mm" in reasons[0]


def test_joint_limits_are_named() -> None:
    class Hobbled(Puma560):
        @property
        def upper_rad(self) -> np.ndarray:
            return np.concatenate([LIMITS.upper_rad[:4], [np.radians(10.0)], LIMITS.upper_rad[5:]])

        @property
        def lower_rad(self) -> np.ndarray:
            return np.concatenate([LIMITS.lower_rad[:4], [np.radians(-10.0)], LIMITS.lower_rad[5:]])

    arm = Hobbled(pose(np.eye(3), [0, 0, STAND_HEIGHT_M]), pose(np.eye(3), [0, 0, 0.08 - FLANGE_OFFSET_M]))
    plan = scan_plan(plate(), arm, READY_RAD, None, PlanParameters(step_m=0.05))
    assert len(plan) == 0
    assert any(stop.reason.startswith("joint limit: joint 5 would be at") for stop in plan.skipped)


def test_singular_stops_are_named() -> None:
    plan = scan_plan(plate(), ARM, READY_RAD, None, PlanParameters(step_m=0.05), ReachParameters(singularity_min=0.99))
    assert len(plan) == 0
    assert any("singularity: 0." in stop.reason for stop in plan.skipped)


def test_a_stop_behind_a_wall_is_left_out_because_of_the_way() -> None:
    # Two groups of stops, a thin wall between the tubes' places: every stop is clear, the way between them is not.
    middle = part_frame(0.0)
    wall = Box((-0.005, -1.0, 0.22), (0.005, 1.0, 0.5), middle, name="the wall")
    walled = ClearanceModel(ARM.link_poses, BODY, (wall,))
    uv = np.array([[-0.10, 0.1], [-0.09, 0.1], [0.09, 0.1], [0.10, 0.1], [-0.10, 0.11], [0.10, 0.11], [-0.09, 0.11]])
    targets = grip_targets(middle, uv)
    alone = [reach(target[None], ARM, READY_RAD, walled).reached[0] for target in targets]
    assert all(alone)
    checked = reach(targets, ARM, READY_RAD, walled)
    assert checked.reached.tolist() == [True, True, False, False, True, False, True]
    assert checked.reason[2].startswith("way from the stop before: the ")
    assert "inside the wall" in checked.reason[2]
    assert np.isnan(checked.joints_rad[2]).all()


def test_the_plan_holds_one_configuration_even_if_another_reaches_single_stops() -> None:
    targets = scan_plan(plate(-170.0), ARM, READY_RAD, CELL, PlanParameters(step_m=0.04)).world_from_grip
    solutions, valid = ARM.inverse(targets)
    joints = reach(targets, ARM, READY_RAD, CELL).joints_rad
    same = [
        np.all(np.abs(np.angle(np.exp(1j * (solutions[:, k] - joints)))) < 1e-9) and valid[:, k].all() for k in range(8)
    ]
    assert sum(same) == 1


def test_no_targets_is_an_answer() -> None:
    checked = reach(np.zeros((0, 4, 4)), ARM, READY_RAD, CELL)
    assert checked.reached.shape == (0,)
    assert checked.joints_rad.shape == (0, 6)


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        (PlanParameters, {"step_m": 0.0}),
        (PlanParameters, {"standoff_m": np.nan}),
        (PlanParameters, {"lowest_v_m": np.nan}),
        (ReachParameters, {"clearance_min_m": -1.0}),
        (ReachParameters, {"singularity_min": 1.0}),
        (ReachParameters, {"path_resolution_rad": 0.0}),
    ],
)
def test_parameters_out_of_their_limits_are_refused(kind: type, change: dict) -> None:
    with pytest.raises(ConfigError, match=next(iter(change))):
        dataclasses.replace(kind(), **change)


def test_a_given_margin_wins_over_the_outline_s_uncertainty() -> None:
    unsure = dataclasses.replace(plate(), sigma_m=np.full(4, 0.01))
    coarse = PlanParameters(step_m=0.04)
    assert scan_plan(unsure, ARM, READY_RAD, CELL, coarse).outline.margin_m == pytest.approx(
        0.008 + 2.3263 * 0.01, abs=1e-5
    )
    given = dataclasses.replace(coarse, margin_m=0.005)
    assert scan_plan(unsure, ARM, READY_RAD, CELL, given).outline.margin_m == 0.005
