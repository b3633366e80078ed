"""Simple solids as meshes, standing on z = 0 with their front at x = 0 and x pointing away from the viewer."""

from __future__ import annotations

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.mesh_files import TriangleSoup
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import FloatArray
from surfuse.twin.materials import Material
from surfuse.twin.scene import SceneBody


def extrusion(front_yz_m: FloatArray, depth_m: float) -> TriangleSoup:
    """A front (K, 2) in y, z, counter-clockwise and star-shaped from its mean, drawn out along x; watertight.

    Raises
    ------
    ConfigError : fewer than 3 corners or no depth.
    """
    front = np.asarray(front_yz_m, dtype=np.float64)
    k = len(front)
    if k < 3 or not depth_m > 0.0:
        raise ConfigError(f"a solid with {k} corners, {depth_m} m deep", cure="give 3 corners or more and a depth > 0")
    flat = np.vstack([front, front.mean(axis=0)])
    vertices = np.vstack([np.column_stack([np.full(k + 1, x), flat]) for x in (0.0, depth_m)])
    here, there = np.arange(k), (np.arange(k) + 1) % k
    back = k + 1
    faces = np.vstack(
        [
            np.column_stack([here, np.full(k, k), there]),
            np.column_stack([here + back, there + back, np.full(k, k + back)]),
            np.column_stack([here, there, there + back]),
            np.column_stack([here, there + back, here + back]),
        ]
    )
    return TriangleSoup(vertices, faces.astype(np.int64), ())


def box(width_m: float, depth_m: float, height_m: float) -> TriangleSoup:
    """A block, its front centred on y = 0."""
    half = width_m / 2.0
    return extrusion(np.array([[-half, 0.0], [half, 0.0], [half, height_m], [-half, height_m]]), depth_m)


def cylinder(radius_m: float, height_m: float, sides: int = 48) -> TriangleSoup:
    """An upright cylinder that touches x = 0."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    disc = extrusion(radius_m * np.column_stack([np.cos(angle), np.sin(angle)]), height_m)
    # The drawn-out direction becomes z, and the old y, z the floor's x, y.
    x, y, z = disc.vertices_m.T
    return TriangleSoup(np.column_stack([y + radius_m, z, x]), disc.triangles, ())


def standing(
    soup: TriangleSoup,
    material: Material,
    azimuth_rad: float,
    radius_m: float,
    height_m: float,
    yaw_rad: float = 0.0,
    lean_rad: float = 0.0,
) -> SceneBody:
    """The solid with its foot at a height, in a direction and distance from the arm's first axis, x pointing outwards.

    It is turned about its own vertical through x = y = 0, after it leant back (top away from the arm) by `lean_rad`,
    and put down so that its lowest vertex is at the height.
    """
    leant = soup.vertices_m @ rotation_about([0.0, 1.0, 0.0], lean_rad).T
    leant = leant - [0.0, 0.0, float(leant[:, 2].min())]
    place = [radius_m * np.cos(azimuth_rad), radius_m * np.sin(azimuth_rad), height_m]
    turn = rotation_about([0.0, 0.0, 1.0], azimuth_rad + yaw_rad)
    return SceneBody(leant, soup.triangles, material, pose(turn, place))
