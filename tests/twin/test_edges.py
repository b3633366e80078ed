import numpy as np
import pytest
import trimesh

from surfuse.twin.acoustics.edges import NO_EDGES, sharp_edges
from surfuse.twin.materials import Material
from surfuse.twin.parts import make_part
from surfuse.twin.scene import Scene, SceneBody, table_bodies


def body(mesh: trimesh.Trimesh, material: Material = Material.PART) -> SceneBody:
    return SceneBody(np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64), material, np.eye(4))


def test_a_box_has_twelve_edges_and_points_stand_off_outwards() -> None:
    edges = sharp_edges(Scene([body(trimesh.creation.box([0.3, 0.2, 0.1]))]), 0.005)
    assert edges.length_m.sum() == pytest.approx(4 * (0.3 + 0.2 + 0.1))
    assert edges.length_m.max() <= 0.005 + 1e-12
    outside = np.abs(edges.position_m) - np.array([0.15, 0.10, 0.05])
    assert np.all(np.sum(outside > 1e-3, axis=1) == 2)
    assert np.linalg.norm(edges.tangent, axis=1) == pytest.approx(1.0)
    across = np.einsum("kfi,ki->kf", edges.faces, edges.tangent)
    assert np.abs(across).max() < 1e-9


def test_smooth_bodies_and_the_floor_have_none_and_concave_edges_do_not_count() -> None:
    ball = body(trimesh.creation.icosphere(subdivisions=3, radius=0.1))
    assert len(sharp_edges(Scene([ball]), 0.01).length_m) == 0
    assert len(sharp_edges(Scene([table_bodies()[0]]), 0.01).length_m) == len(NO_EDGES.length_m)
    relief = sharp_edges(Scene([make_part("relief").body]), 0.01)
    # An L profile has six corners, five of them convex: five long edges and two outlines of the profile.
    outline = 2 * (0.095 + 0.2 + 0.005 + 0.1 + 0.09 + 0.1)
    assert relief.length_m.sum() == pytest.approx(5 * 0.2 + outline)


def test_the_rim_of_a_sheet_scatters() -> None:
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0, 0.2], [0, 0, 0.2]], dtype=np.float64)
    sheet = SceneBody(corners, np.array([[0, 1, 2], [0, 2, 3]]), Material.PART, np.eye(4))
    edges = sharp_edges(Scene([sheet]), 0.01)
    assert edges.length_m.sum() == pytest.approx(0.6)
    assert np.all(
        (edges.position_m[:, 0] < 0)
        | (edges.position_m[:, 0] > 0.1)
        | (edges.position_m[:, 2] < 0)
        | (edges.position_m[:, 2] > 0.2)
    )


def test_the_number_of_points_is_bounded() -> None:
    edges = sharp_edges(Scene([body(trimesh.creation.box([1.0, 1.0, 1.0]))]), 1e-4)
    assert len(edges.length_m) < 41_000
    assert edges.length_m.sum() == pytest.approx(12.0)
