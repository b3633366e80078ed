import numpy as np
import pytest

from surfuse.records import MapGrid, SurfaceMap
from surfuse.report.meshes import both_windings, map_mesh, quaternion_to, rod


def make(height, pose=None):
    height = np.asarray(height, dtype=float)
    rows, columns = height.shape
    grid = MapGrid(0.1 * np.arange(columns), 0.2 * np.arange(rows), np.eye(4) if pose is None else pose)
    zero = np.zeros(height.shape)
    return SurfaceMap(grid, height, zero, zero, zero, np.isfinite(height), zero, "test")


def area_vectors(vertices, faces):
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def test_a_flat_map_has_the_area_of_its_grid_and_faces_the_sensors():
    vertices, faces, height = map_mesh(make(np.full((4, 6), 0.3)), 10**6)
    total = area_vectors(vertices, faces).sum(axis=0)
    assert np.allclose(total, [0.0, 0.0, 0.5 * 0.6])
    assert np.all(height == 0.3)


def test_a_hole_leaves_out_the_cells_around_it():
    height = np.zeros((4, 4))
    height[1, 1] = np.nan
    vertices, faces, _ = map_mesh(make(height), 10**6)
    assert len(vertices) == 15
    assert len(faces) == 2 * (9 - 4)


def test_meshes_are_thinned(run_content):
    vertices, faces, _ = map_mesh(run_content.maps[1].surface, 300)
    assert 0 < len(vertices) < 400
    assert faces.max() < len(vertices)


def test_an_empty_map_has_no_triangles():
    _, faces, _ = map_mesh(make(np.full((3, 3), np.nan)), 100)
    assert len(faces) == 0


def test_both_windings_cancel():
    vertices, faces, _ = map_mesh(make(np.random.default_rng(0).random((5, 5))), 10**6)
    twice, both = both_windings(vertices, faces)
    assert np.allclose(area_vectors(twice, both).sum(axis=0), 0.0, atol=1e-12)


def test_a_rod_is_closed_and_has_its_volume():
    vertices, faces = rod(2.0, 0.5, sides=200)
    volume = np.einsum("ij,ij->", vertices[faces[:, 0]], area_vectors(vertices, faces)) / 3.0
    assert volume == pytest.approx(np.pi * 0.25 * 2.0, rel=1e-3)


@pytest.mark.parametrize("direction", [[0, 0, 1], [0, 0, -1], [1, 0, 0], [0.6, -0.48, 0.64], [0, -0.6, -0.8]])
def test_quaternion_turns_z_to_the_direction(direction):
    w, x, y, z = quaternion_to(np.array(direction, dtype=float))
    turned = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
    assert np.allclose(turned, direction, atol=1e-9)
    assert w * w + x * x + y * y + z * z == pytest.approx(1.0)
