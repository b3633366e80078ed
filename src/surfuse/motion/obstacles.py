"""What an arm must not touch: the ring table, the floor, the arm's own stand, the part. Distances to points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.compiled import compiled
from surfuse.geometry.poses import inverse
from surfuse.records import FloatArray, Outline


class Obstacle(Protocol):
    """A solid: `name` for messages, and the parts of the arm that need not keep clear of it."""

    @property
    def name(self) -> str: ...
    @property
    def ignores(self) -> tuple[str, ...]: ...
    def distance(self, points_m: FloatArray) -> FloatArray:
        """Distances (N,) of points (N, 3) in the world to the solid: positive outside, negative inside."""


@dataclass(frozen=True)
class RingTable:
    """The ring table around joint 1: a flat ring whose top lies at `height_m`.

    From `inner_radius_m` to `outer_radius_m` about the world's z axis, `thickness_m` deep. `ignores` names parts of the
    arm that may touch it.
    """

    height_m: float = 1.00
    inner_radius_m: float = 0.95
    outer_radius_m: float = 1.25
    thickness_m: float = 0.05
    name: str = "the table"
    ignores: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not (0.0 < self.inner_radius_m < self.outer_radius_m and self.thickness_m > 0.0):
            raise ConfigError(
                f"a ring table with radii {self.inner_radius_m} m and {self.outer_radius_m} m, "
                f"{self.thickness_m} m thick",
                cure="give 0 < inner < outer radius and a positive thickness",
            )

    def distance(self, points_m: FloatArray) -> FloatArray:
        """Distances (N,) of points (N, 3) to the ring."""
        return _ring_distance(
            points_m, self.height_m, self.height_m - self.thickness_m, self.inner_radius_m, self.outer_radius_m
        )


@dataclass(frozen=True)
class Floor:
    """Everything below a height.

    `height_m` is z in the world. `ignores` names parts of the arm that may touch it.
    """

    height_m: float = 0.0
    name: str = "the floor"
    ignores: tuple[str, ...] = ()

    def distance(self, points_m: FloatArray) -> FloatArray:
        """Heights (N,) of points (N, 3) above the floor."""
        return np.subtract(points_m[:, 2], self.height_m)


@dataclass(frozen=True)
class HalfSpace:
    """Everything behind a plane: of a table on which arm and part stand, however large it is.

    The plane goes through `point_m` (3,), `outwards` (3,) is the unit vector away from the solid, both in the world.
    `ignores` names parts of the arm that may touch it.
    """

    point_m: tuple[float, float, float]
    outwards: tuple[float, float, float]
    name: str = "the table"
    ignores: tuple[str, ...] = ()

    def distance(self, points_m: FloatArray) -> FloatArray:
        """Distances (N,) of points (N, 3) to the plane."""
        found: FloatArray = np.subtract(points_m, self.point_m) @ np.array(self.outwards)
        return found


@dataclass(frozen=True)
class Column:
    """A vertical cylinder about joint 1, from the floor to its top: the stand and the trunk of the arm.

    From below to `top_m`, of `radius_m` about the world's z axis. `ignores` names parts of the arm that may touch it.
    """

    top_m: float
    radius_m: float
    name: str = "the arm's column"
    ignores: tuple[str, ...] = ()

    def distance(self, points_m: FloatArray) -> FloatArray:
        """Distances (N,) of points (N, 3) to the cylinder."""
        return _ring_distance(points_m, self.top_m, -math.inf, 0.0, self.radius_m)


@dataclass(frozen=True)
class Box:
    """A box, upright or not: between the corners `lower_m` and `upper_m` (3,) of its own frame.

    `world_from_box` (4, 4) is the pose of that frame, corners in m. `ignores` names parts of the arm that may touch it.
    """

    lower_m: tuple[float, float, float]
    upper_m: tuple[float, float, float]
    world_from_box: FloatArray
    name: str = "the part"
    ignores: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not np.all(np.asarray(self.lower_m) < np.asarray(self.upper_m)):
            raise ConfigError(f"{self.name} is a box from {self.lower_m} to {self.upper_m}", cure="order its corners")

    def distance(self, points_m: FloatArray) -> FloatArray:
        """Distances (N,) of points (N, 3) to the box."""
        lower, upper = np.array(self.lower_m), np.array(self.upper_m)
        return _box_distance(points_m, lower, upper, inverse(np.asarray(self.world_from_box)))


def part_box(outline: Outline, front_m: float = 0.10, back_m: float = 0.30) -> Box:
    """The box around an outline that may hold the part: `front_m` before and `back_m` behind its w = 0 plane.

    Before the scan nobody knows how far the part comes out of its outline's plane: `front_m` is the allowance.
    """
    low, high = outline.vertices_m.min(axis=0).tolist(), outline.vertices_m.max(axis=0).tolist()
    return Box((low[0], low[1], -back_m), (high[0], high[1], front_m), outline.world_from_part)


@compiled
def _outside(across: float, up: float) -> float:
    """Distance to a rectangle from the signed excess over its two pairs of sides."""
    if across <= 0.0 and up <= 0.0:
        return max(across, up)
    return math.hypot(max(across, 0.0), max(up, 0.0))


@compiled
def _ring_distance(points: FloatArray, top: float, bottom: float, inner: float, outer: float) -> FloatArray:
    distances = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        radius = math.sqrt(points[i, 0] * points[i, 0] + points[i, 1] * points[i, 1])
        across = radius - outer
        if inner > 0.0:
            across = max(across, inner - radius)
        distances[i] = _outside(across, max(points[i, 2] - top, bottom - points[i, 2]))
    return distances


@compiled
def _box_distance(points: FloatArray, lower: FloatArray, upper: FloatArray, box_from_world: FloatArray) -> FloatArray:
    distances = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        outside_squared = 0.0
        deepest = -np.inf
        for r in range(3):
            along = box_from_world[r, 3]
            for c in range(3):
                along += box_from_world[r, c] * points[i, c]
            excess = max(lower[r] - along, along - upper[r])
            deepest = max(deepest, excess)
            if excess > 0.0:
                outside_squared += excess * excess
        distances[i] = math.sqrt(outside_squared) if deepest > 0.0 else deepest
    return distances
