"""Clearance of an arm at many joint positions at once: the least distance to obstacles and own links, and who it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from surfuse.errors import SafetyStopError
from surfuse.geometry.compiled import compiled
from surfuse.motion.body import Body
from surfuse.motion.obstacles import Obstacle
from surfuse.motion.own_links import OwnLinks
from surfuse.records import BoolArray, FloatArray, IntArray

_NO_NEARER_M = 1e-3  # what rounding and the arm's own repeatability take from the distance that a move begins with
_CHUNK = 2048  # joint positions at once: bounds the memory of the sphere centres


@dataclass(frozen=True)
class Clearances:
    """Least distance (N,) in m (negative: overlap), and which part of the arm is nearest to which obstacle (N,).

    `parts` and `obstacles` are the names that `part` and `obstacle` count.
    """

    distance_m: FloatArray
    part: IntArray
    obstacle: IntArray
    parts: tuple[str, ...]
    obstacles: tuple[str, ...]

    def describe(self, i: int) -> str:
        """Position i in words: "the sensor tube is 3 mm from the table"."""
        millimetres = 1e3 * float(self.distance_m[i])
        what, where = self.parts[int(self.part[i])], self.obstacles[int(self.obstacle[i])]
        if millimetres < 0.0:
            return f"the {what} would be {-millimetres:.0f} mm inside {where}"
        return f"the {what} would be {millimetres:.0f} mm from {where}"


@dataclass(frozen=True)
class ClearanceModel:
    """An arm's body in its surroundings; `link_poses` maps joints (N, J) to poses (N, L, 4, 4) in the world.

    `own` are the links that must keep clear of each other (None: they are not looked at). `beside` tells, an obstacle
    each, the spheres (B,) of the body that need not keep clear of it (empty: none are known).
    """

    link_poses: Callable[[FloatArray], FloatArray]
    body: Body
    obstacles: tuple[Obstacle, ...]
    own: OwnLinks | None = None
    beside: tuple[BoolArray, ...] = ()

    def __call__(self, joints_rad: FloatArray) -> Clearances:
        """Clearances at joints (N, J); infinite where there is no obstacle, nan joints give nan distances."""
        joints = np.atleast_2d(np.asarray(joints_rad, dtype=np.float64))
        n = len(joints)
        distance, part, obstacle = np.full(n, np.inf), np.zeros(n, np.int64), np.zeros(n, np.int64)
        for first in range(0, n, _CHUNK):
            rows = slice(first, first + _CHUNK)
            poses = self.link_poses(joints[rows])
            centers = self.body.place(poses)
            for index, solid in enumerate(self.obstacles):
                self._take_nearer(centers, index, solid, distance[rows], part[rows], obstacle[rows])
            if self.own is not None and len(self.own.pairs):
                self._take_own(poses, self.own, distance[rows], part[rows], obstacle[rows])
        distance[~np.all(np.isfinite(joints), axis=1)] = np.nan
        own_names = tuple(f"the arm's own {name}" for name in self.own.names) if self.own is not None else ()
        solids = tuple(solid.name for solid in self.obstacles)
        return Clearances(distance, part, obstacle, self.body.names, (*solids, *own_names))

    def _take_own(
        self, poses: FloatArray, own: OwnLinks, distance: FloatArray, part: IntArray, obstacle: IntArray
    ) -> None:
        """Update distance, part and obstacle (N,), in place, where two own links are nearer than any obstacle."""
        gap, pair = own.nearest(poses)
        nearer = np.flatnonzero((gap < distance) & (gap < own.keep_m))
        mine, other = own.part[own.pairs[pair[nearer], 0]], own.part[own.pairs[pair[nearer], 1]]
        distance[nearer] = gap[nearer]
        part[nearer] = np.array([self.body.names.index(name) for name in own.names], dtype=np.int64)[mine]
        obstacle[nearer] = len(self.obstacles) + other

    def _take_nearer(
        self,
        centers: FloatArray,
        index: int,
        solid: Obstacle,
        distance: FloatArray,
        part: IntArray,
        obstacle: IntArray,
    ) -> None:
        """Update distance, part and obstacle (N,), in place, where this solid is nearer than those before it."""
        counts = np.array([self.body.names[p] not in solid.ignores for p in self.body.part], dtype=np.bool_)
        kept = np.flatnonzero(counts & ~self.beside[index] if self.beside else counts)
        if len(kept) == 0:
            return
        mine = centers if len(kept) == centers.shape[1] else centers[:, kept]
        distances = solid.distance(mine.reshape(-1, 3)).reshape(len(mine), len(kept))
        _keep_nearer(distances, self.body.radius_m[kept], self.body.part[kept], index, distance, part, obstacle)


@compiled
def _keep_nearer(
    distances: FloatArray,
    radius: FloatArray,
    part_of: IntArray,
    index: int,
    least: FloatArray,
    part: IntArray,
    obstacle: IntArray,
) -> None:
    for i in range(distances.shape[0]):
        for b in range(distances.shape[1]):
            gap = distances[i, b] - radius[b]
            if gap < least[i]:
                least[i] = gap
                part[i] = part_of[b]
                obstacle[i] = index


def check_move(
    model: ClearanceModel,
    start_rad: FloatArray,
    end_rad: FloatArray,
    least_m: float,
    resolution_rad: float = 0.02,
    from_within: bool = False,
) -> None:
    """Refuse a straight joint move from start to end (J,) that comes nearer than `least_m` to an obstacle.

    The move is sampled so that no joint turns further than `resolution_rad` between samples. With `from_within` a move
    that begins nearer than `least_m` is not refused for that, only when it comes nearer still: so an arm that stands
    too near comes away.

    Raises
    ------
    SafetyStopError : names the part of the arm, the obstacle, the distance and the limit.
    """
    turn = float(np.max(np.abs(np.subtract(end_rad, start_rad)), initial=0.0))
    t = np.linspace(0.0, 1.0, int(np.ceil(turn / resolution_rad)) + 2)[:, None]
    clearances = model(start_rad + t * np.subtract(end_rad, start_rad))
    i = int(np.argmin(clearances.distance_m))
    if from_within:
        least_m = min(least_m, float(clearances.distance_m[0]) - _NO_NEARER_M)
    if not clearances.distance_m[i] >= least_m:
        raise SafetyStopError(
            f"{clearances.describe(i)}, {100.0 * float(t[i, 0]):.0f} percent into a move; at least "
            f"{1e3 * least_m:.0f} mm must be kept",
            cure="move in two steps, or move the part",
        )
