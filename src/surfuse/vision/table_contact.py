"""Which boundary points stand on the table."""

from __future__ import annotations

import numpy as np

from surfuse.records import CameraModel, FloatArray, IntArray

_BAND_PX = 1.5
_POINTS_MIN = 3
_SLOPE_MAX = 0.36
_WIDTH_SHARE_MIN = 0.3


def foot_points(camera: CameraModel, contour_px: FloatArray, vertices: IntArray) -> IntArray:
    """Indices of the contour points (N, 2) that touch the table, given the dominant points `vertices` (K,).

    A long, nearly level edge at the lowest dominant point is the foot of a flat part, seen slanted when the part is
    turned; else the foot is whatever lies within 1.5 pixels of the lowest point.
    """
    edge = _level_edge(camera, contour_px, np.sort(vertices))
    return edge if edge is not None else _lowest(contour_px)


def cut_below(camera: CameraModel, contour_px: FloatArray) -> bool:
    """Whether the picture's lower border may hide the foot.

    `contour_px` (N, 2) are x, y in pixels, y downwards.
    """
    return bool(contour_px[:, 1].max() >= camera.height_px - 2)


def _lowest(contour_px: FloatArray) -> IntArray:
    row = contour_px[:, 1]
    near = np.flatnonzero(row >= row.max() - _BAND_PX)
    return near if len(near) >= _POINTS_MIN else np.argsort(row)[-_POINTS_MIN:]


def _level_edge(camera: CameraModel, contour_px: FloatArray, vertices: IntArray) -> IntArray | None:
    """Contour points inside the polygon's edge at its lowest vertex, if that edge is long and nearly level."""
    corners = contour_px[vertices]
    lowest = int(np.argmax(corners[:, 1]))
    width = float(np.ptp(contour_px[:, 0]))
    best: tuple[float, int, int] | None = None
    for a, b in ((lowest - 1, lowest), (lowest, (lowest + 1) % len(vertices))):
        along, down = (corners[b] - corners[a]) / [camera.fx_px, camera.fy_px]
        length = abs(along) * camera.fx_px
        level = abs(down) <= _SLOPE_MAX * abs(along) and length >= _WIDTH_SHARE_MIN * width
        if level and (best is None or length > best[0]):
            best = (length, int(vertices[a]), int(vertices[b]))
    if best is None:
        return None
    _, first, last = best
    n = len(contour_px)
    run = np.arange(first, last + (n if last <= first else 0) + 1) % n
    # The corners themselves are rounded by blur.
    inner = run[2:-2]
    return inner if len(inner) >= _POINTS_MIN else None
