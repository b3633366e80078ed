"""What belongs to the part, as the camera saw it: down to the foot on the table, no further than the rim."""

import numpy as np
import pytest

from surfuse.confidence.outline_view import eye_of, on_part
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import Outline

BOX = np.array([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]])
EYE = np.array([0.05, 0.3, 0.9])


def outline(world_from_part=None, **how):
    placed = np.eye(4) if world_from_part is None else world_from_part
    return Outline(BOX, placed, **{"viewpoint_m": EYE, **how})


def drawn(points, eye=EYE):
    """Where the rays from the eye through points meet the plane w = 0."""
    share = eye[2] / (eye[2] - points[:, 2:])
    return eye[:2] + share * (points[:, :2] - eye[:2])


def inside_box(seen, slack=1e-9):
    return np.all((seen >= BOX.min(axis=0) - slack) & (seen <= BOX.max(axis=0) + slack), axis=1)


def test_above_the_table_a_point_belongs_where_its_ray_meets_the_outline_or_the_table_below_it():
    points = np.random.default_rng(0).uniform([-0.15, 0.0, -0.1], [0.15, 0.25, 0.1], (2000, 3))
    seen = drawn(points)
    below = seen[:, 1] < 0.0
    assert 50 < np.sum(below) < 500
    seen[below, 1] = 0.0
    np.testing.assert_array_equal(on_part(points, np.eye(4), outline()), inside_box(seen))


def test_below_the_table_nothing_is_lifted():
    points = np.array([[0.0, -0.01, 0.0], [0.0, -0.001, 0.05], [0.0, 0.0, 0.05]])
    assert on_part(points, np.eye(4), outline()).tolist() == [False, False, True]


@pytest.mark.parametrize("eye", [None, [0.0, 0.0, 0.0], [0.0, 0.3, -1.0]])
def test_without_a_place_of_the_camera_points_are_seen_along_w(eye):
    points = np.random.default_rng(1).uniform([-0.15, -0.05, -0.1], [0.15, 0.25, 0.1], (500, 3))
    plain = outline(viewpoint_m=None if eye is None else np.array(eye))
    assert not eye_of(plain).any()
    np.testing.assert_array_equal(on_part(points, np.eye(4), plain), inside_box(points[:, :2]))


def test_the_frame_of_the_points_may_be_anywhere():
    points = np.random.default_rng(2).uniform([-0.15, 0.0, -0.1], [0.15, 0.25, 0.1], (500, 3))
    there, here = pose(rotation_about([0.3, -1.0, 0.2], 1.1), [1.0, -2.0, 0.5]), pose(np.eye(3), [0.2, 0.0, 0.1])
    moved = outline(world_from_part=there @ here)
    expected = on_part(points - here[:3, 3], np.eye(4), outline())
    np.testing.assert_array_equal(on_part(points, there, moved), expected)
    assert 0 < expected.sum() < 500


def test_margin_shrinks_holes_are_cut_and_the_median_deviation_is_granted():
    across = np.column_stack([np.linspace(-0.12, 0.12, 241), np.full(241, 0.1), np.zeros(241)])
    u = across[:, 0]
    hole = BOX * 0.2 + [0.0, 0.08]
    shrunk = on_part(across, np.eye(4), outline(margin_m=0.0205))
    np.testing.assert_array_equal(shrunk, np.abs(u) < 0.0795)
    pierced = on_part(across, np.eye(4), outline(holes_m=(hole,)))
    np.testing.assert_array_equal(pierced, (np.abs(u) < 0.1005) & (np.abs(u) > 0.0195))
    unsure = on_part(across, np.eye(4), outline(sigma_m=np.array([0.0055, 0.0055, 0.0055, 0.05])))
    np.testing.assert_array_equal(unsure, np.abs(u) < 0.1055)
