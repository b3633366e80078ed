import numpy as np
import pytest

from surfuse.errors import ConfigError, DataError
from surfuse.geometry.poses import pose, rotation_about
from surfuse.twin.materials import MATERIALS, Material, Surface, table_of
from surfuse.twin.parts import make_part
from surfuse.twin.scene import Scene, SceneBody, TableParameters, table_bodies


def plain_cast(scene: Scene, origin: np.ndarray, direction: np.ndarray) -> float:
    """Moeller-Trumbore over every triangle, in float64."""
    nearest = np.inf
    for a, b, c in scene.vertices_m[scene.triangles]:
        e1, e2 = b - a, c - a
        p = np.cross(direction, e2)
        det = e1 @ p
        if abs(det) < 1e-14:
            continue
        s = origin - a
        u, v = s @ p / det, direction @ np.cross(s, e1) / det
        t = e2 @ np.cross(s, e1) / det
        if u >= 0 and v >= 0 and u + v <= 1 and 1e-9 < t < nearest:
            nearest = t
    return nearest


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene([*table_bodies(TableParameters(segments=16)), make_part("relief").body])


def test_cast_agrees_with_a_plain_ray_triangle_test(scene: Scene) -> None:
    generator = np.random.default_rng(1)
    origin = np.array([0.6, 0.03, 1.08])
    directions = np.array([1.0, 0.0, -0.02]) + 0.35 * generator.normal(size=(150, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    distance, triangle = scene.cast(np.tile(origin, (150, 1)), directions)
    expected = np.array([plain_cast(scene, origin, direction) for direction in directions])
    same = np.isclose(distance, expected, atol=1e-9) | (np.isinf(distance) & np.isinf(expected))
    assert np.mean(same) > 0.99  # a ray through an edge may choose either side
    assert np.array_equal(triangle < 0, np.isinf(distance))


def test_distances_are_exact_far_from_the_world_origin() -> None:
    corners = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    turn = rotation_about([0.3, 1.0, -0.2], 0.7)
    there = np.array([812.0, -377.0, 95.0])
    scene = Scene([SceneBody(corners, np.array([[0, 1, 2]]), Material.PART, pose(turn, there))])
    distance, triangle = scene.cast(there + turn @ np.array([0.0, 0.0, 0.4321]), turn @ np.array([0.0, 0.0, -1.0]))
    assert triangle.tolist() == [0]
    assert distance[0] == pytest.approx(0.4321, abs=1e-9)


def test_the_table_is_where_the_cell_says(scene: Scene) -> None:
    down = np.array([0.0, 0.0, -1.0])
    origins = np.array([[1.0, 0.3, 1.5], [0.5, 0.0, 1.5], [1.3, 0.0, 1.5], [20.0, 0.0, 1.5]])
    distance, triangle = scene.cast(origins, np.tile(down, (4, 1)))
    assert distance[:3] == pytest.approx([0.5, 1.5, 1.5], abs=1e-9)
    assert np.isinf(distance[3])
    assert triangle[3] == -1
    assert [Material(scene.material[t]) for t in triangle[:3]] == [Material.TABLE, Material.FLOOR, Material.FLOOR]
    assert scene.normal[triangle[0]] == pytest.approx([0.0, 0.0, 1.0])


def test_a_ray_that_is_not_a_number_meets_nothing(scene: Scene) -> None:
    distance, triangle = scene.cast(np.zeros((1, 3)), np.full((1, 3), np.nan))
    assert np.isinf(distance[0])
    assert triangle[0] == -1


def test_arrays_are_read_only(scene: Scene) -> None:
    for array in (scene.vertices_m, scene.triangles, scene.normal, scene.material, scene.offset_m):
        with pytest.raises(ValueError):
            array[0] = 0


def test_bad_bodies_are_refused() -> None:
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    with pytest.raises(DataError, match="no bodies"):
        Scene([])
    with pytest.raises(DataError, match="no triangle with an area"):
        Scene([SceneBody(corners, np.array([[0, 0, 1]]), Material.PART, np.eye(4))])
    with pytest.raises(DataError, match="vertex 7 of 3"):
        Scene([SceneBody(corners, np.array([[0, 1, 7]]), Material.PART, np.eye(4))])
    with pytest.raises(DataError, match="not finite"):
        Scene([SceneBody(np.full((3, 3), np.inf), np.array([[0, 1, 2]]), Material.PART, np.eye(4))])


@pytest.mark.parametrize(
    "wrong",
    [{"inner_radius_m": 2.0}, {"table_thickness_m": 1.5}, {"segments": 3}, {"outer_radius_m": float("nan")}],
)
def test_impossible_cells_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="give"):
        TableParameters(**wrong)


def test_every_material_has_properties() -> None:
    assert set(MATERIALS) == set(Material)
    assert table_of("albedo")[Material.PART] == MATERIALS[Material.PART].albedo
    with pytest.raises(ConfigError, match="albedo"):
        Surface(0.0, 1.0, 0.0, 1.5)
