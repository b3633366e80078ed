"""Fusion methods on equal readings, against the truth."""

from pathlib import Path

import surfuse as sf

DATA = Path(__file__).parent / "data"
METHODS = ("mean", "median", "weighted_average", "own_axis_median", "beam")

log = sf.read(DATA / "readings.csv")
summaries = sf.methods()

print(f"{'method':<18}{'mean error':>11}{'within 3 mm':>13}{'edge':>10}")
for name in METHODS:
    score = sf.evaluate(sf.fuse(log, name), truth=DATA / "truth.ply")
    print(f"{name:<18}{score.mae_mm:>8.2f} mm{100 * score.within_3mm:>11.1f} %{score.edge_mm:>+7.1f} mm")
print()
for name in METHODS:
    print(f"{name}: {summaries[name]}")
