"""Bayesian occupancy of voxels, as log-odds; the surface is where a column turns from empty to occupied.

Log-odds that add up over the readings: Moravec and Elfes, High Resolution Maps from Wide Angle Sonar, Proc. IEEE Int.
Conf. Robotics and Automation (1985) 116-121; Elfes, Computer 22(6) (1989) 46-57. Profile along the beam: Konolige,
Improved Occupancy Grids for Map Building, Autonomous Robots 4 (1997) 351-367. There a cell at range z answers with
probability alpha, and its range is normal with deviation delta about z; an echo of something else comes from anywhere
with density F. An empty cell leaves the range to the others. Hence for a reading r the likelihood ratio of occupied to
empty

    L(z) = ln(1 + alpha share N(r; z, delta) / F) + ln(1 - alpha Phi((r - z) / delta))

positive about the reading, negative in front of it, 0 behind. Across the beam alpha falls as 1 - (angle / half angle)^2
(Moravec and Elfes). `share` is one over the cells of the cone's cap, weighted alike: one of them answered, as in the
normalisation of Moravec and Elfes; without it the whole cap would count as surface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from surfuse.confidence.gate import GateParameters
from surfuse.confidence.parameters import check_within
from surfuse.fusing.cones import Beams, Nodes, columns_between, columns_within, nearest_node, nodes_of
from surfuse.fusing.despiking import telling
from surfuse.fusing.mapwise import Estimate, mapwise
from surfuse.fusing.places import covered
from surfuse.fusing.sonar_model import FAR, Beside, SonarModel, along_axis, in_cone, share_of, table_of_empty
from surfuse.fusing.survey import Survey
from surfuse.fusing.voxels import Columns, columns_over
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import FusionMethod
from surfuse.records import BoolArray, FloatArray, MapGrid

SUMMARY = "Bayesian occupancy of voxels (Moravec, Elfes; Konolige's sonar model), first occupied one from above"

CERTAIN = 30.0
"""Log-odds beyond which a voxel is no surer."""


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Constants of the sonar model and of the grid.

    voxel_m : height of a voxel; higher where the map would need more than 60 million. Default 1 mm.
    detection : alpha, the probability that an occupied cell on the axis answers. Default 0.6 (Konolige).
    delta_m : least standard deviation of a range about its cell. Default 1 mm, a voxel; the sensor's own if larger.
    other_echo_per_m : F, density of ranges that come from elsewhere in the cone. Default 10: an echo that is not this
        cell's is another's, from anywhere within 10 cm of depth. Unit 1/m.
    gate_footprints, gate_allowance_m : validation, see `GateParameters`.
    """

    voxel_m: float = 0.001
    detection: float = 0.6
    delta_m: float = 0.001
    other_echo_per_m: float = 10.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_within("occupancy", "detection", self.detection, 0.01, 0.99)
        for name in ("voxel_m", "delta_m", "other_echo_per_m"):
            check_within("occupancy", name, getattr(self, name), 1e-6, float("inf"))


@compiled
def log_odds(
    beams: Beams, delta: FloatArray, nodes: Nodes, voxels: Columns, detection: float, other_per_m: float
) -> FloatArray:
    """Summed log-odds (R, C, Z) of all voxels, voxel 0 at the bottom; unwanted columns stay 0.

    `delta` (N,) is the deviation (m) of each range about its cell, `detection` is alpha, `other_per_m` is F (1/m); the
    model stands at the top of the module.
    """
    start, axis, range_m, spread = beams
    u, v, wanted = nodes
    odds = np.zeros((len(v), len(u), voxels.levels))
    empty = table_of_empty(detection)
    for i in range(range_m.shape[0]):
        s, a, r = start[i], axis[i], range_m[i]
        if spread[i] == 0.0:
            k, c = nearest_node(s[0] + r * a[0], s[1] + r * a[1], u, v)
            if k >= 0 and wanted[k, c]:
                model = SonarModel(delta[i], other_per_m, detection, 1.0, empty)
                along_axis(odds[k, c], voxels, s[2] + r * a[2], a[2], r, model)
            continue
        share = share_of(s, a, r, spread[i], columns_within(s, a, r, spread[i], u, v), u, v)
        # No voxel is nearer than the top of the columns lies below the start.
        near = min(r, max(0.0, s[2] - voxels.bottom_m - voxels.height_m * voxels.levels))
        c0, c1, r0, r1 = columns_between(s, a, near, r + FAR * delta[i], spread[i], u, v)
        model = SonarModel(delta[i], other_per_m, detection, share, empty)
        for k in range(r0, r1):
            for c in range(c0, c1):
                if wanted[k, c]:
                    beside = Beside(u[c] - s[0], v[k] - s[1], s[2])
                    in_cone(odds[k, c], voxels, beside, a, r, spread[i], model)
    return odds


@compiled
def crossing(odds: FloatArray, bottom: float, size: float) -> tuple[float, float]:
    """Height of the surface in a column (Z,) seen from above, and its standard deviation; nan where there is none.

    The column is followed from above to its first positive voxel, where it turns occupied, and on to the first maximum
    of the odds, refined by a parabola: the crossing itself lies in front of every reading by two or three of its
    deviations. The deviation is that of the first occupied voxel met from above, plus that of a voxel.

    `bottom` (m) is the height of the centre of voxel 0, `size` (m) that of a voxel. Odds are held within `CERTAIN` when
    they become probabilities.
    """
    top = odds.shape[0] - 1
    found = -1
    for q in range(top, -1, -1):
        if odds[q] > 0.0:
            found = q
            break
    if found < 0:
        return np.nan, np.nan
    best = found
    while best > 0 and odds[best - 1] > odds[best]:
        best -= 1
    height = bottom + best * size
    if 0 < best < top:
        bend = odds[best - 1] - 2.0 * odds[best] + odds[best + 1]
        if bend < 0.0:
            height += 0.5 * size * (odds[best - 1] - odds[best + 1]) / bend
    open_, mass, mean, square = 1.0, 0.0, 0.0, 0.0
    for q in range(top, -1, -1):
        if odds[q] == 0.0:
            continue
        occupied = 1.0 / (1.0 + math.exp(-min(max(odds[q], -CERTAIN), CERTAIN)))
        first, offset = open_ * occupied, (q - found) * size
        mass, mean, square = mass + first, mean + first * offset, square + first * offset * offset
        open_ *= 1.0 - occupied
    variance = square / mass - (mean / mass) ** 2 if mass > 0.0 else 0.0
    return height, math.sqrt(max(variance, 0.0) + size * size / 12.0)


@compiled
def crossings(odds: FloatArray, wanted: BoolArray, bottom: float, size: float) -> tuple[FloatArray, FloatArray]:
    """Height and standard deviation (R, C) of the crossings of all wanted columns.

    In m, nan where a column is never occupied or not wanted. `odds` (R, C, Z) are log-odds with the centre of voxel 0
    at `bottom` (m), each voxel `size` (m) high; `wanted` (R, C).
    """
    height, sigma = np.full(wanted.shape, np.nan), np.full(wanted.shape, np.nan)
    for k in range(wanted.shape[0]):
        for c in range(wanted.shape[1]):
            if wanted[k, c]:
                height[k, c], sigma[k, c] = crossing(odds[k, c], bottom, size)
    return height, sigma


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""

    def estimate(heard: Survey, grid: MapGrid) -> Estimate:
        used = telling(heard, grid)
        kept, wanted = heard.select(used), np.zeros(grid.shape, dtype=np.bool_)
        nothing = np.full(grid.shape, np.nan)
        if len(kept) == 0:
            return Estimate(nothing, nothing, used)
        wanted = covered(kept, grid)
        delta = np.maximum(kept.sigma_m, parameters.delta_m)
        z = columns_over(kept, grid, parameters.voxel_m, 2.0 * FAR * float(np.max(delta)))
        detection, other_per_m = parameters.detection, parameters.other_echo_per_m
        delta_of_cell = np.maximum(delta, z.height_m)
        odds = log_odds(kept.beams, delta_of_cell, nodes_of(grid, wanted), z, detection, other_per_m)
        height, sigma = crossings(odds, wanted, z.bottom_m, z.height_m)
        # The readings of overlapping cones repeat each other: no crossing is known better than one of them.
        return Estimate(height, np.hypot(sigma, float(np.median(delta))), used)

    return mapwise("occupancy", parameters, estimate)
