"""Votes of all caps for the voxels that they pass; in each column along w the voxel with most votes.

Barshan, Directional Processing of Ultrasonic Arc Maps and its Comparison with Existing Techniques, Int. J. Robotics
Research 26(8) (2007) 797-820: each echo is an arc of equal range, each arc a vote for the cells that it passes; along
the direction of interest only the cell with the maximum of votes stays, the mean position where several have it. Here
the arcs are caps of spheres and the direction of interest is w, towards the array.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.confidence.gate import GateParameters
from surfuse.confidence.parameters import check_within
from surfuse.fusing.cones import Beams, Nodes, columns_within, nearest_node, nodes_of, shell
from surfuse.fusing.despiking import telling
from surfuse.fusing.mapwise import Estimate, mapwise
from surfuse.fusing.places import covered, excess_sigma
from surfuse.fusing.survey import Survey
from surfuse.fusing.voxels import Columns, columns_over
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import FusionMethod
from surfuse.records import FloatArray, IntArray, MapGrid

SUMMARY = "votes of all caps of equal range; the most voted voxel of each column (Barshan 2007)"


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Constants of the vote.

    voxel_m : height of a voxel; higher where the map would need more than 60 million. Default 1 mm.
    gate_footprints, gate_allowance_m : validation, see `GateParameters`.
    """

    voxel_m: float = 0.001

    def __post_init__(self) -> None:
        super().__post_init__()
        check_within("directional_maximum", "voxel_m", self.voxel_m, 1e-6, float("inf"))


@compiled
def votes(beams: Beams, nodes: Nodes, voxels: Columns) -> IntArray:
    """Number of caps (R, C, Z) that pass each voxel; a sensor that measures along its axis votes for one voxel."""
    start, axis, range_m, spread = beams
    u, v, wanted = nodes
    bottom, size, count = voxels
    cast = np.zeros((len(v), len(u), count), dtype=np.int64)
    for i in range(range_m.shape[0]):
        s, a, r = start[i], axis[i], range_m[i]
        if spread[i] == 0.0:
            k, c = nearest_node(s[0] + r * a[0], s[1] + r * a[1], u, v)
            if k >= 0 and wanted[k, c]:
                q = int(np.floor((s[2] + r * a[2] - bottom) / size + 0.5))
                if 0 <= q < count:
                    cast[k, c, q] += 1
            continue
        c0, c1, r0, r1 = columns_within(s, a, r, spread[i], u, v)
        for k in range(r0, r1):
            for c in range(c0, c1):
                drop, angle = shell(u[c] - s[0], v[k] - s[1], a, r, spread[i])
                q = int(np.floor((s[2] - drop - bottom) / size + 0.5))
                if wanted[k, c] and angle <= 1.0 and 0 <= q < count:
                    cast[k, c, q] += 1
    return cast


def winners(cast: IntArray, bottom_m: float, size_m: float) -> tuple[FloatArray, FloatArray]:
    """Height and sigma (R, C): mean of the voxels with most votes, and the spread of those with at least half as many.

    nan where nobody voted.

    In m; `cast` (R, C, Z) are the votes, the centre of voxel 0 is at `bottom_m`, each is `size_m` high. The variance of
    a voxel's uniform height, size^2 / 12, is part of sigma.
    """
    centre = bottom_m + size_m * np.arange(cast.shape[2])
    height, sigma = np.full(cast.shape[:2], np.nan), np.full(cast.shape[:2], np.nan)
    # Row by row: the votes of a large map are not copied as a whole.
    for k, row in enumerate(cast):
        most = row.max(axis=1)
        heard = most > 0
        best = (row == most[:, None])[heard].astype(np.float64)
        strong = np.where(2 * row >= most[:, None], row, 0)[heard].astype(np.float64)
        height[k, heard] = (best @ centre) / best.sum(axis=1)
        mean = (strong @ centre) / strong.sum(axis=1)
        spread = np.sum(strong * (centre - mean[:, None]) ** 2, axis=1) / strong.sum(axis=1)
        sigma[k, heard] = np.sqrt(spread + size_m**2 / 12.0)
    return height, sigma


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""

    def estimate(heard: Survey, grid: MapGrid) -> Estimate:
        used = telling(heard, grid)
        kept, nothing = heard.select(used), np.full(grid.shape, np.nan)
        if len(kept) == 0:
            return Estimate(nothing, nothing, used)
        z = columns_over(kept, grid, parameters.voxel_m, 10.0 * parameters.voxel_m)
        cast = votes(kept.beams, nodes_of(grid, covered(kept, grid)), z)
        height, sigma = winners(cast, z.bottom_m, z.height_m)
        return Estimate(height, np.hypot(sigma, excess_sigma(kept, grid)), used)

    return mapwise("directional_maximum", parameters, estimate)
