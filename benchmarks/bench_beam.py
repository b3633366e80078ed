"""The beam-aware method: wall time, time a reading and peak memory against the number of readings.

    OMP_NUM_THREADS=1 python benchmarks/bench_beam.py [readings ...]

The surface is a gently waved plate with steps, heard at its distance along the axis: enough for the cost, which does
not depend on how the ranges were made. Accuracy is measured on scans of
physical simulators (docs/explanations/beam.md).
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np

from surfuse.fusion import beam
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import FusionScene, MapGrid, Readings, SensorSpec

SPEC = SensorSpec("us", "ultrasonic", 0.2, 1.2, float(np.radians(13.0)), 3e-4, frequency_hz=63e3, aperture_m=0.04)
CORNERS = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]]) * 0.025
STEP_M = 0.01


def surface(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Waves and a step every quarter of a metre, so that all sizes have the same share of edges."""
    return 0.004 * np.sin(4.0 * u) * np.cos(3.0 * v) + np.where(np.floor((u + 0.005) / 0.25) % 2 == 1, 0.03, 0.0)


def scan(count: int) -> tuple[FusionScene, Readings, MapGrid]:
    """About `count` readings of four sensors on a square raster."""
    side = round((count / 4) ** 0.5)
    axis = np.arange(side) * STEP_M
    u, v = np.meshgrid(axis, axis)
    m = u.size
    uv = (np.column_stack([u.ravel(), v.ravel()])[:, None, :] + CORNERS).reshape(-1, 2)
    rng = np.random.default_rng(0)
    ranges = 0.43 - surface(uv[:, 0], uv[:, 1]) + rng.normal(0.0, 3e-4, 4 * m)
    late = rng.random(4 * m) < 0.01
    ranges[late] += rng.exponential(0.05, late.sum())
    grip = np.tile(pose(rotation_about([1, 0, 0], np.pi), [0, 0, 0.43]), (m, 1, 1))
    grip[:, 0, 3], grip[:, 1, 3] = u.ravel(), v.ravel()
    readings = Readings(
        specs=(SPEC,) * 4, t_s=np.arange(4 * m) * 0.05, sensor=np.tile(np.arange(4), m),
        position_m=np.column_stack([uv, np.full(4 * m, 0.43)]), axis=np.tile([0.0, 0.0, -1.0], (4 * m, 1)),
        range_m=ranges, status=np.zeros(4 * m), amplitude=np.ones(4 * m), sigma_m=np.full(4 * m, np.nan),
        count=np.ones(4 * m), start=np.arange(m + 1) * 4, stop=np.arange(m), row=np.repeat(np.arange(side), side),
        world_from_grip=grip,
    )  # fmt: skip
    return FusionScene((SPEC,) * 4, np.eye(4)), readings, MapGrid(axis, axis, np.eye(4))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("readings", nargs="*", type=int, default=[2_500, 10_000, 100_000, 300_000])
    counts = parser.parse_args().readings
    method = beam.create(beam.Parameters())
    scene, readings, grid = scan(2_500)
    method.replay(scene, readings, grid)
    print("  readings   wall s    cpu s   us each   peak MiB")
    for count in counts:
        scene, readings, grid = scan(count)
        wall, cpu = time.perf_counter(), time.process_time()
        result = method.replay(scene, readings, grid).surface
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        assert result is not None
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        n = len(readings.t_s)
        print(f"{n:10d} {wall:8.2f} {cpu:8.2f} {1e6 * cpu / n:9.1f} {peak:10.0f}", flush=True)


if __name__ == "__main__":
    main()
