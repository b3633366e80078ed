"""Four ways to divide an image into a bright and a dark class, behind one interface.

Every method is a module with `threshold(image (H, W) uint8) -> Threshold`; a new one is a new module and a line here.
"""

from __future__ import annotations

from collections.abc import Callable

from surfuse.errors import UsageError, nearest
from surfuse.records import ByteArray
from surfuse.vision.threshold import maximum_entropy, minimum_error, otsu, uniform_error
from surfuse.vision.threshold.histogram import Threshold, histogram, separability

METHODS: dict[str, Callable[[ByteArray], Threshold]] = {
    module.METHOD: module.threshold for module in (otsu, maximum_entropy, uniform_error, minimum_error)
}


def threshold(image: ByteArray, method: str = otsu.METHOD) -> Threshold:
    """Divide an image (H, W) uint8 by the named method.

    Raises
    ------
    UsageError : no such method.
    DataError : the image is empty or not grey bytes.
    """
    if method not in METHODS:
        raise UsageError(f"unknown threshold method '{method}'", cure=nearest(method, METHODS))
    return METHODS[method](image)


__all__ = ["METHODS", "Threshold", "histogram", "separability", "threshold"]
