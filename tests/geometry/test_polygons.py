import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from surfuse.errors import DataError
from surfuse.geometry.offsets import offset
from surfuse.geometry.polygons import (
    contains,
    counter_clockwise,
    is_simple,
    perimeter,
    signed_area,
    signed_distance,
    signed_distance_at,
    signed_distances_into,
    spans,
)

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
NOTCHED = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [2.5, 3.0], [2.5, 1.0], [1.5, 1.0], [1.5, 3.0], [0.0, 3.0]])


def star(radii: list[float]) -> np.ndarray:
    angle = 2.0 * np.pi * np.arange(len(radii)) / len(radii)
    return np.array(radii)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


stars = st.lists(st.floats(0.05, 1.0), min_size=3, max_size=14).map(star)


def plain_distance(point: np.ndarray, polygon: np.ndarray) -> float:
    """Distance by dense sampling of the boundary, sign by the sum of the angles under which the edges are seen."""
    t = np.linspace(0.0, 1.0, 4001)[:, None]
    ends = np.roll(polygon, -1, axis=0)
    nearest = min(np.min(np.linalg.norm(a + t * (b - a) - point, axis=1)) for a, b in zip(polygon, ends, strict=True))
    a, b = polygon - point, ends - point
    angle = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], np.sum(a * b, axis=1)).sum()
    return nearest if abs(angle) > np.pi else -nearest


def test_area_of_known_shapes_and_its_sign() -> None:
    assert signed_area(SQUARE) == 2.0
    assert signed_area(SQUARE[::-1]) == -2.0
    assert signed_area(NOTCHED) == 10.0
    assert perimeter(SQUARE) == 6.0
    assert_allclose(signed_area(SQUARE + 1e6), 2.0, rtol=1e-9)
    assert_allclose(counter_clockwise(SQUARE[::-1]), SQUARE)


def test_signed_distance_of_a_box_in_closed_form() -> None:
    points = np.array([[1.0, 0.5], [1.0, 0.9], [3.0, 0.5], [3.0, 2.0], [-3.0, -4.0], [0.2, 0.5]])
    expected = [0.5, 0.1, -1.0, -np.sqrt(2.0), -5.0, 0.2]
    assert_allclose(signed_distance(points, SQUARE), expected, atol=1e-15)
    assert_allclose(signed_distance(points, SQUARE[::-1]), expected, atol=1e-15)
    assert contains(points, SQUARE).tolist() == [True, True, False, False, False, True]


def test_points_on_the_boundary_are_contained() -> None:
    assert contains(np.vstack([SQUARE, [[1.0, 0.0], [1.0, 1.0], [2.0, 0.5], [0.0, 0.5]]]), SQUARE).all()


@settings(max_examples=30, deadline=None)
@given(stars, st.floats(-1.2, 1.2), st.floats(-1.2, 1.2))
def test_signed_distance_is_that_of_a_plain_reference(polygon: np.ndarray, x: float, y: float) -> None:
    assert_allclose(signed_distance_at(x, y, polygon), plain_distance(np.array([x, y]), polygon), atol=2e-3)
    python = signed_distance_at.py_func  # type: ignore[attr-defined]
    assert signed_distance_at(x, y, polygon) == python(x, y, polygon)


def test_simple_and_crossing_polygons() -> None:
    assert is_simple(SQUARE)
    assert is_simple(NOTCHED)
    assert not is_simple(SQUARE[[0, 2, 1, 3]])
    assert not is_simple([[0, 0], [2, 0], [1, 0], [1, 1]])
    assert not is_simple([[0, 0], [2, 0], [2, 2], [1, 0], [0, 2]])
    assert not is_simple([[0, 0], [1, 0]])
    assert not is_simple([[0, 0], [1, 0], [np.nan, 1]])


def test_spans_cut_a_notch_into_two_intervals() -> None:
    assert_allclose(spans(NOTCHED, 2.0), [[0.0, 1.5], [2.5, 4.0]])
    assert_allclose(spans(NOTCHED, 0.5), [[0.0, 4.0]])
    assert spans(NOTCHED, 3.5).shape == (0, 2)


def test_spans_of_the_lowest_and_the_highest_edge_are_the_full_width() -> None:
    assert_allclose(spans(SQUARE, 0.0), [[0.0, 2.0]])
    assert_allclose(spans(SQUARE, 1.0), [[0.0, 2.0]])
    assert_allclose(spans(NOTCHED, 1.0), [[0.0, 4.0]])


@settings(max_examples=60, deadline=None)
@given(stars, st.floats(-1.0, 1.0))
def test_points_in_a_span_are_inside(polygon: np.ndarray, v: float) -> None:
    for low, high in spans(polygon, v):
        assert np.all(signed_distance(np.column_stack([np.linspace(low, high, 7), np.full(7, v)]), polygon) > -1e-9)


def test_offset_of_a_box_is_a_larger_box() -> None:
    assert_allclose(offset(SQUARE, 0.25), [[-0.25, -0.25], [2.25, -0.25], [2.25, 1.25], [-0.25, 1.25]], atol=1e-12)
    assert_allclose(offset(SQUARE[::-1], 0.0), SQUARE)


def test_offset_keeps_a_wide_notch_and_closes_a_narrow_one() -> None:
    area = signed_area(offset(NOTCHED, 0.1))
    # Grown outline minus what is left of the notch: 0.8 wide, still 2.0 deep.
    assert_allclose(area, 4.2 * 3.2 - 0.8 * 2.0, rtol=1e-9)
    assert_allclose(signed_area(offset(NOTCHED, 0.6)), 5.2 * 4.2, rtol=1e-9)


def test_offset_cuts_sharp_corners_square() -> None:
    needle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.05]])
    grown = offset(needle, 0.1)
    assert grown[:, 0].max() < 1.0 + 0.1 * 1.03
    assert np.all(signed_distance(needle, grown) >= 0.1 - 1e-12)


@settings(max_examples=150, deadline=None)
@given(stars, st.floats(0.005, 0.6))
def test_offset_laws(polygon: np.ndarray, distance: float) -> None:
    grown = offset(polygon, distance)
    assert is_simple(grown)
    t = np.linspace(0.0, 1.0, 5)[:, None, None]
    edges = (polygon + t * (np.roll(polygon, -1, axis=0) - polygon)).reshape(-1, 2)
    assert np.all(signed_distance(edges, grown) >= distance - 1e-7)
    # No further out than the mitre limit allows.
    assert np.all(signed_distance(grown, polygon) >= -2.0 * distance - 1e-7)
    assert signed_area(grown) >= signed_area(polygon) + np.pi * distance**2 - 1e-7


@pytest.mark.parametrize("corners", [4, 5, 6, 12, 60])
def test_offset_of_a_regular_polygon_has_the_area_of_the_closed_form(corners: int) -> None:
    polygon, distance = star([1.0] * corners), 0.3
    mitres = corners * np.tan(np.pi / corners) * distance**2
    expected = signed_area(polygon) + perimeter(polygon) * distance + mitres
    assert_allclose(signed_area(offset(polygon, distance)), expected, rtol=1e-12)


def test_offset_of_a_long_contour() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    radius = 0.1 + 0.01 * np.sin(9.0 * angle)
    grown = offset(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]), 0.02)
    assert is_simple(grown)
    assert 0.129 < np.linalg.norm(grown, axis=1).max() < 0.1305


@pytest.mark.parametrize(
    ("polygon", "distance"),
    [(SQUARE[[0, 2, 1, 3]], 0.1), (SQUARE, -0.1), (SQUARE, np.nan), ([[0, 0], [1, 1], [2, 2]], 0.1)],
)
def test_offset_refuses_nonsense(polygon: np.ndarray, distance: float) -> None:
    with pytest.raises(DataError):
        offset(polygon, distance)


def test_many_distances_at_once_are_those_one_by_one_to_the_last_bit() -> None:
    rng = np.random.default_rng(8)
    for vertices in (3, 4, 11):
        polygon = rng.normal(size=(vertices, 2))
        polygon[1] = polygon[0] if vertices == 11 else polygon[1]
        x, y = rng.normal(size=(2, 200))
        x[:vertices], y[:vertices] = polygon.T
        found = np.empty(200)
        signed_distances_into(x, y, polygon, found)
        wanted = np.array([signed_distance_at(a, b, polygon) for a, b in zip(x, y, strict=True)])
        assert found.tobytes() == wanted.tobytes()
