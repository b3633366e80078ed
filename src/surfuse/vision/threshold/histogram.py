"""The grey-level histogram of an image, and what a level that divides it is worth."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from surfuse.errors import DataError
from surfuse.records import ByteArray, FloatArray, IntArray

LEVELS = 256
_PEAK_WIDTH_MIN = 2.0
_PEAK_WIDTH_PER_SPREAD = 0.2


@dataclass(frozen=True)
class Threshold:
    """A level that divides an image: the foreground is brighter than `level`, the last level of the lower class.

    `separability` in [0, 1] says how far the histogram falls between the two classes, relative to the lower of their
    two peaks: 1 an empty valley, 0 no valley at all, so that the image is not bimodal and the level means nothing.

    `method` is the name of the one that found it.
    """

    level: int
    separability: float
    method: str


def histogram(image: ByteArray) -> IntArray:
    """Count the grey levels of an image (H, W) uint8: (256,).

    Raises
    ------
    DataError : not a grey image of bytes, or no pixel at all.
    """
    if image.dtype != np.uint8 or image.ndim != 2:
        raise DataError(
            f"a threshold needs a grey image of bytes, this one is {image.dtype} of shape {image.shape}",
            cure="convert it with surfuse.vision.picture.grey",
        )
    if image.size == 0:
        raise DataError("the image has no pixels", cure="give an image of at least one pixel")
    counts = cv2.calcHist([np.ascontiguousarray(image)], [0], None, [LEVELS], [0, LEVELS])
    return counts.ravel().astype(np.int64)


def probabilities(counts: IntArray) -> FloatArray:
    """Relative frequencies (256,) of a histogram.

    Raises
    ------
    DataError : wrong length, a negative count, or nothing counted.
    """
    if counts.shape != (LEVELS,) or int(counts.min()) < 0 or int(counts.sum()) == 0:
        raise DataError(
            f"a histogram of shape {counts.shape} with {int(counts.sum())} pixels cannot be divided",
            cure="give 256 counts, none negative, at least one positive",
        )
    shares: FloatArray = counts / counts.sum()
    return shares


def separability(counts: IntArray, level: int) -> float:
    """How far the histogram dips between the classes at `level`: 1 - valley / lower peak, in [0, 1].

    The histogram is smoothed before peaks are looked for (a fifth of the spread inside the classes, at least two
    levels), because counts are noisy and stretched images have combs. Exactly two occupied levels are 1 by
    definition, one level or an empty class 0. Valley depth after Rosenfeld and De La Torre, IEEE Trans. SMC-13, 1983.

    `counts` (256,) are those of the grey levels; `level` is the last one of the lower class.
    """
    occupied = np.flatnonzero(counts)
    if level < occupied[0] or level >= occupied[-1]:
        return 0.0
    if len(occupied) == 2:
        return 1.0
    smooth = _smoothed(counts, max(_PEAK_WIDTH_MIN, _PEAK_WIDTH_PER_SPREAD * _spread_inside(counts, level)))
    low, high = int(np.argmax(smooth[: level + 1])), level + 1 + int(np.argmax(smooth[level + 1 :]))
    peak = float(min(smooth[low], smooth[high]))
    return float(1.0 - smooth[low : high + 1].min() / peak)


def _spread_inside(counts: IntArray, level: int) -> float:
    """Standard deviation inside the classes, both classes together."""
    grey = np.arange(LEVELS)
    total = 0.0
    for part in (slice(0, level + 1), slice(level + 1, LEVELS)):
        weight = counts[part].sum()
        mean = (counts[part] @ grey[part]) / weight
        total += float(counts[part] @ (grey[part] - mean) ** 2)
    return float(np.sqrt(total / counts.sum()))


def _smoothed(counts: IntArray, width: float) -> FloatArray:
    """The histogram under a Gaussian; what leaves one end comes back in, so that a flat histogram stays flat."""
    reach = int(np.ceil(4.0 * width))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    padded = np.pad(counts.astype(np.float64), min(reach, LEVELS - 1), mode="symmetric")
    smooth: FloatArray = np.convolve(padded, kernel / kernel.sum(), mode="same")
    edge = min(reach, LEVELS - 1)
    return smooth[edge : edge + LEVELS]
