"""Speed of the sweepwise fusion methods: replay from memory, and one live step with its Python.

Run: OMP_NUM_THREADS=1 python benchmarks/bench_fusion.py [--stops N]. Times are the best of five runs.
Besides the method's `replay` it times a plain-Python copy of equations 1 and 2 with fixed factors, as the ratio that
does not depend on the machine.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from surfuse.confidence.gate import limits_of
from surfuse.fusing.sweepwise import SweepwiseFusion
from surfuse.interfaces import FusionMethod
from surfuse.records import FusionScene, MapGrid, Outline, Readings, SensorSpec
from surfuse.records.kernel_columns import empty_points, scan_of
from surfuse.registry import load

METHODS = ("weighted_average", "mean", "median")
GRID = MapGrid(np.zeros(1), np.zeros(1), np.eye(4))


def plate(n_stops: int, vertices: int) -> tuple[FusionScene, Readings]:
    """Readings of four sensors at 5 cm over a facing plate, in rows of 1,000 stops; 1 % are no echo."""
    rng = np.random.default_rng(0)
    spec = SensorSpec("us", "ultrasonic", 0.2, 1.2, np.radians(13.0), 0.0003)
    stop = np.arange(n_stops)
    origin = np.column_stack([(stop % 1000) * 0.01, (stop // 1000) * 0.01, np.full(n_stops, 0.43)])
    grip = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (n_stops, 1, 1))
    grip[:, :3, 3] = origin
    corner = np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]]) * 0.025
    position = (origin[:, None, :] + corner).reshape(-1, 3)
    ranges = 0.43 + rng.normal(0.0, 0.0003, 4 * n_stops)
    ranges[rng.random(4 * n_stops) < 0.01] = np.inf
    readings = Readings(
        specs=(spec,) * 4,
        t_s=np.arange(4 * n_stops) * 0.05,
        sensor=np.tile(np.arange(4), n_stops),
        position_m=position,
        axis=np.tile([0.0, 0.0, -1.0], (4 * n_stops, 1)),
        range_m=ranges,
        status=np.where(np.isinf(ranges), 1, 0),
        amplitude=np.full(4 * n_stops, np.nan),
        sigma_m=np.full(4 * n_stops, np.nan),
        count=np.ones(4 * n_stops),
        start=np.arange(n_stops + 1) * 4,
        stop=stop,
        row=stop // 1000,
        world_from_grip=grip,
    )
    edge = np.linspace(0.0, 1.0, vertices // 4, endpoint=False)
    square = np.concatenate(
        [np.c_[edge, 0 * edge], np.c_[1 + 0 * edge, edge], np.c_[1 - edge, 1 + 0 * edge], np.c_[0 * edge, 1 - edge]]
    )
    size = np.array([10.0, n_stops / 1000 * 0.01])
    outline = Outline(square * size, np.eye(4))
    return FusionScene(specs=(spec,) * 4, world_from_part=np.eye(4), outline=outline), readings


def best(action: Callable[[], object], repeats: int = 5) -> float:
    """Shortest wall time in s."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        action()
        times.append(time.perf_counter() - begin)
    return min(times)


def kernel_time(method: FusionMethod, scene: FusionScene, readings: Readings) -> float:
    """Time of the walk alone: columns in, columns out, no records."""
    assert isinstance(method, SweepwiseFusion)
    scan, out = scan_of(readings), empty_points(readings.n_sweeps, len(readings.t_s))
    limits = limits_of(scene, method.gates)
    return best(lambda: method.walk(scan, limits, method.fresh(4), out))


def live_time(method: FusionMethod, scene: FusionScene, readings: Readings, steps: int = 3000) -> tuple[float, float]:
    """Median and 99th percentile of one live step in s."""
    sweeps = [readings.sweep(j) for j in range(steps)]
    state, times = method.start(scene), []
    for sweep in sweeps:
        begin = time.perf_counter()
        method.step(state, sweep)
        times.append(time.perf_counter() - begin)
    return float(np.median(times)), float(np.percentile(times, 99))


def plain_python_time(stops: int = 20_000) -> float:
    """Seconds a stop of equations 1 and 2 in plain Python, factors given: the yardstick for the ratio."""
    rng = np.random.default_rng(0)
    values, factors = rng.normal(0.43, 1e-3, (stops, 4)).tolist(), rng.random((stops, 4, 3)).tolist()

    def run() -> float:
        total = 0.0
        for m, f in zip(values, factors, strict=True):
            dc = [a * b * c for a, b, c in f]
            total += sum(x * w for x, w in zip(m, dc, strict=True)) / sum(dc)
        return total

    return best(run) / stops


def main() -> None:
    """Print one table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stops", type=int, default=500_000)
    stops = parser.parse_args().stops
    yardstick = plain_python_time()
    print(f"plain Python, equations 1 and 2 with given factors: {1e6 * yardstick:.2f} us a stop")
    print("method            outline   kernel stops/s  replay stops/s  replay readings/s  ratio  live us (median, p99)")
    for name in METHODS:
        module = load("fusion", name)
        method = module.create(module.Parameters())
        for vertices in (4, 400):
            scene, readings = plate(stops, vertices)
            method.replay(scene, plate(2000, vertices)[1], GRID)
            kernel = kernel_time(method, scene, readings)
            replay = best(lambda m=method, s=scene, r=readings: m.replay(s, r, GRID), 3)
            median, p99 = live_time(method, scene, readings)
            print(
                f"{name:17s} {vertices:4d} pts {stops / kernel:14.3g} {stops / replay:15.3g} {4 * stops / replay:18.3g}"
                f" {yardstick * stops / replay:6.1f} {1e6 * median:9.1f} {1e6 * p99:9.1f}"
            )


if __name__ == "__main__":
    main()
