"""The truth of the twin: triangle meshes in the world frame, merged into one ray-casting scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from surfuse.errors import ConfigError, DataError
from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import FloatArray, IntArray
from surfuse.twin.materials import Material

_SMALLEST_AREA_M2 = 1e-12
_GRAZING = 1e-6


@dataclass(frozen=True)
class SceneBody:
    """One rigid thing: vertices (V, 3) in m in its own frame, triangles (F, 3) wound counter-clockwise from outside.

    `world_from_body` (4, 4) puts it into the world; `material` is that of all its triangles.
    """

    vertices_m: FloatArray
    triangles: IntArray
    material: Material
    world_from_body: FloatArray

    def world_vertices(self) -> FloatArray:
        """Vertices (V, 3) in the world frame."""
        return transform_points(self.world_from_body, self.vertices_m)


@dataclass(frozen=True)
class TableParameters:
    """The ring table around the arm and the floor.

    Parameters
    ----------
    table_height_m : height of the table's top over the floor.
    inner_radius_m, outer_radius_m : radii of the ring, the arm's first axis is its centre.
    table_thickness_m : thickness of the table's top.
    floor_half_width_m : half the side of the square floor.
    segments : straight pieces that stand for the circle.
    """

    table_height_m: float = 1.0
    inner_radius_m: float = 0.95
    outer_radius_m: float = 1.25
    table_thickness_m: float = 0.03
    floor_half_width_m: float = 4.0
    segments: int = 64

    def __post_init__(self) -> None:
        if not 0.0 < self.inner_radius_m < self.outer_radius_m < self.floor_half_width_m:
            raise ConfigError(
                f"cell radii {self.inner_radius_m} and {self.outer_radius_m} m on a floor of half width "
                f"{self.floor_half_width_m} m",
                cure="give 0 < inner_radius_m < outer_radius_m < floor_half_width_m",
            )
        if not 0.0 < self.table_thickness_m < self.table_height_m:
            raise ConfigError(
                f"table_thickness_m = {self.table_thickness_m} and table_height_m = {self.table_height_m}",
                cure="give 0 < thickness < height, in metres",
            )
        if not 8 <= self.segments <= 4096:
            raise ConfigError(f"cell segments = {self.segments}", cure="give 8 to 4096")


class Scene:
    """All bodies as one immutable set of triangles with one Embree scene.

    Attributes (read-only arrays): `vertices_m` (V, 3) and `triangles` (F, 3) in the world frame; per triangle
    `material` (F,), `body` (F,), unit `normal` (F, 3) and `offset_m` (F,) of its plane `normal . p = offset`;
    `body_from_world` (B, 4, 4). Triangles without area are left out.

    Raises
    ------
    DataError : no triangles, an index out of range, or a vertex that is not finite.
    """

    def __init__(self, bodies: Sequence[SceneBody]) -> None:
        self.bodies = tuple(bodies)
        vertices, triangles, body = _merged(self.bodies)
        corner = vertices[triangles]
        cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        doubled = np.linalg.norm(cross, axis=1)
        solid = doubled > 2.0 * _SMALLEST_AREA_M2
        if not np.any(solid):
            raise DataError("the scene has no triangle with an area", cure="check the part's mesh and its scale")
        self.vertices_m = _frozen(vertices)
        self.triangles: IntArray = triangles[solid]
        self.body: IntArray = body[solid]
        self.normal = _frozen(cross[solid] / doubled[solid, None])
        self.offset_m = _frozen(np.einsum("ij,ij->i", self.normal, corner[solid, 0]))
        kinds = np.array([int(item.material) for item in self.bodies], dtype=np.int64)
        self.material: IntArray = kinds[self.body]
        for array in (self.triangles, self.body, self.material):
            array.setflags(write=False)
        self.body_from_world = _frozen(np.array([inverse(item.world_from_body) for item in self.bodies]))
        # Embree works in float32: a local origin keeps its rounding near 1e-7 of the distance to the parts.
        self.origin_m = _frozen(0.5 * (corner[solid].min(axis=(0, 1)) + corner[solid].max(axis=(0, 1))))
        self._embree = EmbreeScene()
        local = np.ascontiguousarray(self.vertices_m - self.origin_m, dtype=np.float32)
        self._mesh = TriangleMesh(self._embree, local, np.ascontiguousarray(self.triangles, dtype=np.int32))

    def first_triangle(self, origins_local: FloatArray, directions: FloatArray) -> IntArray:
        """Triangle (N,) int32 that each ray meets first, -1 for none; float32 rays (N, 3), origins minus `origin_m`."""
        hit: IntArray = self._embree.run(origins_local, directions)
        return hit

    def cast(self, origins_m: FloatArray, directions: FloatArray) -> tuple[FloatArray, IntArray]:
        """Distance (N,) along unit directions (N, 3) from origins (N, 3), inf for a miss, and triangle (N,), -1."""
        origins = np.atleast_2d(np.asarray(origins_m, dtype=np.float64))
        rays = np.ascontiguousarray(np.broadcast_to(directions, origins.shape), dtype=np.float64)
        start = np.ascontiguousarray(origins - self.origin_m, dtype=np.float32)
        found = self._embree.run(start, rays.astype(np.float32), output=1)
        triangle = found["primID"].astype(np.int64)
        met = triangle >= 0
        normal, offset = self.normal[triangle], self.offset_m[triangle]
        slope = np.einsum("ij,ij->i", normal, rays)
        steep = np.abs(slope) > _GRAZING
        exact = (offset - np.einsum("ij,ij->i", normal, origins)) / np.where(steep, slope, 1.0)
        distance = np.where(steep, exact, found["tfar"].astype(np.float64))
        return np.where(met, distance, np.inf), triangle


def table_bodies(parameters: TableParameters | None = None) -> tuple[SceneBody, ...]:
    """The floor and the ring table, without a part."""
    cell = parameters or TableParameters()
    return _floor(cell), _ring_table(cell)


def _floor(cell: TableParameters) -> SceneBody:
    half = cell.floor_half_width_m
    vertices = np.array([[-half, -half, 0.0], [half, -half, 0.0], [half, half, 0.0], [-half, half, 0.0]])
    return SceneBody(vertices, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int64), Material.FLOOR, np.eye(4))


def _ring_table(cell: TableParameters) -> SceneBody:
    """A rectangular cross-section turned about z: four corners a segment, four quadrilaterals between neighbours."""
    n = cell.segments
    angle = 2.0 * np.pi * np.arange(n) / n
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    top, under = cell.table_height_m, cell.table_height_m - cell.table_thickness_m
    corners = (
        (cell.inner_radius_m, under),
        (cell.outer_radius_m, under),
        (cell.outer_radius_m, top),
        (cell.inner_radius_m, top),
    )
    vertices = np.stack(
        [np.column_stack([radius * circle, np.full(n, height)]) for radius, height in corners], axis=1
    ).reshape(-1, 3)
    here, there = 4 * np.arange(n), 4 * ((np.arange(n) + 1) % n)
    faces = []
    for a in range(4):
        b = (a + 1) % 4
        faces.append(np.column_stack([here + a, there + b, here + b]))
        faces.append(np.column_stack([here + a, there + a, there + b]))
    return SceneBody(vertices, np.vstack(faces).astype(np.int64), Material.TABLE, np.eye(4))


def _merged(bodies: Sequence[SceneBody]) -> tuple[FloatArray, IntArray, IntArray]:
    """Vertices, triangles and the body of each triangle, of all bodies together in the world frame."""
    if not bodies:
        raise DataError("the scene has no bodies", cure="give at least one mesh")
    vertices, triangles, owner, base = [], [], [], 0
    for index, body in enumerate(bodies):
        if not np.all(np.isfinite(body.vertices_m)):
            raise DataError(f"body {index} of the scene has vertices that are not finite", cure="repair the mesh")
        world = body.world_vertices()
        faces = np.asarray(body.triangles, dtype=np.int64).reshape(-1, 3)
        if len(faces) and not (faces.min() >= 0 and faces.max() < len(world)):
            raise DataError(
                f"body {index} of the scene names vertex {int(faces.max())} of {len(world)}", cure="repair the mesh"
            )
        vertices.append(world)
        triangles.append(faces + base)
        owner.append(np.full(len(faces), index, dtype=np.int64))
        base += len(world)
    return np.vstack(vertices), np.vstack(triangles), np.concatenate(owner)


def _frozen(array: FloatArray) -> FloatArray:
    copy = np.array(array, dtype=np.float64)
    copy.setflags(write=False)
    return copy
