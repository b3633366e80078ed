"""Whether a region of a picture is a part that stands on the table."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from surfuse.errors import ConfigError
from surfuse.records import BoolArray, ByteArray, CameraFrame, Detection, FloatArray
from surfuse.vision.table import TableRing, edge_rows, foot_rows

_RING_PX = 9
_GAP_PX = 5
_DARKEST_SHARE = 0.25
_ROW_PIXELS = 2
_THREAD_LEVELS = 25.0
_FAINT_WIDTH = 1.0 / 3.0


@dataclass(frozen=True)
class StandingParameters:
    """Where the foot of a part may be, and what is the table itself.

    Parameters
    ----------
    foot_slack_px : how far below the table's near edge a part's lowest pixel may be.
    behind_px : how far below the table's far edge it must be: at the edge itself ends whatever stands behind the table.
    along_edge_max : share of the boundary of a region cut by the picture that may run along the table's far edge.
    """

    foot_slack_px: float = 6.0
    behind_px: float = 3.0
    along_edge_max: float = 0.25

    def __post_init__(self) -> None:
        for name in ("foot_slack_px", "behind_px"):
            if not 0.0 <= getattr(self, name) < float("inf"):
                raise ConfigError(f"{name} = {getattr(self, name)}", cure="give a finite number >= 0")
        if not 0.0 <= self.along_edge_max <= 1.0:
            raise ConfigError(f"along_edge_max = {self.along_edge_max}", cure="give a share between 0 and 1")


def runs_through(detection: Detection, width_px: int) -> bool:
    """Whether a region reaches from the left to the right side of the picture: the table, or the room."""
    x = detection.contour_px[:, 0]
    return bool(x.min() <= 1.0 and x.max() >= width_px - 2.0)


def on_table(
    detection: Detection, frame: CameraFrame, smooth: ByteArray, table: TableRing, chosen: StandingParameters
) -> bool:
    """Whether the lowest pixel of a region in a picture (H, W) is on the table top, and the region is not the table."""
    if not ends_on_table(detection, frame, table, chosen):
        return False
    lowest = _bright_foot(detection, smooth)
    return lowest is None or _within(lowest, frame, table, chosen)


def ends_on_table(detection: Detection, frame: CameraFrame, table: TableRing, chosen: StandingParameters) -> bool:
    """The same for a region whose foot is known to be real, however dim it is."""
    lowest = detection.contour_px[np.argmax(detection.contour_px[:, 1])]
    return not _is_table(detection, frame, table, chosen) and _within(lowest, frame, table, chosen)


def _within(lowest: FloatArray, frame: CameraFrame, table: TableRing, chosen: StandingParameters) -> bool:
    rows = foot_rows(frame, lowest, table)
    if rows is None:
        return False
    bottom = frame.camera.height_px - 1.0
    below_far_edge = rows[0] + chosen.behind_px <= lowest[1]
    above_near_edge = lowest[1] <= rows[1] + chosen.foot_slack_px
    return (below_far_edge and above_near_edge) or (lowest[1] >= bottom - 1.0 and rows[1] > bottom)


def _is_table(detection: Detection, frame: CameraFrame, table: TableRing, chosen: StandingParameters) -> bool:
    """Whether a region that the picture's border cuts is bounded by the table's far edge, as the table itself is."""
    if not detection.touches_border:
        return False
    contour = detection.contour_px
    x, y = contour.T
    inside = (x > 1.0) & (x < frame.camera.width_px - 2.0) & (y > 1.0) & (y < frame.camera.height_px - 2.0)
    if not inside.any():
        return False
    far = edge_rows(frame, contour[inside], table)[:, 0]
    return float(np.mean(np.abs(y[inside] - far) <= chosen.behind_px)) > chosen.along_edge_max


def _bright_foot(detection: Detection, smooth: ByteArray) -> FloatArray | None:
    """The lowest pixel (2,) of a region that is clearly unlike what is around its foot; None without such a difference.

    Threads of noise that hang from a region are like what is around them, halfway at most to its darkest side. Where
    the region itself is hardly different, its foot is where it is a third as wide as elsewhere: threads are narrow.
    """
    contour = np.rint(detection.contour_px).astype(np.int32)
    low = np.maximum(contour.min(axis=0) - _RING_PX, 0)
    high = np.minimum(contour.max(axis=0) + _RING_PX + 1, smooth.shape[::-1])
    window = smooth[low[1] : high[1], low[0] : high[0]].astype(np.float64)
    filled = np.zeros(window.shape, np.uint8)
    cv2.fillPoly(filled, [(contour - low).reshape(-1, 1, 2)], 1)
    inside: BoolArray = filled.view(np.bool_)
    outside = _grown(filled, _RING_PX) & ~_grown(filled, _GAP_PX)
    outside[: max(window.shape[0] - 3 * _RING_PX, 0)] = False
    if not inside.any() or not outside.any():
        return None
    ground = float(np.median(window[outside]))
    side = 1.0 if float(np.median(window[inside])) >= ground else -1.0
    differs = side * (window - ground)
    least = 0.5 * float(np.quantile(differs[inside], _DARKEST_SHARE))
    solid = inside & (differs > least)
    width = solid.sum(axis=1)
    faint = least < _THREAD_LEVELS
    rows = np.flatnonzero(width >= (_FAINT_WIDTH * np.median(width[width > 0]) if faint else _ROW_PIXELS))
    if len(rows) == 0 or least <= 0.0:
        return None
    row = int(rows[-1])
    foot: FloatArray = np.array([float(np.flatnonzero(solid[row]).mean()), float(row)]) + low
    return foot


def _grown(mask: ByteArray, radius: int) -> BoolArray:
    grown = cv2.dilate(mask, np.ones((2 * radius + 1, 2 * radius + 1), np.uint8))
    return np.asarray(grown, dtype=np.uint8).view(np.bool_)
