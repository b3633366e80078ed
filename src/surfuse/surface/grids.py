"""Grids made from grids: continued, refined, found in one another."""

from __future__ import annotations

import numpy as np

from surfuse.errors import DataError
from surfuse.records import FloatArray, MapGrid

SAME_M = 1e-9
"""Nodes closer than this are the same node."""

MOST_NODES = 10_000_000
"""A grid that is continued to more nodes than this has met a truth in other units or another frame."""


def same_nodes(a: MapGrid, b: MapGrid) -> bool:
    """Whether two grids have the same nodes in the same frame."""
    return a.shape == b.shape and place_in(a, b) == (0, 0)


def place_in(outer: MapGrid, inner: MapGrid) -> tuple[int, int] | None:
    """Row and column of the first node of `inner` in `outer` when its nodes are a block of outer's, else None."""
    if not np.allclose(outer.world_from_part, inner.world_from_part, rtol=0.0, atol=SAME_M):
        return None
    found = []
    for whole, part in ((outer.v_m, inner.v_m), (outer.u_m, inner.u_m)):
        first = int(np.argmin(np.abs(whole - part[0])))
        block = whole[first : first + len(part)]
        if len(block) < len(part) or np.max(np.abs(block - part)) > SAME_M:
            return None
        found.append(first)
    return found[0], found[1]


def extended_grid(grid: MapGrid, low_uv_m: FloatArray, high_uv_m: FloatArray) -> MapGrid:
    """The grid, continued with its own outer steps until it covers the box low to high (2,) in its part frame.

    The nodes of the grid stay where they are. An axis of a single node takes the step of the other; a grid of a single
    node is not continued.

    Raises
    ------
    DataError : the grid would have more than `MOST_NODES` nodes.
    """
    steps = [float(np.median(np.diff(nodes))) for nodes in (grid.u_m, grid.v_m) if len(nodes) > 1]
    axes = []
    for nodes, low, high in zip((grid.u_m, grid.v_m), low_uv_m, high_uv_m, strict=True):
        if not steps:
            axes.append(nodes)
            continue
        first, last = (nodes[1] - nodes[0], nodes[-1] - nodes[-2]) if len(nodes) > 1 else (steps[0], steps[0])
        # A node within a millionth of a step of the box's edge is on it.
        before = max(0, int(np.floor((nodes[0] - low) / first + 1e-6)))
        after = max(0, int(np.floor((high - nodes[-1]) / last + 1e-6)))
        if before + after > MOST_NODES:
            raise _too_far(max(before, after))
        axes.append(
            np.concatenate(
                [nodes[0] - first * np.arange(before, 0, -1), nodes, nodes[-1] + last * np.arange(1, after + 1)]
            )
        )
    if len(axes[0]) * len(axes[1]) > MOST_NODES:
        raise _too_far(max(len(axes[0]), len(axes[1])))
    return MapGrid(axes[0], axes[1], grid.world_from_part)


def _too_far(steps: int) -> DataError:
    return DataError(
        f"truth reaches {steps} steps of the map far", cure="check units (--scale) and frames of map and truth"
    )


def refined(grid: MapGrid, factor: int) -> MapGrid:
    """The grid with `factor` times as many steps along both axes; its own nodes stay nodes.

    An axis of a single node stays as it is.

    Raises
    ------
    DataError : `factor` is below 1.
    """
    if factor < 1:
        raise DataError(f"a grid cannot be refined {factor} times", cure="give a factor >= 1")

    def finer(nodes: FloatArray) -> FloatArray:
        index = np.arange((len(nodes) - 1) * factor + 1) / factor
        return np.asarray(np.interp(index, np.arange(len(nodes)), nodes), dtype=np.float64)

    return MapGrid(finer(grid.u_m), finer(grid.v_m), grid.world_from_part)
