"""What the disk costs: log writing (synced, sweep by sweep), log reading, readings CSV, native map.

Run: `OMP_NUM_THREADS=1 python benchmarks/bench_storage.py`. Prints one line a measurement.
The peer of the log is a plain file with the same number of syncs; of the CSV, `numpy.loadtxt` on its numeric columns.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

import numpy as np

from surfuse.exporters import nc
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import FusionScene, MapGrid, SensorSpec, SurfaceMap, Sweep
from surfuse.runs.log_reader import read_log
from surfuse.runs.log_writer import LogWriter
from surfuse.runs.readings_csv import read_readings_csv

SPECS = tuple(
    SensorSpec(
        name=f"us{i}", kind="ultrasonic", range_min_m=0.2, range_max_m=1.2, beam_full_angle_rad=0.3, sigma_m=0.001
    )
    for i in range(4)
)


def sweep(stop: int, rng: np.random.Generator) -> Sweep:
    axis = rng.normal(size=(4, 3))
    return Sweep(
        stop=stop,
        row=stop // 25,
        world_from_grip=pose(rotation_about(rng.normal(size=3), 1.0), rng.normal(size=3)),
        t_s=0.3 * stop + 0.05 * np.arange(4),
        sensor=np.arange(4),
        position_m=rng.normal(size=(4, 3)),
        axis=axis / np.linalg.norm(axis, axis=1, keepdims=True),
        range_m=rng.uniform(0.3, 1.0, 4),
        status=np.zeros(4, dtype=np.int64),
        amplitude=rng.uniform(size=4),
        spread_m=rng.uniform(size=4),
        count=np.full(4, 8),
        joints_rad=rng.normal(size=6),
    )


def timed(label: str, count: int, unit: str, start: tuple[float, float]) -> float:
    wall, cpu = time.perf_counter() - start[0], time.process_time() - start[1]
    print(f"{label:42s} {wall:8.3f} s wall {cpu:8.3f} s cpu  {wall / count * 1e6:10.1f} us wall per {unit}")
    return wall


def now() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


def log(folder: Path, stops: int) -> None:
    rng = np.random.default_rng(0)
    sweeps = [sweep(stop, rng) for stop in range(stops)]
    start = now()
    with LogWriter(folder / "log") as writer:
        writer.append_scene(FusionScene(specs=SPECS, world_from_part=np.eye(4)))
        for item in sweeps:
            writer.append_sweep(item)
    ours = timed(f"log: write and sync {stops} sweeps", stops, "sweep", start)
    size = sum(path.stat().st_size for path in (folder / "log").iterdir())
    start = now()
    with (folder / "plain").open("wb", 0) as stream:
        for _ in range(stops):
            stream.write(bytes(size // stops))
            os.fsync(stream.fileno())
    plain = timed("peer: a plain file, as many syncs", stops, "sweep", start)
    start = now()
    read = read_log(folder / "log")
    timed("log: read back", stops, "sweep", start)
    print(
        f"log: {size / stops:.0f} bytes per sweep, {len(read.sweeps)} sweeps read, {ours / plain:.1f} x the plain file"
    )


def table(folder: Path, rows: int) -> None:
    rng = np.random.default_rng(1)
    path = folder / "readings.csv"
    k = np.arange(rows)
    x, y = 0.01 * ((k // 4) % 25), 0.01 * (k // 100 % 25)
    ranges = rng.uniform(0.4, 0.5, rows)
    with path.open("w") as stream:
        stream.write("t,sensor,px,py,pz,ax,ay,az,range_m,amplitude\n")
        for i in range(rows):
            stream.write(
                f"{0.05 * i:.3f},us{i % 4},{x[i]:.6f},{y[i]:.6f},0.430000,0.000000,0.000000,-1.000000,"
                f"{ranges[i]:.5f},0.5\n"
            )
    start = now()
    scan = read_readings_csv(path)
    ours = timed(f"csv: import {rows} readings", rows, "reading", start)
    start = now()
    np.loadtxt(path, delimiter=",", skiprows=1, usecols=(0, 2, 3, 4, 5, 6, 7, 8, 9))
    peer = timed("peer: numpy.loadtxt, numbers only", rows, "reading", start)
    print(f"csv: {scan.readings.n_sweeps} sweeps, {ours / peer:.2f} x numpy.loadtxt")


def surface(folder: Path, nodes: int) -> None:
    rng = np.random.default_rng(2)
    layer = rng.normal(size=(nodes, nodes))
    full = np.ones((nodes, nodes), dtype=bool)
    axis = 0.001 * np.arange(nodes)
    made = SurfaceMap(
        grid=MapGrid(u_m=axis, v_m=axis, world_from_part=np.eye(4)),
        height_m=layer,
        sigma_m=np.abs(layer),
        confidence=np.clip(layer, 0.0, 1.0),
        count=full.astype(np.int64),
        mask=full,
        regime=full.astype(np.uint8),
        method="mean",
    )
    start = now()
    nc.write(folder / "map.nc", made)
    timed(f"map: write {nodes} x {nodes} nodes", nodes * nodes, "node", start)
    start = now()
    nc.read(folder / "map.nc")
    timed("map: read and verify", nodes * nodes, "node", start)


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log(folder, 1200)
        table(folder, 1_000_000)
        surface(folder, 500)


if __name__ == "__main__":
    main()
