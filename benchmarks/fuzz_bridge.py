"""Damaged answers of a bridge over loopback: crashes, hangs, and wrong numbers let through.

Run: python benchmarks/fuzz_bridge.py [--cases N] [--seed S]. 100,000 cases take eleven minutes on a busy machine. What
is damaged, and how it is judged, stands in tests/bridge/mutations.py. One case in 2,000 is a flood of 100 MB.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "bridge"))
from mutations import fuzz


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    began_s = time.perf_counter()
    findings = fuzz(asked.cases, asked.seed, flood_bytes=100 * 10**6)
    for outcome, count in sorted(findings.outcomes.items()):
        print(f"{count:9,} {outcome}")
    print(f"{len(findings.crashes):9,} crashes, {len(findings.wrong):,} wrong numbers")
    print(f"slowest case {findings.slowest_s:.2f} s, all {time.perf_counter() - began_s:.0f} s, seed {asked.seed}")
    for case, what in (*findings.crashes[:5], *findings.wrong[:5]):
        print(case, what)
    sys.exit(bool(findings.crashes or findings.wrong))


if __name__ == "__main__":
    main()
