"""Uniform error threshold: the level at which both classes hold the same share of wrong pixels.

S. M. Dunn, D. Harwood, L. S. Davis, Local estimation of the uniform error threshold, IEEE Trans. PAMI-6, 1984. Errors
of neighbouring pixels are independent, their true classes are not: comparing single pixels with pairs and blocks of
neighbours therefore tells errors from structure, without any model of the histogram. Needs large objects.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from surfuse.errors import DataError
from surfuse.records import ByteArray, FloatArray, IntArray
from surfuse.vision.threshold.histogram import LEVELS, Threshold, histogram, separability

METHOD = "uniform_error"


@dataclass(frozen=True)
class BlockCounts:
    """Histograms (256,) of the four grey levels of all disjoint 2 x 2 blocks, sorted inside each block.

    `smallest`, `second`, `third`, `largest` each sum up to the number of blocks.
    """

    smallest: IntArray
    second: IntArray
    third: IntArray
    largest: IntArray


def threshold(image: ByteArray) -> Threshold:
    """Divide an image (H, W) uint8; never below its lowest grey level, which also is the answer without 2 x 2 pixels.

    Two levels in pure blocks have phi = 1 everywhere between them: the lower one is their level.
    """
    counts = histogram(image)
    level = int(np.flatnonzero(counts)[0])
    if min(image.shape) > 1:
        level = max(level, from_blocks(block_counts(image)))
    return Threshold(level, separability(counts, level), METHOD)


def block_counts(image: ByteArray) -> BlockCounts:
    """Sort every 2 x 2 block of an image (H, W) uint8 and count; an odd last row or column is left out.

    Raises
    ------
    DataError : the image has no whole block.
    """
    rows, columns = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    if rows == 0 or columns == 0:
        raise DataError(f"an image of shape {image.shape} has no 2 x 2 block", cure="give at least 2 x 2 pixels")
    a, b, c, d = (np.ascontiguousarray(image[i:rows:2, j:columns:2]) for i in (0, 1) for j in (0, 1))
    # A sorting network of five comparisons, each on whole images.
    a, b = _sorted_pair(a, b)
    c, d = _sorted_pair(c, d)
    smallest, middle_low = _sorted_pair(a, c)
    middle_high, largest = _sorted_pair(b, d)
    second, third = _sorted_pair(middle_low, middle_high)
    return BlockCounts(histogram(smallest), histogram(second), histogram(third), histogram(largest))


def _sorted_pair(a: ByteArray, b: ByteArray) -> tuple[ByteArray, ByteArray]:
    return np.asarray(cv2.min(a, b), dtype=np.uint8), np.asarray(cv2.max(a, b), dtype=np.uint8)


def from_blocks(blocks: BlockCounts) -> int:
    """The last level with phi(t) > 1, found by bisection between 0 and 255 as the method's authors search."""
    phi = error_ratio(blocks)
    low, high = 0, LEVELS - 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if phi[middle] > 1.0 else (low, middle)
    return low


def error_ratio(blocks: BlockCounts) -> FloatArray:
    """phi(t) (256,) = sqrt((b^2 - c) / (a^2 - b)) = error of the background + 1 - error of the object; nan: undefined.

    a, b, c are the shares of pixels, of pairs inside a block, and of whole blocks, that are brighter than t.
    """
    pairs = 3 * blocks.smallest + 2 * blocks.second + blocks.third
    pixels = blocks.smallest + blocks.second + blocks.third + blocks.largest
    a, b, c = (_share_above(counts) for counts in (pixels, pairs, blocks.smallest))
    with np.errstate(divide="ignore", invalid="ignore"):
        phi: FloatArray = np.sqrt((b**2 - c) / (a**2 - b))
    return phi


def _share_above(counts: IntArray) -> FloatArray:
    total = int(counts.sum())
    share: FloatArray = (total - np.cumsum(counts)) / total
    return share
