"""A map of a million nodes with its standard deviation: gridded from a million stops, or drawn finer from few nodes.

Run: OMP_NUM_THREADS=1 python benchmarks/bench_fusion_map.py. Processor time, the best of five.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from surfuse.records import FusedPoints, MapGrid, SurfaceMap
from surfuse.surface.gridding import grid_points
from surfuse.surface.splines import spline_surface

SIDE, STEP_M = 1000, 0.001


def stops(side: int) -> FusedPoints:
    """One fused point of four readings near each node of a square lattice, with pose noise."""
    rng = np.random.default_rng(0)
    n = side * side
    u, v = (axis.ravel() for axis in np.meshgrid(np.arange(side) * STEP_M, np.arange(side) * STEP_M))
    place = np.column_stack([u, v, np.zeros(n)]) + rng.normal(size=(n, 3)) * [5e-5, 5e-5, 1e-3]
    one, whole = np.ones(4 * n), np.zeros(n, dtype=np.int64)
    return FusedPoints(
        stop=np.arange(n), row=np.arange(n) // side, depth_m=np.full(n, 0.4), sigma_m=np.full(n, 1e-4), point_m=place,
        gap=whole, reset=whole > 0, start=4 * np.arange(n + 1), sensor=np.tile(np.arange(4), n), dc=one, dc1=one,
        dc2=one, dc3=one, gate=np.zeros(4 * n),
    )  # fmt: skip


def best(action: Callable[[], SurfaceMap]) -> float:
    """Shortest processor time in s."""
    times = []
    for _ in range(5):
        begin = time.process_time()
        action()
        times.append(time.process_time() - begin)
    return min(times)


def main() -> None:
    """Print two lines."""
    nodes = np.arange(SIDE) * STEP_M
    million, grid = stops(SIDE), MapGrid(nodes, nodes, np.eye(4))
    print(f"gridded from 1,000,000 stops: {best(lambda: grid_points(million, grid, 'gridded')):.3f} s")
    coarse = grid_points(stops(24), MapGrid(nodes[:24], nodes[:24], np.eye(4)), "gridded")
    fine = spline_surface(coarse, refine=44)
    print(f"drawn with {fine.height_m.size} nodes: {best(lambda: spline_surface(coarse, refine=44)):.3f} s")


if __name__ == "__main__":
    main()
