"""One smooth pass against stops: robot time and error against truth of the three experiments.

Run: OMP_NUM_THREADS=1 python benchmarks/bench_smooth.py [--seeds N] [--driver kinematic]. Errors are root mean squares
over the seeds, because a tilted plate is seen through speckle, which the seed and every shift of the array change. Both
methods fuse the same readings.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from surfuse.commands.acquire.acquisition import acquire
from surfuse.commands.fuse.map_of_log import fused, grid_of
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.outcome import SilentWatcher
from surfuse.runs.scan_source import load_scan
from surfuse.settings import FusionSettings, load
from surfuse.surface.score import score
from surfuse.surface.truth import read_truth_mesh, truth_around

SCENES = ("flat", "tilted", "relief")
METHODS = ("weighted_average", "beam")


def measured(scene: str, how: tuple[str, ...], seed: int) -> tuple[float, float, dict[str, float]]:
    """Whole robot time (s), time from the first to the last reading (s), and RMSE (mm) of every method."""
    settings = load(None, [f"scene.name={scene}", f"seed={seed}", 'fusion.method="weighted_average"', *how])
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        outcome = acquire(settings, run, SilentWatcher())
        scan = load_scan(run)
        grid = grid_of(scan)
        truth = truth_around(*read_truth_mesh(run / "truth.ply"), grid)
        errors = {
            name: 1e3 * score(fused(scan, create_method(FusionSettings(), name), grid)[1], truth).rmse_m
            for name in METHODS
        }
    times = scan.readings.t_s
    robot_s = outcome.summary["robot_time_s"]
    assert isinstance(robot_s, float)
    return robot_s, float(times.max() - times.min()), errors


def main(scenes: list[str], seeds: int, driver: str, smooth: list[str]) -> None:
    """The table."""
    ways = {"stops": ("scan.mode=stops",), "smooth": ("scan.mode=smooth", *smooth)}
    print("scene    way     robot s   scan s   " + "   ".join(f"{name} RMSE mm" for name in METHODS))
    for scene in scenes:
        rows = {}
        for way, how in ways.items():
            found = [measured(scene, (*how, f"arm.driver={driver}"), seed) for seed in range(1, seeds + 1)]
            errors = [float(np.sqrt(np.mean([one[2][name] ** 2 for one in found]))) for name in METHODS]
            rows[way] = [float(np.mean([one[0] for one in found])), float(np.mean([one[1] for one in found])), *errors]
            print(line(scene, way, rows[way]))
        ratio = [new / old for new, old in zip(rows["smooth"], rows["stops"], strict=True)]
        print(line(scene, "ratio", ratio), flush=True)


def line(scene: str, way: str, numbers: list[float]) -> str:
    """One line of the table."""
    return f"{scene:8} {way:7} {numbers[0]:8.3f} {numbers[1]:8.3f}   {numbers[2]:12.3f}   {numbers[3]:12.3f}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=list(SCENES), help="flat, tilted, relief")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--driver", default="trident", choices=("trident", "kinematic"))
    parser.add_argument("--set", dest="smooth", action="append", default=[], help="settings of the smooth pass")
    chosen = parser.parse_args()
    main(chosen.scenes, chosen.seeds, chosen.driver, chosen.smooth)
