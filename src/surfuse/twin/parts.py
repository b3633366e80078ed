"""The parts that can stand on the table: the paper's three, and any mesh file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from surfuse.errors import ConfigError, nearest
from surfuse.geometry.mesh_files import SUFFIXES, TriangleSoup, read_mesh
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import FloatArray, IntArray
from surfuse.twin.materials import Material
from surfuse.twin.scene import SceneBody, TableParameters

SCENES = ("flat", "tilted", "relief")
PLATE_SIDE_M = 0.20
PLATE_THICKNESS_M = 0.005
BLOCK_HEIGHT_M = 0.10
BLOCK_DEPTH_M = 0.09
TILTED_YAW_RAD = float(np.radians(20.0))

SMALLEST_EXTENT_M = 0.005
LARGEST_EXTENT_M = 5.0
_FOOT_M = 0.002
_ON_TABLE_M = 1e-6

_UP = {"x": (0.0, -1.0, 0.0), "y": (1.0, 0.0, 0.0), "z": (1.0, 0.0, 0.0)}


@dataclass(frozen=True)
class PartPose:
    """Where and how a part stands on the table.

    The part's own frame is that of a drawing's front view: x to the right, z up, the side of smallest y towards the
    arm. Seen from the arm, x then is the scan direction u, z is v, and -y is w.

    Parameters
    ----------
    azimuth_rad : direction from the arm, counter-clockwise from world x.
    radius_m : distance of the front of the part's bounding box from the arm's first axis.
    yaw_rad : turn about the vertical, counter-clockwise seen from above.
    tilt_rad : lean backwards, top away from the arm; applied before the yaw.
    scale : factor on the mesh's coordinates (0.001 for a mesh in millimetres).
    up : the axis of the mesh file that points up.
    """

    azimuth_rad: float = 0.0
    radius_m: float = 1.10
    yaw_rad: float = 0.0
    tilt_rad: float = 0.0
    scale: float = 1.0
    up: Literal["x", "y", "z"] = "z"

    def __post_init__(self) -> None:
        for name in ("azimuth_rad", "radius_m", "yaw_rad", "tilt_rad"):
            value = getattr(self, name)
            if not np.isfinite(value):
                raise ConfigError(f"part.{name} = {value}", cure="give a finite number")
        if not (self.scale > 0.0 and np.isfinite(self.scale)):
            raise ConfigError(f"scene.scale = {self.scale}", cure="give a factor > 0")
        if self.up not in _UP:
            raise ConfigError(f"part.up = '{self.up}'", cure=nearest(self.up, _UP))


@dataclass(frozen=True)
class Part:
    """A part standing on the table, with what a user should know about its mesh."""

    name: str
    body: SceneBody
    warnings: tuple[str, ...] = ()

    def mesh(self) -> tuple[FloatArray, IntArray]:
        """The true surface: vertices (V, 3) in the world frame and triangles (F, 3)."""
        return self.body.world_vertices(), self.body.triangles


def make_part(
    scene: str | Path,
    placed: PartPose | None = None,
    cell: TableParameters | None = None,
    material: Material = Material.PART,
) -> Part:
    """One of `SCENES`, or a mesh file, standing on the table.

    Raises
    ------
    ConfigError : neither a known scene nor a file name with one of the suffixes in `mesh_files.SUFFIXES`.
    DataError : the mesh file cannot be used.
    ConfigError : the part does not fit into the cell.
    """
    name = str(scene)
    where = placed or PartPose()
    table = cell or TableParameters()
    if name in ("flat", "tilted"):
        turn = TILTED_YAW_RAD if name == "tilted" else 0.0
        return _stand(name, plate(), replace(where, yaw_rad=where.yaw_rad + turn), table, material)
    if name == "relief":
        return _stand(name, plate_with_block(), where, table, material)
    if Path(name).suffix.lower() not in SUFFIXES:
        raise ConfigError(
            f"unknown scene '{name}'",
            cure=f"{nearest(name, SCENES)}; or a mesh file ({', '.join(SUFFIXES)})",
        )
    return _stand(name, read_mesh(Path(name)), where, table, material)


def plate() -> TriangleSoup:
    """The paper's flat part: 0.20 x 0.20 m, upright, front at y = 0."""
    half, height, back = PLATE_SIDE_M / 2.0, PLATE_SIDE_M, PLATE_THICKNESS_M
    return _prism(np.array([[0.0, 0.0], [back, 0.0], [back, height], [0.0, height]]), half)


def plate_with_block() -> TriangleSoup:
    """The paper's relief: the plate with a block 0.20 m wide, 0.10 m high, 0.09 m thick in front; front at y = 0."""
    half, back = PLATE_SIDE_M / 2.0, BLOCK_DEPTH_M + PLATE_THICKNESS_M
    profile = np.array(
        [
            [0.0, 0.0],
            [back, 0.0],
            [back, PLATE_SIDE_M],
            [BLOCK_DEPTH_M, PLATE_SIDE_M],
            [BLOCK_DEPTH_M, BLOCK_HEIGHT_M],
            [0.0, BLOCK_HEIGHT_M],
        ]
    )
    return _prism(profile, half)


def _prism(profile_yz_m: FloatArray, half_width_m: float) -> TriangleSoup:
    """A profile (K, 2) in y, z, star-shaped from its second vertex, drawn out along x; watertight."""
    k = len(profile_yz_m)
    left = np.column_stack([np.full(k, -half_width_m), profile_yz_m])
    right = np.column_stack([np.full(k, half_width_m), profile_yz_m])
    # Fan from vertex 1: it sees every other vertex of the two profiles used here.
    order = [(1 + i) % k for i in range(k)]
    fan = [(order[0], order[i], order[i + 1]) for i in range(1, k - 1)]
    faces = [(k + a, k + b, k + c) for a, b, c in fan] + [(a, c, b) for a, b, c in fan]
    for a in range(k):
        b = (a + 1) % k
        faces += [(a, b, k + b), (a, k + b, k + a)]
    return TriangleSoup(np.vstack([left, right]), np.array(faces, dtype=np.int64), ())


def _stand(name: str, soup: TriangleSoup, where: PartPose, cell: TableParameters, material: Material) -> Part:
    """Scale, turn and put down: lowest point on the table, front of the bounding box at the radius."""
    own = soup.vertices_m * where.scale
    _check_extent(name, own, where)
    turn = rotation_about([0.0, 0.0, 1.0], where.yaw_rad) @ rotation_about([1.0, 0.0, 0.0], -where.tilt_rad)
    turn = turn @ _upright(where.up)
    turned = own @ turn.T
    low, high = turned.min(axis=0), turned.max(axis=0)
    put = np.array([-0.5 * (low[0] + high[0]), where.radius_m - low[1], cell.table_height_m - low[2]])
    _check_fit(name, turned + put, cell)
    cosine, sine = np.cos(where.azimuth_rad), np.sin(where.azimuth_rad)
    world_from_stand = np.array([[sine, cosine, 0.0], [-cosine, sine, 0.0], [0.0, 0.0, 1.0]])
    world_from_body = pose(world_from_stand @ turn, world_from_stand @ put)
    return Part(name, SceneBody(own, soup.triangles, material, world_from_body), soup.warnings)


def _upright(up: str) -> FloatArray:
    """Rotation that takes the file's up axis to z."""
    return rotation_about(_UP[up], 0.0 if up == "z" else np.pi / 2.0)


def _check_extent(name: str, own: FloatArray, where: PartPose) -> None:
    extent = float(np.max(np.ptp(own, axis=0)))
    if extent > LARGEST_EXTENT_M:
        factor = where.scale * 0.001
        raise ConfigError(
            f"part '{name}' is {extent:g} m long, the limit is {LARGEST_EXTENT_M:g} m: its mesh seems to be in "
            "millimetres",
            cure=f"pass scene.scale = {factor:g}",
        )
    if extent < SMALLEST_EXTENT_M:
        raise ConfigError(
            f"part '{name}' is only {extent * 1000.0:g} mm long, the least is {SMALLEST_EXTENT_M * 1000.0:g} mm",
            cure=f"pass a larger scene.scale (it is {where.scale:g})",
        )


def _check_fit(name: str, standing: FloatArray, cell: TableParameters) -> None:
    """Refuse a part that the ring cannot carry: (V, 3) with y along the radius, x across it."""
    width, depth = (float(value) for value in np.ptp(standing[:, :2], axis=0))
    widest = 2.0 * float(np.sqrt(cell.outer_radius_m**2 - cell.inner_radius_m**2))
    if width > widest:
        raise ConfigError(
            f"part '{name}' is {width:.3f} m wide, the ring table carries at most {widest:.3f} m",
            cure="turn the part (scene.yaw_deg) or make it smaller (scene.scale)",
        )
    foot = standing[standing[:, 2] < cell.table_height_m + _FOOT_M]
    radius = np.hypot(foot[:, 0], foot[:, 1])
    least, most = float(foot[:, 1].min()), float(radius.max())
    if least < cell.inner_radius_m - _ON_TABLE_M or most > cell.outer_radius_m + _ON_TABLE_M:
        raise ConfigError(
            f"part '{name}' is off the table: its foot reaches from {least:.3f} to {most:.3f} m from the arm's axis "
            f"(it is {depth:.3f} m deep), the table from {cell.inner_radius_m:.3f} to {cell.outer_radius_m:.3f} m",
            cure="change scene.radius_m, turn the part (scene.yaw_deg) or make it smaller (scene.scale)",
        )
