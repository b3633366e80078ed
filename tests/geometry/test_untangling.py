"""Polygons without their small loops."""

import numpy as np
import pytest

from surfuse.geometry.polygons import is_simple
from surfuse.geometry.untangling import untangled

SQUARE = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])


def test_simple_polygon_keeps_every_vertex():
    assert untangled(SQUARE).tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("shift", range(8))
@pytest.mark.parametrize("direction", [1, -1])
def test_small_loop_goes_and_the_rest_stays(shift, direction):
    # A small bow at the lower right corner: the edge to it crosses the edge from it.
    tangled = np.array([[0, 0], [4, 0], [4.2, 0.2], [4.2, -0.2], [4, 0.1], [4, 4], [2, 4.5], [0, 4]], dtype=float)
    points = np.roll(tangled, shift, axis=0)[::direction]
    assert not is_simple(points)
    kept = points[untangled(points)]
    assert is_simple(kept)
    for corner in ((0, 0), (4, 4), (2, 4.5), (0, 4)):
        assert np.any(np.all(kept == corner, axis=1))


def test_repeated_vertices_and_spikes_go():
    spiked = np.array([[0, 0], [4, 0], [4, 0], [4, 4], [6, 4], [4, 4], [0, 4]], dtype=float)
    kept = spiked[untangled(spiked)]
    assert is_simple(kept)
    assert np.ptp(kept, axis=0).tolist() == [4.0, 4.0]


def test_random_polygons_become_simple_or_vanish():
    generator = np.random.default_rng(3)
    for _ in range(100):
        points = generator.normal(size=(generator.integers(3, 15), 2))
        kept = points[untangled(points)]
        assert len(kept) < 3 or is_simple(kept)


def test_no_area_at_all_leaves_nothing():
    assert len(untangled(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]))) < 3
