import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.arm_models import puma560_volume as volume
from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, LIMITS, Puma560
from surfuse.errors import ConfigError, SafetyStopError
from surfuse.geometry.poses import pose, rotation_about, transform_points
from surfuse.motion.body import Capsule, body_of, fixture_capsules
from surfuse.motion.clearance import ClearanceModel, check_move
from surfuse.motion.obstacles import Box, Column, Floor, RingTable, part_box
from surfuse.records import Fixture, Outline, SensorSpec

SPEC = SensorSpec("s", "sonar", 0.35, 4.0, 0.4, 0.001)
FIXTURE = Fixture(
    np.array([pose(np.eye(3), [x, y, 0.0]) for x in (-0.025, 0.025) for y in (-0.025, 0.025)]), (SPEC,) * 4
)


def sampled_distance(points: np.ndarray, solid_points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, None] - solid_points[None], axis=2).min(axis=1)


def test_ring_distance_in_closed_form() -> None:
    points = np.array(
        [[0.0, 0.0, 0.98], [1.1, 0.0, 1.3], [0.0, -1.1, 0.97], [0.65, 0.0, 1.4], [0.0, 1.55, 1.4], [1.1, 0, 0.5]]
    )
    assert_allclose(RingTable().distance(points), [0.95, 0.3, -0.02, 0.5, 0.5, 0.45], atol=1e-12)


def test_column_floor_and_box_in_closed_form() -> None:
    points = np.array([[0.3, 0.0, 0.5], [0.0, 0.0, 1.5], [0.4, 0.0, 1.4], [0.0, 0.05, 0.0]])
    assert_allclose(Column(top_m=1.0, radius_m=0.1).distance(points), [0.2, 0.5, 0.5, -0.05], atol=1e-12)
    assert_allclose(Floor(0.1).distance(points), points[:, 2] - 0.1)
    turned = pose(rotation_about([0.3, 1.0, -0.2], 0.8), [0.5, -0.2, 1.0])
    box = Box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0), turned)
    own = np.array([[-1.0, 1.0, 1.0], [4.0, 6.0, 1.0], [0.5, 1.0, 0.2], [0.9, 1.0, 1.0], [2.0, 4.0, 5.0]])
    assert_allclose(box.distance(transform_points(turned, own)), [1.0, 5.0, -0.2, -0.1, 3.0], atol=1e-12)


def test_the_box_of_a_part_stands_on_its_outline() -> None:
    facing = pose(np.column_stack([[0, -1, 0], [0, 0, 1], [-1, 0, 0]]), [1.05, 0.0, 1.0])
    box = part_box(Outline([[-0.1, 0.0], [0.1, 0.0], [0.0, 0.2]], facing), front_m=0.05, back_m=0.2)
    points = np.array([[0.8, 0.0, 1.1], [1.35, 0.0, 1.1], [1.1, 0.3, 1.1], [1.1, 0.0, 1.5]])
    assert_allclose(box.distance(points), [0.2, 0.1, 0.2, 0.3], atol=1e-12)


def test_a_box_is_as_far_as_its_sampled_surface() -> None:
    rng = np.random.default_rng(0)
    surface = rng.uniform(-0.1, 0.1, (4000, 3))
    surface[np.arange(4000), rng.integers(0, 3, 4000)] = rng.choice([-0.1, 0.1], 4000)
    points = rng.uniform(0.12, 0.4, (20, 3)) * rng.choice([-1.0, 1.0], (20, 3))
    box = Box((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1), np.eye(4))
    assert_allclose(box.distance(points), sampled_distance(points, surface), atol=0.01)


def test_spheres_contain_their_capsule() -> None:
    capsule = Capsule("rod", 1, (0.0, 0.1, 0.0), (0.3, -0.2, 0.5), 0.06)
    body = body_of([capsule])
    rng = np.random.default_rng(1)
    t = rng.uniform(0.0, 1.0, (3000, 1))
    skin = np.array(capsule.start_m) + t * np.subtract(capsule.end_m, capsule.start_m)
    normal = rng.normal(size=(3000, 3))
    skin += 0.06 * normal / np.linalg.norm(normal, axis=1)[:, None]
    assert np.all((np.linalg.norm(skin[:, None] - body.center_m, axis=2) - body.radius_m).min(axis=1) <= 1e-12)
    assert body.radius_m.max() <= 0.06 * 1.12


def test_the_fixture_ends_at_the_mouths_of_its_tubes() -> None:
    body = body_of(fixture_capsules(FIXTURE, 7))
    front = (body.center_m[:, 2] + body.radius_m).max()
    assert 0.20 <= front < 0.2 + 0.003
    assert (body.center_m[:, 2] - body.radius_m).min() == pytest.approx(-0.08, abs=0.01)
    bare = body_of(fixture_capsules(FIXTURE, 7, tube_length_m=0.0))
    assert (bare.center_m[:, 2] + bare.radius_m).max() < 0.06


def arm() -> Puma560:
    return Puma560(pose(np.eye(3), [0, 0, 0.5]), pose(np.eye(3), [0, 0, 0.08 - FLANGE_OFFSET_M]))


def puma_model(*obstacles: object) -> ClearanceModel:
    body = body_of([*volume.CAPSULES, *fixture_capsules(FIXTURE, volume.TOOL_LINK)])
    return ClearanceModel(arm().link_poses, body, obstacles)  # type: ignore[arg-type]


def test_clearance_is_the_least_over_links_and_obstacles() -> None:
    obstacles = (RingTable(), Floor(), volume.column(0.5))
    model = puma_model(*obstacles)
    joints = np.random.default_rng(2).uniform(LIMITS.lower_rad, LIMITS.upper_rad, (40, 6))
    clearances = model(joints)
    for i, row in enumerate(joints):
        links = model.link_poses(row)
        best = (np.inf, "", "")
        for solid in obstacles:
            for part, link, center, radius in zip(
                model.body.part, model.body.link, model.body.center_m, model.body.radius_m, strict=True
            ):
                name = model.body.names[part]
                if name not in solid.ignores:
                    gap = solid.distance(transform_points(links[link], center)[None])[0] - radius
                    best = min(best, (gap, name, solid.name))
        assert clearances.distance_m[i] == pytest.approx(best[0], abs=1e-12)
        assert clearances.parts[clearances.part[i]] == best[1]
        assert clearances.obstacles[clearances.obstacle[i]] == best[2]


def test_the_upright_arm_is_clear_and_a_reach_into_the_table_is_not() -> None:
    model = puma_model(RingTable(), Floor(), volume.column(0.5))
    assert model(np.radians([[0.0, 80.0, -215.0, 0.0, 45.0, 0.0]])).distance_m[0] > 0.05
    beams_forward = pose(np.column_stack([[0, -1, 0], [0, 0, -1], [1, 0, 0]]), [0.85, 0.0, 1.0])
    low = model(arm().inverse(beams_forward[None])[0][0, 5:6])
    assert low.distance_m[0] < 0.0
    assert "table" in low.describe(0)


def test_nan_joints_have_no_clearance_and_no_obstacle_means_infinity() -> None:
    assert np.isnan(puma_model(Floor())(np.full((1, 6), np.nan)).distance_m[0])
    assert np.isinf(puma_model()(np.zeros((1, 6))).distance_m[0])


def test_a_move_through_an_obstacle_is_refused_although_both_ends_are_clear() -> None:
    start, end = np.radians([-60.0, 45.0, -180.0, 0.0, 45.0, 0.0]), np.radians([60.0, 45.0, -180.0, 0.0, 45.0, 0.0])
    wall = Box((0.7, -0.05, 0.9), (1.2, 0.05, 1.5), np.eye(4), name="the wall")
    model = puma_model(wall)
    assert np.all(model(np.array([start, end])).distance_m > 0.05)
    check_move(model, start, start, 0.01)
    with pytest.raises(SafetyStopError, match="the wall"):
        check_move(model, start, end, 0.01)


def test_solids_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ConfigError):
        RingTable(inner_radius_m=1.3)
    with pytest.raises(ConfigError):
        Box((0.0, 0.0, 0.0), (1.0, -1.0, 1.0), np.eye(4))
    with pytest.raises(ConfigError):
        Capsule("rod", 0, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.0)
