"""The dim foot of a round part: what the light from above leaves too dark for the threshold of the whole picture."""

from __future__ import annotations

import cv2
import numpy as np

from surfuse.records import BoolArray, ByteArray, Detection, FloatArray

_BESIDE_PX = 9
_GAP_PX = 5
_DOWN_SHARE = 0.5


def with_dim_foot(detection: Detection, smooth: ByteArray, contrast_min: float) -> tuple[ByteArray, bool] | None:
    """The region in a picture (H, W), continued downwards, as a mask (H, W), and whether it is bright; None if it ends.

    Below the region and in its columns, pixels belong to it when they differ, to the same side and by `contrast_min`
    levels, from what is beside the region in their row, and hang together with it. Something that stands behind the
    table is not continued: below it is the table, as beside it.
    """
    contour = np.rint(detection.contour_px).astype(np.int32)
    (left, top), (right, bottom) = contour.min(axis=0), contour.max(axis=0)
    low = max(int(top), 0)
    high = min(int(bottom + _DOWN_SHARE * (bottom - top)) + 1, smooth.shape[0])
    ground = _ground(smooth[low:high].astype(np.float64), int(left), int(right))
    filled = np.zeros(smooth.shape, np.uint8)
    cv2.fillPoly(filled, [contour.reshape(-1, 1, 2)], 1)
    inside: BoolArray = filled.view(np.bool_)
    if ground is None or not inside[low:high].any():
        return None
    differs = smooth[low:high] - ground[:, None]
    bright = float(np.median(differs[inside[low:high]])) > 0.0
    unlike = (differs if bright else -differs) >= contrast_min
    unlike[:, : max(int(left), 0)] = False
    unlike[:, int(right) + 1 :] = False
    unlike[: int(bottom) - low] = False
    # Threads of noise are thinner than three pixels.
    solid = cv2.morphologyEx(unlike.view(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    unlike = np.asarray(solid, dtype=np.uint8).view(np.bool_)
    unlike |= inside[low:high]
    _, labels = cv2.connectedComponents(unlike.view(np.uint8), connectivity=8)
    joined = np.isin(labels, np.unique(labels[inside[low:high]])) & unlike
    # One component holds the region; its last row must be lower than before.
    if int(np.flatnonzero(joined.any(axis=1))[-1]) + low <= int(bottom) + 1:
        return None
    filled[low:high] = joined
    return filled, bright


def _ground(rows: FloatArray, left: int, right: int) -> FloatArray | None:
    """Grey level (R,) of what is beside the columns of a region, row by row; None where the picture ends there."""
    width = rows.shape[1]
    columns = np.concatenate(
        [
            np.arange(left - _GAP_PX - _BESIDE_PX, left - _GAP_PX),
            np.arange(right + _GAP_PX + 1, right + _GAP_PX + _BESIDE_PX + 1),
        ]
    )
    columns = columns[(columns >= 0) & (columns < width)]
    return np.asarray(np.median(rows[:, columns], axis=1), dtype=np.float64) if len(columns) else None
