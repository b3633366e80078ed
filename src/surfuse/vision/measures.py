"""How good a division of a picture is: measures of the comparative studies of thresholds.

M. Sezgin, B. Sankur, Survey over image thresholding techniques and quantitative performance evaluation, Journal of
Electronic Imaging 13, 2004, section 9; 0 is perfect and 1 the worst in each of them.
"""

from __future__ import annotations

import numpy as np

from surfuse.errors import DataError
from surfuse.records import BoolArray, ByteArray


def misclassification_error(found: BoolArray, truth: BoolArray) -> float:
    """Share of pixels in the wrong class; both masks (H, W), true is the part.

    Raises
    ------
    DataError : the masks differ in size.
    """
    check_size(found, truth)
    return float(np.count_nonzero(found != truth) / truth.size)


def foreground_area_error(found: BoolArray, truth: BoolArray) -> float:
    """Difference of the areas relative to the larger one; 0 when both masks (H, W) are empty.

    Raises
    ------
    DataError : the masks differ in size.
    """
    check_size(found, truth)
    areas = int(np.count_nonzero(found)), int(np.count_nonzero(truth))
    return (max(areas) - min(areas)) / max(areas) if max(areas) else 0.0


def region_non_uniformity(image: ByteArray, found: BoolArray) -> float:
    """Variance inside the foreground by that of the picture, weighted by the foreground's share of it.

    Needs no truth. Image and mask (H, W); 0 for a uniform picture or an empty foreground.

    Raises
    ------
    DataError : picture and mask differ in size.
    """
    check_size(found, image)
    whole = float(image.var())
    part = image[found]
    return float(part.size / image.size * part.var() / whole) if part.size and whole > 0.0 else 0.0


def check_size(mask: BoolArray, other: BoolArray | ByteArray) -> None:
    """Refuse a mask (H, W) of another size than a picture or mask.

    Raises
    ------
    DataError : the sizes differ.
    """
    if mask.shape != other.shape:
        raise DataError(
            f"the mask has {_size(mask)} pixels, the picture {_size(other)}", cure="give a mask of the picture's size"
        )


def _size(image: BoolArray | ByteArray) -> str:
    return " x ".join(str(side) for side in image.shape[::-1])
