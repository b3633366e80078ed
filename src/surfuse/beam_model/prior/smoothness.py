"""Piecewise-smooth prior of a height raster: second and third differences with a redescending loss, solved directly.

The prior is a Gaussian on curvature (second differences) and on its change (third differences), each with a saturating
penalty, so that an edge costs a fixed price. Sources: Blake and Zisserman, Visual Reconstruction, 1987 (weak plate);
Black and Rangarajan, IJCV 19(1), 1996 (redescending loss as iterated weights, Geman-McClure form).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import BoolArray, FloatArray, IntArray

# Row offset, column offset and coefficient of each difference; the last three belong to order 2, the others to 3.
STENCILS = (
    (((0, -1, -1.0), (0, 0, 3.0), (0, 1, -3.0), (0, 2, 1.0)), 1.0),
    (((-1, 0, -1.0), (0, 0, 3.0), (1, 0, -3.0), (2, 0, 1.0)), 1.0),
    (((0, -1, -1.0), (0, 0, 2.0), (0, 1, -1.0), (1, -1, 1.0), (1, 0, -2.0), (1, 1, 1.0)), 3.0),
    (((-1, 0, -1.0), (0, 0, 2.0), (1, 0, -1.0), (-1, 1, 1.0), (0, 1, -2.0), (1, 1, 1.0)), 3.0),
    (((0, -1, 1.0), (0, 0, -2.0), (0, 1, 1.0)), 1.0),
    (((-1, 0, 1.0), (0, 0, -2.0), (1, 0, 1.0)), 1.0),
    (((0, 0, 1.0), (0, 1, -1.0), (1, 0, -1.0), (1, 1, 1.0)), 2.0),
)
THIRD_ORDER = 4


def _stencil_arrays() -> tuple[IntArray, FloatArray, IntArray, FloatArray]:
    offsets = np.zeros((len(STENCILS), 6, 2), dtype=np.int64)
    coefficients = np.zeros((len(STENCILS), 6))
    sizes = np.zeros(len(STENCILS), dtype=np.int64)
    shares = np.zeros(len(STENCILS))
    for k, (points, share) in enumerate(STENCILS):
        sizes[k], shares[k] = len(points), share
        for m, (dj, di, c) in enumerate(points):
            offsets[k, m] = dj, di
            coefficients[k, m] = c
    return offsets, coefficients, sizes, shares


OFFSETS, COEFFICIENTS, SIZES, SHARES = _stencil_arrays()


@dataclass(frozen=True)
class Stiffness:
    """Spectral densities of curvature (`second`, 1/m^2 per cell area) and of its change (`third`), and the price of an
    edge (`edge`, in units of log likelihood a broken difference).
    """

    second: float
    third: float
    edge: float


@compiled
def _energy(
    height: FloatArray, number: IntArray, offsets: IntArray, coefficients: FloatArray, sizes: IntArray,
    scale: FloatArray, edge: float,
) -> float:  # fmt: skip
    """Sum over all differences of edge * x / (edge + x), x = half scale * difference^2."""
    rows, cols = height.shape
    total = 0.0
    for k in range(sizes.shape[0]):
        for j in range(rows):
            for i in range(cols):
                bend = 0.0
                whole = True
                for m in range(sizes[k]):
                    jj, ii = j + offsets[k, m, 0], i + offsets[k, m, 1]
                    if jj < 0 or ii < 0 or jj >= rows or ii >= cols or number[jj, ii] < 0:
                        whole = False
                        break
                    bend += coefficients[k, m] * height[jj, ii]
                if whole:
                    x = 0.5 * scale[k] * bend * bend
                    total += edge * x / (edge + x)
    return total


@compiled
def _assemble(
    height: FloatArray, number: IntArray, offsets: IntArray, coefficients: FloatArray, sizes: IntArray,
    scale: FloatArray, edge: float, band: FloatArray,
) -> None:  # fmt: skip
    """Add the linearised prior to a band matrix (n, bandwidth + 1)."""
    rows, cols = height.shape
    index = np.zeros(6, dtype=np.int64)
    for k in range(sizes.shape[0]):
        for j in range(rows):
            for i in range(cols):
                bend = 0.0
                whole = True
                for m in range(sizes[k]):
                    jj, ii = j + offsets[k, m, 0], i + offsets[k, m, 1]
                    if jj < 0 or ii < 0 or jj >= rows or ii >= cols or number[jj, ii] < 0:
                        whole = False
                        break
                    index[m] = number[jj, ii]
                    bend += coefficients[k, m] * height[jj, ii]
                if not whole:
                    continue
                x = 0.5 * scale[k] * bend * bend
                w = scale[k] * (edge / (edge + x)) ** 2
                for m in range(sizes[k]):
                    for p in range(sizes[k]):
                        if index[m] >= index[p]:
                            band[index[p], index[m] - index[p]] += w * coefficients[k, m] * coefficients[k, p]


@compiled
def _bandwidth(number: IntArray, offsets: IntArray, sizes: IntArray) -> int:
    """Largest distance between two unknowns of one difference."""
    rows, cols = number.shape
    widest = 0
    for k in range(sizes.shape[0]):
        for j in range(rows):
            for i in range(cols):
                low, high = number.size, -1
                for m in range(sizes[k]):
                    jj, ii = j + offsets[k, m, 0], i + offsets[k, m, 1]
                    if jj < 0 or ii < 0 or jj >= rows or ii >= cols or number[jj, ii] < 0:
                        high = -1
                        break
                    low, high = min(low, number[jj, ii]), max(high, number[jj, ii])
                if high >= 0:
                    widest = max(widest, high - low)
    return widest


@dataclass(frozen=True)
class Plate:
    """The prior over one raster: `number` (R, C) numbers the cells of the domain, -1 outside.

    `bandwidth` is the largest distance between two unknowns of one difference, `g_m` the side of a cell, `domain` (R,
    C) marks the cells that have a height.
    """

    domain: BoolArray
    number: IntArray
    bandwidth: int
    g_m: float

    @property
    def size(self) -> int:
        """Number of unknown heights."""
        return int(self.domain.sum())

    def _scale(self, stiffness: Stiffness) -> FloatArray:
        second = self.g_m ** (-2.0) / stiffness.second
        third = self.g_m ** (-4.0) / stiffness.third
        return np.asarray(SHARES * np.where(np.arange(len(SHARES)) < THIRD_ORDER, third, second), dtype=np.float64)

    def energy(self, height: FloatArray, stiffness: Stiffness) -> float:
        """Minus log prior of a surface (R, C), up to its normalisation."""
        return float(_energy(height, self.number, OFFSETS, COEFFICIENTS, SIZES, self._scale(stiffness), stiffness.edge))

    def precision(self, height: FloatArray, stiffness: Stiffness, ridge: float) -> FloatArray:
        """Band form (see `band`) of the prior's precision at a surface; `ridge` (1/m^2) holds what nothing holds.

        The result is (n, bandwidth + 1) in 1/m^2; `height` (R, C) in m is where the saturating penalty is linearised,
        by weights (edge / (edge + x))^2.
        """
        band = np.zeros((self.size, self.bandwidth + 1))
        _assemble(
            height, self.number, OFFSETS, COEFFICIENTS, SIZES, self._scale(stiffness), stiffness.edge, band
        )  # fmt: skip
        band[:, 0] += ridge
        return band

    def field(self, values: FloatArray) -> FloatArray:
        """Spread values of the cells (n,) over the raster (R, C), 0 outside the domain."""
        result = np.zeros(self.domain.shape)
        result[self.domain] = values[self.number[self.domain]]
        return result

    def vector(self, layer: FloatArray) -> FloatArray:
        """Values (n,) of a layer (R, C) in the order of the unknowns."""
        result = np.zeros(self.size)
        result[self.number[self.domain]] = layer[self.domain]
        return result


def plate(domain: BoolArray, g_m: float) -> Plate:
    """Number the cells of a domain so that the band is narrow.

    `domain` (R, C), `g_m` the side of a cell; the numbers run along the shorter side, so that neighbours across it have
    numbers close to each other.
    """
    number = np.full(domain.shape, -1, dtype=np.int64)
    if domain.shape[0] >= domain.shape[1]:
        number[domain] = np.arange(domain.sum())
    else:
        number.T[domain.T] = np.arange(domain.sum())
    return Plate(domain, number, int(_bandwidth(number, OFFSETS, SIZES)), g_m)
