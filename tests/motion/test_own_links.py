"""The arm's own links: distances against a plain reference, postures that collide, and those that do not."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.arm_models import puma560_volume as volume
from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, LIMITS, READY_RAD, STAND_HEIGHT_M, Puma560
from surfuse.errors import SafetyStopError
from surfuse.geometry.poses import pose
from surfuse.motion.body import Capsule, body_of, fixture_capsules
from surfuse.motion.clearance import ClearanceModel, check_move
from surfuse.motion.own_links import own_links, separable_pairs
from surfuse.records import Fixture, FloatArray, SensorSpec

SPEC = SensorSpec("s", "sonar", 0.35, 4.0, 0.4, 0.001)
SENSORS = Fixture(
    np.array([pose(np.eye(3), [x, y, 0.0]) for x in (-0.025, 0.025) for y in (-0.025, 0.025)]), (SPEC,) * 4
)
ARM = Puma560(pose(np.eye(3), [0, 0, STAND_HEIGHT_M]), pose(np.eye(3), [0, 0, 0.08 - FLANGE_OFFSET_M]))
RODS = (*volume.CAPSULES, *fixture_capsules(SENSORS, volume.TOOL_LINK))
OWN = own_links(RODS, volume.OWN_PAIRS)
CELL = ClearanceModel(ARM.link_poses, body_of(RODS), (volume.column(STAND_HEIGHT_M),), OWN)


def plain_gap(one: Capsule, other: Capsule, poses: FloatArray) -> float:
    """Distance of two rods by trying places along both, then finer ones around the best."""

    def ends(rod: Capsule) -> FloatArray:
        return np.array([poses[rod.link] @ np.append(end, 1.0) for end in (rod.start_m, rod.end_m)])[:, :3]

    (p, q), (r, s) = ends(one), ends(other)
    low, high = np.zeros(2), np.ones(2)
    for _ in range(12):
        a, b = np.linspace(low[0], high[0], 21), np.linspace(low[1], high[1], 21)
        gaps = np.linalg.norm((p + a[:, None, None] * (q - p)) - (r + b[:, None] * (s - r))[None], axis=2)
        i, j = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
        width = 0.15 * (high - low)
        center = np.array([a[i], b[j]])
        low, high = np.clip(center - width, 0.0, 1.0), np.clip(center + width, 0.0, 1.0)
    return float(gaps.min()) - one.radius_m - other.radius_m


def test_the_kernel_agrees_with_a_plain_search() -> None:
    joints = np.random.default_rng(0).uniform(LIMITS.lower_rad, LIMITS.upper_rad, (12, 6))
    poses = ARM.link_poses(joints)
    gaps, _ = OWN.nearest(poses)
    for i in range(len(joints)):
        pairs = [(RODS[a], RODS[b]) for a, b in OWN.pairs.tolist()]
        assert gaps[i] == pytest.approx(min(plain_gap(a, b, poses[i]) for a, b in pairs), abs=2e-6)


@pytest.mark.parametrize(
    ("one", "other", "gap"),
    [
        (((0, 0, 0), (1, 0, 0)), ((0.5, 0.3, 0), (0.5, 1, 0)), 0.3),
        (((0, 0, 0), (1, 0, 0)), ((0, 0.2, 0), (1, 0.2, 0)), 0.2),
        (((0, 0, 0), (1, 0, 0)), ((0.5, 0, 0), (2, 0, 0)), 0.0),
        (((0, 0, 0), (0, 0, 0)), ((0.3, 0, 0.4), (0.3, 0, 0.4)), 0.5),
        (((0, 0, 0), (0, 0, 0)), ((-1, 0.1, 0), (1, 0.1, 0)), 0.1),
        (((-1, 0, 0.2), (1, 0, 0.2)), ((0, -1, 0), (0, 1, 0)), 0.2),
        (((0, 0, 0), (1, 0, 0)), ((2, 0, 0), (3, 1, 0)), 1.0),
    ],
)
def test_distances_in_closed_form(one: tuple, other: tuple, gap: float) -> None:
    rods = (Capsule("a", 0, *one, 0.01), Capsule("b", 1, *other, 0.02))
    for pairs in ([("a", "b")], [("b", "a")]):
        assert_allclose(own_links(rods, pairs).nearest(np.tile(np.eye(4), (1, 2, 1, 1)))[0], gap - 0.03, atol=1e-12)


def test_the_tubes_do_not_go_through_the_own_upper_arm() -> None:
    # Elbow folded, wrist bent back as far as it goes.
    rng = np.random.default_rng(1)
    tried = rng.uniform(LIMITS.lower_rad, LIMITS.upper_rad, (20000, 6))
    gaps, pair = OWN.nearest(ARM.link_poses(tried))
    meets = [volume.UPPER_ARM in (OWN.names[OWN.part[a]], OWN.names[OWN.part[b]]) for a, b in OWN.pairs[pair].tolist()]
    folded = tried[np.argmin(np.where(meets, gaps, np.inf))]
    found = CELL(folded[None])
    assert found.distance_m[0] < 0.0
    with pytest.raises(SafetyStopError, match=r"sensor tube would be \d+ mm inside the arm's own (upper arm|forearm)"):
        check_move(ClearanceModel(ARM.link_poses, CELL.body, (), OWN), READY_RAD, folded, 0.005)


def test_the_tubes_do_not_go_through_the_own_forearm() -> None:
    bent = np.radians([0.0, 45.0, -90.0, 0.0, 0.0, 45.0])
    bent[4] = LIMITS.upper_rad[4]
    found = CELL(bent[None])
    assert found.distance_m[0] < 0.005
    assert found.describe(0).endswith("the arm's own forearm")


def test_the_elbow_does_not_fold_into_the_column() -> None:
    postures = np.array(
        [np.radians([0.0, a, b, 0.0, 0.0, 0.0]) for a in range(-40, 221, 10) for b in range(-220, 41, 10)]
    )
    found = CELL(postures)
    inside = np.flatnonzero(found.distance_m < 0.0)
    words = {found.describe(int(i)).split("mm ")[1] for i in inside}
    assert "inside the arm's column" in words


def test_ready_and_scanning_postures_are_clear() -> None:
    assert CELL(READY_RAD[None]).distance_m[0] > 0.005
    check_move(CELL, READY_RAD, READY_RAD + np.radians([90.0, 0, 0, 0, 0, 0]), 0.005)


def test_an_arm_of_which_only_the_shape_is_known_gets_its_far_pairs() -> None:
    found = separable_pairs(RODS, ARM.link_poses, LIMITS.lower_rad, LIMITS.upper_rad, READY_RAD)
    known = {frozenset(pair) for pair in volume.OWN_PAIRS}
    # The tubes may count as neighbours of the forearm: they stand a finger's breadth from it.
    assert {frozenset(pair) for pair in volume.OWN_PAIRS[:3]} <= {frozenset(pair) for pair in found} <= known


def test_a_wide_berth_for_others_does_not_apply_to_own_links() -> None:
    check_move(ClearanceModel(ARM.link_poses, CELL.body, (), OWN), READY_RAD, READY_RAD, 0.2)


def test_nan_joints_have_no_clearance_and_no_pair_means_none() -> None:
    assert np.isnan(CELL(np.full((1, 6), np.nan)).distance_m[0])
    alone = ClearanceModel(ARM.link_poses, CELL.body, (), own_links(RODS, ()))
    assert alone(READY_RAD[None]).distance_m[0] == np.inf
