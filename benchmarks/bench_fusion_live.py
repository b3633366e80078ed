"""The map while the scan runs: time of one sweep with its preview, and how far the last preview is from the final map.

Run: OMP_NUM_THREADS=1 python benchmarks/bench_fusion_live.py LOG... A LOG is what `surfuse fuse` takes: a run folder, a
readings CSV. Wall time and processor time are given: the latter does not depend on what else the machine does.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from surfuse.commands.fuse.map_of_log import grid_of
from surfuse.fusion import beam
from surfuse.interfaces import LiveMapping
from surfuse.runs.scan_source import load_scan


def main() -> None:
    """Print one line a log."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path, nargs="+")
    print("sweeps   wall p50 / p99 ms   processor p50 / p99 / max ms   last preview - final map, median / p95 mm")
    for log in parser.parse_args().log:
        scan = load_scan(log)
        grid, method = grid_of(scan), beam.create(beam.Parameters())
        assert isinstance(method, LiveMapping)
        state = method.start(scan.scene())
        wall, own = [], []
        for j in range(scan.readings.n_sweeps):
            sweep = scan.readings.sweep(j)
            began, used = time.perf_counter(), time.process_time()
            method.step(state, sweep)
            preview = method.preview(state, grid)
            wall.append(1e3 * (time.perf_counter() - began))
            own.append(1e3 * (time.process_time() - used))
        final = method.finish(state, grid).surface
        assert final is not None
        apart = 1e3 * np.abs(preview.height_m - final.height_m)[preview.mask & final.mask]
        print(
            f"{len(wall):>6}   {np.median(wall):8.1f} / {np.percentile(wall, 99):.1f}"
            f"   {np.median(own):12.1f} / {np.percentile(own, 99):.1f} / {max(own):.1f}"
            f"   {np.median(apart):24.2f} / {np.percentile(apart, 95):.2f}   {log.name}"
        )


if __name__ == "__main__":
    main()
