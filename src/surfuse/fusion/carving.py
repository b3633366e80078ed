"""Free space carved by the beams: nothing inside a cone is nearer than its reading, and the surface is what remains.

The empty part of the sonar profile of Moravec and Elfes, High Resolution Maps from Wide Angle Sonar, Proc. IEEE Int.
Conf. Robotics and Automation (1985) 116-121, taken alone, as in space carving (Kutulakos and Seitz, Int. J. Comput.
Vis. 38 (2000) 199-218). Each reading bounds the height of every node in its cone from above; the surface is a low
quantile of the bounds (an upper quantile of the depths) and not the lowest, because late readings would drill holes.
Gated: readings that their neighbours do not confirm, and those whose axis misses the outline and would eat its
corners, carve nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.confidence.gate import GateParameters
from surfuse.confidence.parameters import check_within
from surfuse.fusing.cones import Beams, Nodes, columns_within, nearest_node, nodes_of, shell
from surfuse.fusing.despiking import telling
from surfuse.fusing.mapwise import Estimate, mapwise
from surfuse.fusing.places import covered
from surfuse.fusing.survey import Survey
from surfuse.geometry.compiled import compiled
from surfuse.interfaces import FusionMethod
from surfuse.records import FloatArray, IntArray, MapGrid

SUMMARY = "gated carving: nothing in a cone is nearer than its reading; the envelope of what remains"

DEEPEST = 32
"""Bounds that are kept for each node: enough for a quantile of 1 in 20 over 600 readings."""


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Constants of the envelope.

    quantile : share of the bounds of a node that may lie below its surface. Default 0.05: one late reading in twenty
        drills no hole. No unit.
    despike : refuse readings that fewer than a quarter of their neighbours on the part confirm.
    gate_footprints, gate_allowance_m : validation, see `GateParameters`.
    """

    quantile: float = 0.05
    despike: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_within("carving", "quantile", self.quantile, 0.0, 0.5)


@compiled
def insert(lowest: FloatArray, value: float) -> None:
    """Put a value among the smallest ones (increasing, inf where there are none yet)."""
    k = lowest.shape[0] - 1
    if value >= lowest[k]:
        return
    while k > 0 and lowest[k - 1] > value:
        lowest[k] = lowest[k - 1]
        k -= 1
    lowest[k] = value


@compiled
def bounds(beams: Beams, sigma: FloatArray, nodes: Nodes) -> tuple[FloatArray, IntArray, FloatArray]:
    """Lowest bounds (R, C, DEEPEST), number of bounds (R, C) and smallest sigma of a reading (R, C) of each node.

    `sigma` (N,) are the standard deviations of the readings in m. A bound is a height along w that a cone allows.
    """
    start, axis, range_m, spread = beams
    u, v, wanted = nodes
    lowest = np.full((len(v), len(u), DEEPEST), np.inf)
    number, finest = np.zeros((len(v), len(u)), dtype=np.int64), np.full((len(v), len(u)), np.inf)
    for i in range(range_m.shape[0]):
        s, a, r = start[i], axis[i], range_m[i]
        if spread[i] == 0.0:
            k, c = nearest_node(s[0] + r * a[0], s[1] + r * a[1], u, v)
            if k >= 0 and wanted[k, c]:
                insert(lowest[k, c], s[2] + r * a[2])
                number[k, c] += 1
                finest[k, c] = min(finest[k, c], sigma[i])
            continue
        c0, c1, r0, r1 = columns_within(s, a, r, spread[i], u, v)
        for k in range(r0, r1):
            for c in range(c0, c1):
                z, off_axis = shell(u[c] - s[0], v[k] - s[1], a, r, spread[i])
                if wanted[k, c] and off_axis <= 1.0:
                    insert(lowest[k, c], s[2] - z)
                    number[k, c] += 1
                    finest[k, c] = min(finest[k, c], sigma[i])
    return lowest, number, finest


def envelope(
    lowest: FloatArray, number: IntArray, finest: FloatArray, quantile: float
) -> tuple[FloatArray, FloatArray]:
    """Height and sigma (R, C): the quantile of the bounds, and half its distance to twice the quantile as a doubt.

    In m, nan where a node has no bound. `lowest` (R, C, DEEPEST), `number` (R, C) and `finest` (R, C) are those of
    `bounds`. The smallest sigma of a reading is part of sigma.
    """
    known = number > 0

    def ranked(share: float) -> FloatArray:
        place = np.clip(np.floor(share * number).astype(np.int64), 0, np.minimum(number, DEEPEST) - 1)
        values = np.take_along_axis(lowest, np.maximum(place, 0)[..., None], axis=2)[..., 0]
        return np.where(known, values, np.nan)

    height = ranked(quantile)
    doubt = 0.5 * np.maximum(ranked(2.0 * quantile) - height, height - ranked(0.0))
    return height, np.sqrt(np.where(known, finest, np.nan) ** 2 + doubt**2)


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""

    def estimate(heard: Survey, grid: MapGrid) -> Estimate:
        used = telling(heard, grid, parameters.despike)
        kept = heard.select(used)
        lowest, number, finest = bounds(kept.beams, kept.sigma_m, nodes_of(grid, covered(kept, grid)))
        height, sigma = envelope(lowest, number, finest, parameters.quantile)
        return Estimate(height, sigma, used)

    return mapwise("carving", parameters, estimate)
