"""Maximum entropy threshold: the level whose two classes together carry the most information.

J. N. Kapur, P. K. Sahoo, A. K. C. Wong, A new method for gray-level picture thresholding using the entropy of the
histogram, Computer Vision, Graphics and Image Processing 29, 1985.
"""

from __future__ import annotations

import numpy as np

from surfuse.records import ByteArray, FloatArray, IntArray
from surfuse.vision.threshold.histogram import Threshold, histogram, probabilities, separability

METHOD = "maximum_entropy"


def threshold(image: ByteArray) -> Threshold:
    """Divide an image (H, W) uint8."""
    return from_histogram(histogram(image))


def from_histogram(counts: IntArray) -> Threshold:
    """Divide a histogram (256,); of equally good levels the lowest, of a single grey level that level."""
    entropy = class_entropy(counts)
    occupied = np.flatnonzero(counts)
    level = int(np.argmax(entropy)) if len(occupied) > 1 else int(occupied[0])
    return Threshold(level, separability(counts, level), METHOD)


def class_entropy(counts: IntArray) -> FloatArray:
    """psi(t), the entropies of both classes added, for every level t (256,) in nats; -inf where a class is empty."""
    p = probabilities(counts)
    weight = np.cumsum(p)
    inside = (np.cumsum(counts) > 0) & (np.cumsum(counts) < counts.sum())
    surprise = np.cumsum(-p * np.log(np.where(p > 0.0, p, 1.0)))
    lower, upper = np.where(inside, weight, 0.5), np.where(inside, 1.0 - weight, 0.5)
    psi = np.log(lower * upper) + surprise / lower + (surprise[-1] - surprise) / upper
    return np.where(inside, psi, -np.inf)
