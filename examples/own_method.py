"""A fusion method of one's own: the middle half of the readings of each stop, averaged."""

from pathlib import Path

import numpy as np

import surfuse as sf
from surfuse.confidence.gate import GateParameters
from surfuse.fusing.per_stop import Fused, per_stop

DATA = Path(__file__).parent / "data"


def middle_half(value_m: np.ndarray, sigma_m: np.ndarray) -> Fused:
    """Depth and standard deviation of each column of readings."""
    n = len(value_m)
    order = np.argsort(value_m, axis=0)[n // 4 : n - n // 4]
    value_m, sigma_m = (np.take_along_axis(given, order, axis=0) for given in (value_m, sigma_m))
    spread_m = np.maximum(sigma_m.mean(axis=0), value_m.std(axis=0))
    return Fused(value_m.mean(axis=0), spread_m / np.sqrt(len(order)))


method = per_stop("middle_half", GateParameters(), middle_half)
score = sf.evaluate(sf.fuse(sf.read(DATA / "readings.csv"), method), truth=DATA / "truth.ply")
print(f"{method.name}: mean error {score.mae_mm:.2f} mm, {100 * score.within_3mm:.0f} % within 3 mm")
