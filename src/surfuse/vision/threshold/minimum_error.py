"""Minimum error threshold: two Gaussians are fitted to the histogram, the level makes the fewest errors between them.

J. Kittler, J. Illingworth, Minimum error thresholding, Pattern Recognition 19, 1986, with the natural logarithm.
"""

from __future__ import annotations

import numpy as np

from surfuse.records import ByteArray, FloatArray, IntArray
from surfuse.vision.threshold import otsu
from surfuse.vision.threshold.histogram import LEVELS, Threshold, histogram, probabilities, separability

METHOD = "minimum_error"
_VARIANCE_MIN = 1e-9


def threshold(image: ByteArray) -> Threshold:
    """Divide an image (H, W) uint8."""
    return from_histogram(histogram(image))


def from_histogram(counts: IntArray) -> Threshold:
    """Divide a histogram (256,) at the interior local minimum of the criterion that stands out most.

    The criterion falls without limit towards the ends of a histogram, where one class shrinks to a single level:
    the lowest value there is no answer, so a minimum counts by how far the criterion rises on both sides of it.
    Without any interior minimum the level is the lowest value of the criterion; where no level leaves a spread in
    both classes (two grey levels, say) it is Otsu's.
    """
    criterion = error_criterion(counts)
    defined = np.flatnonzero(np.isfinite(criterion))
    if len(defined) == 0:
        level = otsu.from_histogram(counts).level
    else:
        minima = _interior_minima(criterion)
        level = _most_prominent(criterion, minima) if len(minima) else int(np.argmin(criterion))
    return Threshold(level, separability(counts, level), METHOD)


def error_criterion(counts: IntArray) -> FloatArray:
    """J(t) for every level t (256,), +inf where a class is empty or has no spread (Kittler and Illingworth, eq. 15)."""
    p = probabilities(counts)
    grey = np.arange(LEVELS)
    below, first, second = np.cumsum(p), np.cumsum(p * grey), np.cumsum(p * grey**2)
    inside = (np.cumsum(counts) > 0) & (np.cumsum(counts) < counts.sum())
    lower, upper = np.where(inside, below, 0.5), np.where(inside, 1.0 - below, 0.5)
    variance_lower = second / lower - (first / lower) ** 2
    variance_upper = (second[-1] - second) / upper - ((first[-1] - first) / upper) ** 2
    inside &= (variance_lower > _VARIANCE_MIN) & (variance_upper > _VARIANCE_MIN)
    variance_lower, variance_upper = np.where(inside, variance_lower, 1.0), np.where(inside, variance_upper, 1.0)
    # ln of a variance is twice ln of a standard deviation.
    spread = lower * np.log(variance_lower) + upper * np.log(variance_upper)
    criterion = 1.0 + spread - 2.0 * (lower * np.log(lower) + upper * np.log(upper))
    return np.where(inside, criterion, np.inf)


def _interior_minima(criterion: FloatArray) -> IntArray:
    """Levels lower than the one before and not higher than the one after, all three defined."""
    before, here, after = criterion[:-2], criterion[1:-1], criterion[2:]
    with np.errstate(invalid="ignore"):
        dips = np.isfinite(before) & np.isfinite(after) & (here < before) & (here <= after)
    return np.flatnonzero(dips) + 1


def _most_prominent(criterion: FloatArray, minima: IntArray) -> int:
    """The minimum with the highest barrier to anything lower, or to the end of the defined levels."""
    prominence = [min(_barrier(criterion[t::-1]), _barrier(criterion[t:])) for t in minima]
    return int(minima[int(np.argmax(prominence))])


def _barrier(outwards: FloatArray) -> float:
    """How far the criterion rises from its first value before it falls below it or ends."""
    ends = np.flatnonzero((outwards < outwards[0]) | ~np.isfinite(outwards))
    walk = outwards[: ends[0]] if len(ends) else outwards
    return float(walk.max() - outwards[0])
