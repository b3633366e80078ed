"""Edges move by whole cells: pieces of the surface grow sideways where that explains the readings better."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from surfuse.beam_model.prior.raster import slopes
from surfuse.beam_model.prior.smoothness import Stiffness
from surfuse.beam_model.search.descent import descend, objective
from surfuse.beam_model.search.estimation import Arrivals, Estimation, arrivals, loudness, misfit, reach
from surfuse.beam_model.search.unheld_pieces import laid_onto, pieces
from surfuse.records import BoolArray, FloatArray, IntArray

DIRECTIONS = ((0, 1), (0, -1), (1, 0), (-1, 0))
MOST_BORDERS, SHORTEST_BORDER = 32, 2
LEAST_GAIN = 1.0
# Moving a border to both sides must cost so much before its place inside the cells is taken from it.
TELLING = 4.0
ROUNDS = 12
MOST_MERGES = 24
REACH = (1, 2, 4)
# The readings at an edge share the errors of the model: so many units of evidence are worth one.
EDGE_TEMPER = 4.0


@dataclass(frozen=True)
class Surface:
    """A surface with its slopes: `height_m`, `slope_u`, `slope_v` (R, C; dw/du, dw/dv), cells of `g_m`."""

    height_m: FloatArray
    slope_u: FloatArray
    slope_v: FloatArray
    g_m: float


def sloped(p: Estimation, height: FloatArray, crease_m: float) -> Surface:
    """A surface (R, C) in m with the slopes of its pieces; steps above `crease_m` between neighbours are edges."""
    su, sv, _, _, _ = slopes(height, p.raster.domain, p.raster.g_m, crease_m)
    return Surface(height, su, sv, p.raster.g_m)


def grown(surface: Surface, member: BoolArray, over: BoolArray, direction: tuple[int, int], cells: int) -> FloatArray:
    """Heights (R, C) in m with one piece continued by some cells in one direction over cells that may change.

    `member` (R, C) marks the piece, `over` (R, C) the cells that it may take; `direction` is (row, column), one of
    `DIRECTIONS`. The piece goes on with the slope of its last cell.
    """
    dj, di = direction
    g_m = surface.g_m
    result, inside = surface.height_m.copy(), member.copy()
    tall, wide = result.shape
    target = (slice(max(dj, 0), tall + min(dj, 0)), slice(max(di, 0), wide + min(di, 0)))
    source = (slice(max(-dj, 0), tall + min(-dj, 0)), slice(max(-di, 0), wide + min(-di, 0)))
    lean_u, lean_v = surface.slope_u.copy(), surface.slope_v.copy()
    for _ in range(cells):
        fresh = np.zeros_like(inside)
        fresh[target] = inside[source] & ~inside[target] & over[target]
        carried = np.zeros_like(result)
        carried[target] = result[source] + g_m * (di * lean_u[source] + dj * lean_v[source])
        lean_u[target] = np.where(fresh[target], lean_u[source], lean_u[target])
        lean_v[target] = np.where(fresh[target], lean_v[source], lean_v[target])
        result = np.where(fresh, carried, result)
        inside |= fresh
    return result


Border = tuple[int, int, tuple[int, int]]


def borders(number: IntArray) -> list[Border]:
    """Borders between pieces, longest first, at most `MOST_BORDERS`: a piece, the one beside it, and the direction.

    `number` (R, C) are those of `pieces`, -1 outside. Each is of `SHORTEST_BORDER` cells or more.
    """
    length: dict[Border, int] = {}
    rows, cols = number.shape
    for dj, di in DIRECTIONS:
        a = number[max(-dj, 0) : rows - max(dj, 0), max(-di, 0) : cols - max(di, 0)]
        b = number[max(dj, 0) : rows + min(dj, 0), max(di, 0) : cols + min(di, 0)]
        met = (a != b) & (a >= 0) & (b >= 0)
        pairs, counts = np.unique(np.column_stack([a[met], b[met]]), axis=0, return_counts=True)
        for (one, other), count in zip(pairs.tolist(), counts.tolist(), strict=True):
            if count >= SHORTEST_BORDER:
                length[(one, other, (dj, di))] = count
    return sorted(length, key=lambda border: (-length[border], border))[:MOST_BORDERS]


@dataclass(frozen=True)
class Costs:
    """What a surface costs: `misfit`, `loud` (M,) by station, `energy` of the prior; `heard` are its arrivals."""

    height_m: FloatArray
    heard: Arrivals
    misfit: FloatArray
    loud: FloatArray
    energy: float


def costs(p: Estimation, height: FloatArray, heard: Arrivals, stiffness: Stiffness, crease_m: float) -> Costs:
    """The costs of a surface (R, C) in m, in units of log likelihood."""
    return Costs(height, heard, misfit(p, heard, 0.0), loudness(p, height, crease_m), p.plate.energy(height, stiffness))


def change(p: Estimation, now: Costs, trial: FloatArray, stiffness: Stiffness, crease_m: float) -> float:
    """How much more another surface (R, C) in m costs; only the stations that hear the changed cells are asked."""
    r = p.raster
    j, i = np.nonzero(trial != now.height_m)
    if len(j) == 0:
        return 0.0
    middle = p.stations.foot_m
    near_m = float(np.median(p.stations.range_m)) * max(reach(table) for table in p.tables) + 2.0 * r.g_m
    u0, u1 = r.u0_m + r.g_m * i.min() - near_m, r.u0_m + r.g_m * i.max() + near_m
    v0, v1 = r.v0_m + r.g_m * j.min() - near_m, r.v0_m + r.g_m * j.max() + near_m
    only = (middle[:, 0] > u0) & (middle[:, 0] < u1) & (middle[:, 1] > v0) & (middle[:, 1] < v1)
    there = misfit(p, arrivals(p, trial, crease_m, only), 0.0) + loudness(p, trial, crease_m, only)
    return float(np.sum((there - now.misfit - now.loud)[only])) + p.plate.energy(trial, stiffness) - now.energy


def merge_small(
    p: Estimation, height: FloatArray, heard: Arrivals, stiffness: Stiffness, crease_m: float
) -> tuple[FloatArray, Arrivals]:
    """Lay small pieces onto their surroundings wherever the readings do not pay for the edge around them.

    Smallest first, at most `MOST_MERGES` of them. `height` (R, C) in m and its arrivals `heard` come back, changed or
    not; a bend above `crease_m` is an edge.
    """
    r = p.raster
    now = objective(p, height, heard, stiffness, 0.0)
    number = pieces(height, r.domain, r.g_m, 2.0 * crease_m)
    names, sizes = np.unique(number[r.domain], return_counts=True)
    for name in names[np.argsort(sizes)][:-1][:MOST_MERGES]:
        piece = number == name
        trial = laid_onto(height, r.domain & ~piece, piece, r.g_m, crease_m)
        there = arrivals(p, trial, crease_m)
        value = objective(p, trial, there, stiffness, 0.0)
        if value < now:
            height, heard, now = trial, there, value
    return height, heard


def settle(
    p: Estimation, height: FloatArray, heard: Arrivals, stiffness: Stiffness, crease_m: float,
    steps: tuple[int, ...] = REACH,
) -> tuple[FloatArray, Arrivals]:  # fmt: skip
    """Take the best move of all pieces and directions, settle the heights, and repeat while it helps.

    `height` (R, C) in m and the arrivals `heard` over it come back, better or the same. `steps` are the numbers of
    cells by which a piece may grow at once; a move must gain at least 1 unit of log likelihood, in at most `ROUNDS`
    rounds.
    """
    height, heard = merge_small(p, height, heard, stiffness, crease_m)
    for _ in range(ROUNDS):
        now = costs(p, height, heard, stiffness, crease_m)
        best, best_height = -LEAST_GAIN, None
        for _border, _cells, trial in moves(p, height, crease_m, steps):
            gain = change(p, now, trial, stiffness, crease_m)
            if gain < best:
                best, best_height = gain, trial
        if best_height is None:
            break
        height, heard = descend(p, best_height, stiffness, crease_m, (0.0,) * 3)
    return height, heard


def moves(
    p: Estimation, height: FloatArray, crease_m: float, steps: tuple[int, ...]
) -> Iterator[tuple[Border, int, FloatArray]]:
    """Every border moved by every number of cells: border, cells, heights (R, C) in m."""
    number = pieces(height, p.raster.domain, p.raster.g_m, 2.0 * crease_m)
    surface = sloped(p, height, crease_m)
    for border in borders(number):
        one, other, direction = border
        for cells in steps:
            yield border, cells, grown(surface, number == one, number == other, direction, cells)


def offsets(p: Estimation, height: FloatArray, stiffness: Stiffness, crease_m: float) -> tuple[FloatArray, FloatArray]:
    """How far (R, C), in cells, the edge between a cell and the next along u, and along v, lies beside their border.

    `height` (R, C) in m is settled. From what it costs to move a border by a cell to either side: the lowest point of
    the parabola through the three. Positive towards the next cell; 0 where no edge is or the costs say nothing.
    """
    now = costs(p, height, arrivals(p, height, crease_m), stiffness, crease_m)
    number = pieces(height, p.raster.domain, p.raster.g_m, 2.0 * crease_m)
    price = {
        border: change(p, now, trial, stiffness, crease_m) for border, _, trial in moves(p, height, crease_m, (1,))
    }
    along_u, along_v = np.zeros(height.shape), np.zeros(height.shape)
    for one, other, (dj, di) in price:
        forth, back = price[(one, other, (dj, di))], price.get((other, one, (-dj, -di)))
        if dj + di < 0 or back is None or min(forth, back) < 0.0 or forth + back < TELLING:
            continue
        shift = 0.5 * (back - forth) / (back + forth)
        layer, next_one = (along_u, np.s_[:, 1:]) if di else (along_v, np.s_[1:, :])
        first = np.s_[:, :-1] if di else np.s_[:-1, :]
        layer[first][(number[first] == one) & (number[next_one] == other)] = shift
    return along_u, along_v


def rivals(p: Estimation, height: FloatArray, stiffness: Stiffness, crease_m: float) -> tuple[FloatArray, FloatArray]:
    """Second surface beside each edge (R, C; nan: none) and its probability, cell by cell.

    The cell is put on the piece across the edge; the change of the objective, tempered, gives the odds of the two.

    `height` (R, C) in m is the surface that was found; the probability (R, C) is 0 where no rival is. Both pieces are
    those that bends above `crease_m` part.
    """
    r = p.raster
    number = pieces(height, r.domain, r.g_m, 2.0 * crease_m)
    heard = arrivals(p, height, crease_m)
    cost, energy = misfit(p, heard, 0.0), p.plate.energy(height, stiffness)
    middle = p.stations.position_m + p.stations.axis * p.stations.range_m[:, None]
    near_m = float(np.median(p.stations.range_m)) * max(reach(table) for table in p.tables)
    second, weight = np.full(height.shape, np.nan), np.zeros(height.shape)
    for j, i, other in _across(number, sloped(p, height, crease_m)):
        trial = height.copy()
        trial[j, i] = other
        u, v = r.u0_m + i * r.g_m, r.v0_m + j * r.g_m
        only = (middle[:, 0] - u) ** 2 + (middle[:, 1] - v) ** 2 < near_m**2
        there = misfit(p, arrivals(p, trial, crease_m, only), 0.0)
        change = float(np.sum((there - cost)[only])) + p.plate.energy(trial, stiffness) - energy
        second[j, i], weight[j, i] = other, 1.0 / (1.0 + np.exp(np.clip(change / EDGE_TEMPER, -30.0, 30.0)))
    return second, weight


def _across(number: IntArray, surface: Surface) -> list[tuple[int, int, float]]:
    """Cells next to another piece, with the height of that piece continued to them (the farther, if there are two)."""
    found: dict[tuple[int, int], float] = {}
    height, su, sv, g_m = surface.height_m, surface.slope_u, surface.slope_v, surface.g_m
    rows, cols = height.shape
    for dj, di in DIRECTIONS:
        a = number[max(-dj, 0) : rows - max(dj, 0), max(-di, 0) : cols - max(di, 0)]
        b = number[max(dj, 0) : rows + min(dj, 0), max(di, 0) : cols + min(di, 0)]
        for j, i in np.argwhere((a != b) & (a >= 0) & (b >= 0)):
            here, there = (int(j + max(-dj, 0)), int(i + max(-di, 0))), (int(j + max(dj, 0)), int(i + max(di, 0)))
            other = float(height[there] - g_m * (di * su[there] + dj * sv[there]))
            if here not in found or abs(other - height[here]) > abs(found[here] - height[here]):
                found[here] = other
    return [(j, i, other) for (j, i), other in sorted(found.items())]
