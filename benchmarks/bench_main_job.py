"""The main job from outside, as whole processes: wall time, ratio to the robot's time, peak memory.

Run: python benchmarks/bench_main_job.py [--runs 3]
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

SURFUSE = Path(sys.executable).with_name("surfuse")


@dataclass(frozen=True)
class Measured:
    """One finished process: wall time in s, peak memory in MiB, what it printed."""

    wall_s: float
    peak_mib: float
    output: str


def run(*arguments: str) -> Measured:
    """Run surfuse and account for it alone."""
    began = time.perf_counter()
    process = subprocess.Popen([SURFUSE, *arguments], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    output = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"surfuse {' '.join(arguments)} ended with status {os.waitstatus_to_exitcode(status)}")
    return Measured(time.perf_counter() - began, usage.ru_maxrss / 1024.0, output)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    runs = parser.parse_args().runs
    with tempfile.TemporaryDirectory() as folder:
        first = run("acquire", "--json", "--out", f"{folder}/first")
        acquired = [run("acquire", "--json", "--out", f"{folder}/a{i}") for i in range(runs)]
        robot_s = float(json.loads(acquired[0].output)["robot_time_s"])
        wall_s = statistics.median(one.wall_s for one in acquired)
        print(f"acquire, first run               {first.wall_s:8.2f} s")
        print(f"acquire, median of {runs}             {wall_s:8.2f} s")
        print(f"robot time over wall time        {robot_s / wall_s:8.0f}")
        print(f"acquire, peak memory             {max(one.peak_mib for one in acquired):8.0f} MiB")
        print(f"reproduce                        {run('reproduce', '--json', '--out', f'{folder}/r').wall_s:8.2f} s")
        help_s = statistics.median(run("--help").wall_s for _ in range(max(runs, 5)))
        print(f"--help                           {help_s:8.2f} s")


if __name__ == "__main__":
    main()
