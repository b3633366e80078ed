"""Otsu's threshold: the level that makes the variance between the two classes largest.

N. Otsu, A threshold selection method from gray-level histograms, IEEE Trans. SMC-9, 1979.
"""

from __future__ import annotations

import numpy as np

from surfuse.records import ByteArray, FloatArray, IntArray
from surfuse.vision.threshold.histogram import LEVELS, Threshold, histogram, probabilities, separability

METHOD = "otsu"


def threshold(image: ByteArray) -> Threshold:
    """Divide an image (H, W) uint8."""
    return from_histogram(histogram(image))


def from_histogram(counts: IntArray) -> Threshold:
    """Divide a histogram (256,); of equally good levels the lowest, of a single grey level that level."""
    between = between_class_variance(counts)
    level = int(np.argmax(between)) if between.max() > 0.0 else int(np.flatnonzero(counts)[0])
    return Threshold(level, separability(counts, level), METHOD)


def between_class_variance(counts: IntArray) -> FloatArray:
    """sigma_B^2(t) for every level t (256,), in squared grey levels; 0 where a class is empty (Otsu's equation 18)."""
    p = probabilities(counts)
    weight = np.cumsum(p)
    moment = np.cumsum(p * np.arange(LEVELS))
    # Counts decide which classes are empty: the sums of shares only reach 1 up to rounding.
    inside = (np.cumsum(counts) > 0) & (np.cumsum(counts) < counts.sum())
    spread = weight * (1.0 - weight)
    return np.where(inside, (moment[-1] * weight - moment) ** 2 / np.where(inside, spread, 1.0), 0.0)
