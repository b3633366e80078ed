"""Where to scan when no camera looks for the part: a rectangle, an outline file, a mesh, or corners shown by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from surfuse.errors import ConfigError, DataError
from surfuse.geometry.mesh_files import read_mesh
from surfuse.geometry.polygons import counter_clockwise
from surfuse.geometry.poses import inverse, is_rigid, pose, transform_points
from surfuse.records import FloatArray, Outline
from surfuse.runs.side_files import read_outline
from surfuse.settings import Settings
from surfuse.settings.rig_tables import AreaSettings

_LEAST_SIDE_M = 1e-3
_ALONG = 0.5


def part_frame(area: AreaSettings) -> FloatArray:
    """`world_from_part` (4, 4) of the area: u and v as given (v made exactly perpendicular), w = u x v."""
    u = np.array(area.u) / np.linalg.norm(area.u)
    v = np.array(area.v) - (np.array(area.v) @ u) * u
    v /= np.linalg.norm(v)
    return pose(np.column_stack([u, v, np.cross(u, v)]), area.origin_m)


def check_faces(world_from_part: FloatArray, world_from_grip: FloatArray, found: bool = False) -> None:
    """Refuse an area (pose (4, 4)) whose w points along the beams of the sensors as they stand now (pose (4, 4)).

    `found`: a camera found the part on the plane of the search, whose normal is w.
    Its stops would lie behind the surface, and the way to them leads through it.

    Raises
    ------
    ConfigError : they are less than 60 degrees apart.
    """
    w, beams = world_from_part[:3, 2], world_from_grip[:3, 2]
    if float(w @ beams) > _ALONG and found:
        raise ConfigError(
            f"w of the part, the normal of search.plane, is ({_numbers(w)}), along the beams of the sensors, "
            f"({_numbers(beams)})",
            cure="it points out of the part, at the sensors: negate the normal, or turn the tool to the part",
        )
    if float(w @ beams) > _ALONG:
        raise ConfigError(
            f"w = u x v of the area is ({_numbers(w)}), along the beams of the sensors, ({_numbers(beams)})",
            cure="w points out of the part, at the sensors: swap u and v, or negate one; or turn the tool to it",
        )


def _numbers(vector: FloatArray) -> str:
    return ", ".join(f"{value:.2f}" for value in vector + 0.0)


def area_of(settings: Settings) -> AreaSettings:
    """The area of the configuration.

    Raises
    ------
    ConfigError : there is none.
    """
    if settings.area is None:
        raise nothing_to_scan()
    return settings.area


def nothing_to_scan() -> ConfigError:
    """What to do where the cell file has neither an area nor a camera."""
    return ConfigError("nothing says where to scan", cure="add an [area] to the cell file, or a [camera] with a driver")


def outline_of(area: AreaSettings) -> Outline:
    """The boundary of what is scanned, in the part frame of the area, not enlarged.

    Raises
    ------
    DataError : a file that cannot be read, or corners that enclose nothing.
    ConfigError : the corners have not been shown yet.
    """
    if area.outline is not None:
        return read_outline(Path(area.outline), part_frame(area))
    if area.mesh is not None:
        return _outline_of_mesh(area, Path(area.mesh))
    if area.corners_m is not None:
        return outline_of_corners(np.array(area.corners_m, dtype=np.float64), part_frame(area)[:3, 2])
    if area.width_m is None or area.height_m is None:
        raise ConfigError("the corners of the area have not been shown", cure="run 'surfuse acquire' on a terminal")
    w, h = area.width_m, area.height_m
    return Outline(np.array([[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]]), part_frame(area))


def _outline_of_mesh(area: AreaSettings, path: Path) -> Outline:
    """What a mesh covers when it is seen along w: the convex hull of its shadow."""
    vertices = read_mesh(path).vertices_m
    if area.world_from_mesh is not None:
        if len(area.world_from_mesh) != 16 or not is_rigid(np.array(area.world_from_mesh).reshape(4, 4)):
            raise ConfigError("area.world_from_mesh is no rigid pose", cure="give 16 numbers: a 4 x 4 pose, row by row")
        vertices = transform_points(np.array(area.world_from_mesh).reshape(4, 4), vertices)
    world_from_part = part_frame(area)
    shadow = transform_points(inverse(world_from_part), vertices)[:, :2]
    return Outline(counter_clockwise(shadow[ConvexHull(shadow).vertices]), world_from_part)


def outline_of_corners(corners_m: FloatArray, towards_sensors: FloatArray) -> Outline:
    """The polygon of corners (K, 3) in the world, in the order in which they were shown.

    The part frame lies in the plane of least squares through them: origin at the first corner, u towards the second,
    w on the side of `towards_sensors` (3,).

    Raises
    ------
    DataError : fewer than three corners, or corners on one line.
    """
    corners = np.asarray(corners_m, dtype=np.float64).reshape(-1, 3)
    if len(corners) < 3:
        raise DataError(f"{len(corners)} corners enclose no area", cure="show three or more")
    _, size, directions = np.linalg.svd(corners - corners.mean(axis=0))
    if size[1] < _LEAST_SIDE_M:
        raise DataError(f"the {len(corners)} corners lie on one line", cure="show corners around the area")
    w = directions[2] * (1.0 if directions[2] @ towards_sensors >= 0.0 else -1.0)
    first = corners[0]
    u = corners[1] - first
    u -= (u @ w) * w
    if np.linalg.norm(u) < _LEAST_SIDE_M:
        raise DataError("the first two corners are the same", cure="show the corners again")
    u /= np.linalg.norm(u)
    world_from_part = pose(np.column_stack([u, np.cross(w, u), w]), first)
    vertices = transform_points(inverse(world_from_part), corners)[:, :2]
    return Outline(counter_clockwise(vertices), world_from_part)
