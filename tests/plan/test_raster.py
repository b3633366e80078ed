import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from surfuse.errors import ConfigError
from surfuse.geometry.polygons import signed_distance
from surfuse.geometry.poses import is_rigid, pose, rotation_about
from surfuse.plan.margin import enlarged
from surfuse.plan.raster import grip_targets, raster
from surfuse.records import Outline

PLATE = np.array([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]])
TWO_TOWERS = np.array(
    [[-0.1, 0], [0.1, 0], [0.1, 0.2], [0.05, 0.2], [0.05, 0.05], [-0.05, 0.05], [-0.05, 0.2], [-0.1, 0.2]]
)


def outline(vertices: np.ndarray) -> Outline:
    return Outline(vertices, np.eye(4))


def test_margin_moves_the_edges_out() -> None:
    grown = enlarged(outline(PLATE), 0.02)
    assert_allclose(grown.vertices_m, [[-0.12, -0.02], [0.12, -0.02], [0.12, 0.22], [-0.12, 0.22]], atol=1e-12)
    assert grown.margin_m == 0.02
    assert enlarged(grown, 0.01).margin_m == pytest.approx(0.03)
    with pytest.raises(ConfigError, match="margin_m"):
        enlarged(outline(PLATE), -0.01)


def test_the_plate_with_margin_has_25_lines_of_25_stops() -> None:
    stops = raster(enlarged(outline(PLATE), 0.02), 0.01)
    assert stops.uv_m.shape == (625, 2)
    assert np.bincount(stops.row).tolist() == [25] * 25
    assert_allclose(stops.uv_m.min(axis=0), [-0.12, -0.02], atol=1e-12)
    assert_allclose(stops.uv_m.max(axis=0), [0.12, 0.22], atol=1e-12)


def test_lines_alternate_or_start_at_the_same_side() -> None:
    alternating = raster(outline(PLATE), 0.02)
    step = np.diff(alternating.uv_m, axis=0)
    assert_allclose(np.linalg.norm(step, axis=1), 0.02, atol=1e-12)
    same = raster(outline(PLATE), 0.02, same_side=True)
    for row in range(same.row.max() + 1):
        assert np.all(np.diff(same.uv_m[same.row == row, 0]) > 0.0)


def test_a_line_over_two_towers_is_one_row_of_two_pieces() -> None:
    stops = raster(outline(TWO_TOWERS), 0.01)
    top = stops.uv_m[stops.row == stops.row.max()]
    assert_allclose(np.sort(top[:, 0]), [*np.arange(-10, -4) * 0.01, *np.arange(5, 11) * 0.01], atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.floats(0.03, 0.3), min_size=3, max_size=10),
    st.floats(0.004, 0.05),
    st.floats(-0.5, 0.5),
    st.floats(-0.5, 0.5),
)
def test_the_raster_is_every_lattice_point_of_the_outline(
    radii: list[float], step: float, du: float, dv: float
) -> None:
    angle = 2.0 * np.pi * np.arange(len(radii)) / len(radii)
    vertices = np.array(radii)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]) + [du, dv]
    stops = raster(outline(vertices), step)
    index = stops.uv_m / step
    assert_allclose(index, np.round(index), atol=1e-9)
    lattice = np.stack(np.meshgrid(*[np.arange(np.floor(-0.9 / step), 0.9 / step)] * 2), axis=-1).reshape(-1, 2) * step
    inside = signed_distance(lattice, vertices)
    expected = {tuple(p) for p in np.round(lattice[inside > 1e-6 * step] / step).astype(int).tolist()}
    allowed = {tuple(p) for p in np.round(lattice[inside > -1e-4 * step] / step).astype(int).tolist()}
    got = [tuple(p) for p in np.round(index).astype(int).tolist()]
    assert len(set(got)) == len(got)
    assert expected <= set(got) <= allowed
    assert np.all(np.diff(stops.row) >= 0)


def test_steps_that_make_no_sense_are_refused() -> None:
    for step in (0.0, -0.01, np.nan):
        with pytest.raises(ConfigError, match="step_m"):
            raster(outline(PLATE), step)
    with pytest.raises(ConfigError, match="larger step"):
        raster(outline(PLATE), 1e-5)


def test_an_outline_smaller_than_a_step_may_have_no_stop() -> None:
    speck = np.array([[0.011, 0.011], [0.013, 0.011], [0.012, 0.013]])
    assert raster(outline(speck), 0.01).uv_m.shape == (0, 2)


def test_the_grip_looks_at_its_point_from_the_standoff() -> None:
    world_from_part = pose(rotation_about([0.2, -0.5, 1.0], 0.9), [1.0, 0.3, 1.0])
    uv = np.array([[0.0, 0.0], [0.05, 0.1]])
    for target, (u, v) in zip(grip_targets(world_from_part, uv, 0.43), uv, strict=True):
        assert is_rigid(target)
        assert_allclose(target @ [0, 0, 0.43, 1], world_from_part @ [u, v, 0, 1], atol=1e-12)
        assert_allclose(target[:3, 2], -world_from_part[:3, 2], atol=1e-12)
        assert_allclose(target[:3, 1], world_from_part[:3, 1], atol=1e-12)


@pytest.mark.parametrize("same_side", [False, True])
def test_the_first_line_begins_at_its_least_u(same_side: bool) -> None:
    square = Outline([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.1], [-0.1, 0.1]], np.eye(4))
    stops = raster(square, 0.02, same_side)
    for row in range(int(stops.row.max()) + 1):
        rising = np.diff(stops.uv_m[stops.row == row, 0]) > 0.0
        assert np.all(rising) if same_side or row % 2 == 0 else not np.any(rising)
