"""The outline of a part in millimetres, with a band that shows how uncertain it is."""

from __future__ import annotations

import numpy as np

from surfuse.records import FloatArray, Outline
from surfuse.report.axes import AxesFrame, drawing, frame_axes
from surfuse.report.markup import Markup, element

MM = 1000.0
# Half the width of the band, in standard deviations.
BAND_SIGMAS = 2.0
_ROOM = 0.06


def outline_chart(outline: Outline, label: str) -> Markup:
    """Outline, holes and vertices; around the boundary a band of two standard deviations to either side."""
    corners, reach = MM * outline.vertices_m, BAND_SIGMAS * MM * outline.sigma_m
    frame = _frame(corners, float(reach.max(initial=0.0)))
    pixels_per_mm = frame.width / (frame.x_high - frame.x_low)
    dots = "".join(f"M{frame.x(u):.1f} {frame.y(v):.1f}h0" for u, v in corners.tolist())
    holes = [element("path", {"d": frame.path(_pairs(MM * hole), True), "class": "rim"}) for hole in outline.holes_m]
    layers = [
        *frame_axes(frame, "u (mm)", "v (mm)"),
        element("g", {"class": "unsure"}, *_band(frame, corners, reach, pixels_per_mm)),
        element("path", {"d": frame.path(_pairs(corners), True), "class": "rim"}),
        *holes,
        element("path", {"d": dots, "class": "corners"}),
    ]
    title = f"Outline of {label} in millimetres, with two standard deviations to either side"
    return drawing(frame.left + frame.width + 14, frame.top + frame.height + 46, title, layers)


def _frame(corners_mm: FloatArray, reach_mm: float) -> AxesFrame:
    """A frame with the same scale on both axes, within 450 x 400."""
    low, high = corners_mm.min(axis=0) - reach_mm, corners_mm.max(axis=0) + reach_mm
    pad = _ROOM * max(1.0, float((high - low).max()))
    low, high = low - pad, high + pad
    span = high - low
    scale = min(450.0 / span[0], 400.0 / span[1])
    return AxesFrame(low[0], high[0], low[1], high[1], 60.0, 12.0, float(scale * span[0]), float(scale * span[1]))


def _band(frame: AxesFrame, corners: FloatArray, reach: FloatArray, pixels_per_mm: float) -> list[Markup]:
    """Circles around the vertices, and between neighbours the strip that joins their circles."""
    after, reach_after = np.roll(corners, -1, axis=0), np.roll(reach, -1)
    along = after - corners
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
    across = np.column_stack([-along[:, 1], along[:, 0]]) / length
    near, far = across * reach[:, None], across * reach_after[:, None]
    strips = np.stack([corners - near, after - far, after + far, corners + near], axis=1)
    outlines = "".join(frame.path(_pairs(strip), True) for strip in strips)
    discs = [
        element("circle", {"cx": round(frame.x(u), 1), "cy": round(frame.y(v), 1), "r": round(r * pixels_per_mm, 2)})
        for (u, v), r in zip(corners.tolist(), reach.tolist(), strict=True)
        if r > 0.0
    ]
    return [element("path", {"d": outlines}), *discs] if float(reach.max(initial=0.0)) > 0.0 else []


def _pairs(points: FloatArray) -> list[tuple[float, float]]:
    return [(float(u), float(v)) for u, v in points]
