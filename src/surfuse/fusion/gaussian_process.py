"""A Gaussian process about a local plane, over the nearest places of each node: local universal kriging.

Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), equations 2.25-2.26 for mean and variance and
2.41-2.42 for the plane with its prior; Matheron, Economic Geology 58 (1963) 1246-1266 for kriging. The neighbourhood
makes the cost of a node constant (Vecchia, J. R. Stat. Soc. B 50 (1988) 297-312; Gramacy and Apley, J. Comput. Graph.
Stat. 24 (2015) 561-578); with no more places than neighbours the result is the full process. Readings at one place
enter as their weighted mean, which is exact for independent noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from surfuse.confidence.gate import GateParameters
from surfuse.confidence.parameters import check_within
from surfuse.fusing.covariances import Covariance, chosen
from surfuse.fusing.despiking import telling
from surfuse.fusing.mapwise import Estimate, mapwise
from surfuse.fusing.places import covered, nodes_of
from surfuse.fusing.sites import Sites, mean_sites
from surfuse.fusing.survey import Survey
from surfuse.interfaces import FusionMethod
from surfuse.records import FloatArray, IntArray, MapGrid

SUMMARY = "Gaussian process (Matern 3/2 about a plane) over the nearest readings of each node"

SAME = 0.1
"""Readings within a tenth of a stop are at one place."""

BLOCK = 512
"""Nodes that are solved together."""

SAMPLES = 32
"""Neighbourhoods that choose the constants."""


@dataclass(frozen=True)
class Parameters(GateParameters):
    """Constants of the process; those that are 0 are chosen by their likelihood from the readings.

    neighbours : places that a node rests on. Default 48: a square of seven by seven.
    length_m : correlation length of the surface about its local plane. Default 0: from the readings.
    signal_m : its standard deviation. Default 0: from the readings.
    noise_factor : standard deviation of the readings in units of their own sigma. Default 0: from the readings.
    slope_sigma : prior standard deviation of the plane's slopes. Default 1, 45 degrees.
    gate_footprints, gate_allowance_m : validation, see `GateParameters`.
    """

    neighbours: int = 48
    length_m: float = 0.0
    signal_m: float = 0.0
    noise_factor: float = 0.0
    slope_sigma: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_within("gaussian_process", "neighbours", float(self.neighbours), 4.0, 512.0)
        check_within("gaussian_process", "slope_sigma", self.slope_sigma, 0.0, float("inf"), above=True)
        for name in ("length_m", "signal_m", "noise_factor"):
            check_within("gaussian_process", name, getattr(self, name), 0.0, float("inf"))


def kriged(
    sites: Sites, nodes_m: FloatArray, index: IntArray, covariance: Covariance, slope_sigma: float
) -> tuple[FloatArray, FloatArray]:
    """Mean and standard deviation (Q,) of the surface at nodes (Q, 2) from their neighbours (Q, n) among the sites.

    The plane's offset has no prior, its slopes a normal one: B^-1 = diag(0, 1/s^2, 1/s^2) in equations 2.41-2.42.
    """
    at = sites.uv_m[index] - nodes_m[:, None]
    level = np.median(sites.height_m[index], axis=1)
    rise = sites.height_m[index] - level[:, None]
    n = index.shape[1]
    gram = covariance.between(at, at)
    gram[:, np.arange(n), np.arange(n)] += (covariance.noise * sites.sigma_m[index]) ** 2
    cross = covariance.between(at, np.zeros((len(nodes_m), 1, 2)))
    basis = np.concatenate([np.ones((*index.shape, 1)), at], axis=2)
    solved = np.linalg.solve(gram, np.concatenate([basis, cross], axis=2))
    k_basis, k_cross = solved[:, :, :3], solved[:, :, 3]
    precision = np.swapaxes(basis, 1, 2) @ k_basis + np.diag([0.0, slope_sigma**-2, slope_sigma**-2])
    plane = np.linalg.solve(precision, np.einsum("qnk,qn->qk", k_basis, rise)[:, :, None])[:, :, 0]
    bent = rise - np.einsum("qnk,qk->qn", basis, plane)
    mean = plane[:, 0] + np.einsum("qn,qn->q", k_cross, bent)
    # The node is the origin of the basis: its row is (1, 0, 0).
    gap = np.array([1.0, 0.0, 0.0]) - np.einsum("qnk,qn->qk", k_basis, cross[:, :, 0])
    doubt = np.einsum("qk,qk->q", gap, np.linalg.solve(precision, gap[:, :, None])[:, :, 0])
    known = np.einsum("qn,qn->q", cross[:, :, 0], k_cross)
    variance = covariance.signal_m**2 - known + doubt
    # Rounding must not turn a certain node into an impossible one.
    floor = 1e-6 * np.min(sites.sigma_m[index], axis=1) ** 2
    return level + mean, np.sqrt(np.maximum(variance, floor))


def _constants(parameters: Parameters, sites: Sites, index: IntArray, spacing_m: float) -> Covariance:
    """The constants that were given, the others as chosen from evenly spread neighbourhoods of the sites."""
    given = (parameters.length_m, parameters.signal_m, parameters.noise_factor)
    if all(value > 0.0 for value in given):
        return Covariance(*given)
    step = max(1, len(index) // SAMPLES)
    best = chosen(sites.uv_m, sites.height_m, sites.sigma_m, index[::step], spacing_m)
    length, signal, noise = (
        mine if mine > 0.0 else found
        for mine, found in zip(given, (best.length_m, best.signal_m, best.noise), strict=True)
    )
    return Covariance(length, signal, noise)


def create(parameters: Parameters) -> FusionMethod:
    """The method with these parameters."""

    def estimate(heard: Survey, grid: MapGrid) -> Estimate:
        used = telling(heard, grid)
        kept = heard.select(used)
        height, sigma = np.full(grid.shape, np.nan), np.full(grid.shape, np.nan)
        wanted = covered(kept, grid)
        if not np.any(wanted):
            return Estimate(height, sigma, used)
        spacing = kept.spacing_m if np.isfinite(kept.spacing_m) else 0.01
        sites = mean_sites(kept.foot_m, kept.sigma_m, SAME * spacing, believed=True)
        tree, count = cKDTree(sites.uv_m), min(parameters.neighbours, len(sites))
        around = np.asarray(tree.query(sites.uv_m, k=[*range(1, count + 1)])[1], dtype=np.int64)
        covariance = _constants(parameters, sites, around, spacing)
        nodes = nodes_of(grid)[wanted.ravel()]
        index = np.asarray(tree.query(nodes, k=[*range(1, count + 1)])[1], dtype=np.int64)
        parts = [
            kriged(sites, nodes[k : k + BLOCK], index[k : k + BLOCK], covariance, parameters.slope_sigma)
            for k in range(0, len(nodes), BLOCK)
        ]
        height[wanted] = np.concatenate([mean for mean, _ in parts])
        sigma[wanted] = np.concatenate([spread for _, spread in parts])
        return Estimate(height, sigma, used)

    return mapwise("gaussian_process", parameters, estimate)
