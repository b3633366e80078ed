"""The picture without its slow changes of illumination, and how noisy it is."""

from __future__ import annotations

import cv2
import numpy as np

from surfuse.records import ByteArray, FloatArray

_SHRINK = 8
_ROUNDS = 6
_TUKEY = 4.685
_TO_SIGMA = 1.4826
_SIGMA_MIN = 0.3


def flattened(image: ByteArray) -> tuple[FloatArray, float]:
    """Grey levels (H, W) above a quadratic fitted to the illumination, and their standard deviation without outliers.

    The fit is robust (Tukey's biweight): what covers less than half of the picture does not pull it.
    """
    height, width = image.shape
    size = max(width // _SHRINK, 3), max(height // _SHRINK, 3)
    small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.float64)
    y, x = np.meshgrid(np.linspace(-1, 1, size[1]), np.linspace(-1, 1, size[0]), indexing="ij")
    basis = np.column_stack([np.ones(x.size), x.ravel(), y.ravel(), (x * x).ravel(), (x * y).ravel(), (y * y).ravel()])
    level, weight = small.ravel(), np.ones(small.size)
    model = np.full(small.size, np.median(level))
    for _ in range(_ROUNDS):
        residual = level - model
        sigma = max(_TO_SIGMA * float(np.median(np.abs(residual))), _SIGMA_MIN)
        weight = np.clip(1.0 - (residual / (_TUKEY * sigma)) ** 2, 0.0, None) ** 2
        weighted = basis * weight[:, None]
        normal = weighted.T @ basis + 1e-9 * len(level) * np.eye(basis.shape[1])
        model = basis @ np.linalg.solve(normal, weighted.T @ level)
    ground = cv2.resize(model.reshape(small.shape).astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    difference = image.astype(np.float32) - np.asarray(ground, dtype=np.float32)
    noise = _TO_SIGMA * float(np.median(np.abs(difference[::3, ::3])))
    return np.asarray(difference, dtype=np.float64), max(noise, _SIGMA_MIN)
