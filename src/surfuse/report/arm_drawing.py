"""An arm from the side, as balls that cover its shape: how it stands, at stops, and where it would touch something."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from surfuse.records import BoolArray, FloatArray
from surfuse.report.axes import AxesFrame, drawing, frame_axes
from surfuse.report.markup import Markup, element

MM = 1000.0
STYLE = (
    ".posture path { fill: none; stroke: var(--ink-soft); stroke-width: 1.5; }"
    ".now { fill: var(--ink-soft); opacity: .25; } .stop { fill: #0072b2; opacity: .35; }"
    ".touching { fill: #d55e00; fill-opacity: .3; }"
    ".touching .contact { fill-opacity: .85; stroke: var(--ink); stroke-width: 1.5; }"
    ".solid { fill: var(--accent-soft); stroke: var(--accent); stroke-width: 1.4; }"
    ".ground { fill: var(--ink-soft); opacity: .18; }"
)
"""Besides the style of all pages."""

_PAD = 0.06
_FRAME = (66.0, 12.0, 560.0, 420.0)  # left, top, and the room for width and height


@dataclass(frozen=True)
class Posture:
    """An arm at one place: balls `center_m` (B, 3) with `radius_m` (B,), link origins (L, 3), in the part frame.

    `at` (B,) are the balls of the part that touches something.
    """

    words: str
    kind: Literal["now", "stop", "touching"]
    center_m: FloatArray
    radius_m: FloatArray
    links_m: FloatArray
    at: BoolArray


@dataclass(frozen=True)
class ArmView:
    """Postures of an arm, the box of the part (2, 3), the height of the table (None: none), the stops (N, 3)."""

    postures: tuple[Posture, ...]
    part_m: FloatArray
    table_m: float | None
    stops_m: FloatArray


def arm_chart(view: ArmView, across: Literal[0, 1]) -> Markup:
    """The arm seen along v (`across` 0: u to the right) or along u (1: v to the right), w up, in mm."""
    frame = _frame(view, across)
    name = "uv"[across]
    layers = [*frame_axes(frame, f"{name} (mm)", "w (mm)")]
    bottom = frame.top + frame.height
    if view.table_m is not None:
        y = frame.y(MM * view.table_m)
        ground = {"x": frame.left, "y": round(y, 1), "width": frame.width, "height": round(max(bottom - y, 0.0), 1)}
        layers.append(element("rect", {**ground, "class": "ground"}))
    (low, _, bottom_m), (high, _, top_m) = view.part_m[:, [across, across, 2]].tolist()
    corners = [(MM * a, MM * b) for a, b in ((low, bottom_m), (high, bottom_m), (high, top_m), (low, top_m))]
    layers.append(element("path", {"d": frame.path(corners, True), "class": "solid"}))
    layers += [_posture(frame, posture, across) for posture in view.postures]
    dots = "".join(f"M{frame.x(MM * stop[across]):.1f} {frame.y(MM * stop[2]):.1f}h0" for stop in view.stops_m)
    layers.append(element("path", {"d": dots, "class": "stops"}))
    title = f"The arm from the side, {name} to the right"
    return drawing(frame.left + frame.width + 14, bottom + 46, title, layers)


def _posture(frame: AxesFrame, posture: Posture, across: int) -> Markup:
    scale = frame.width / (frame.x_high - frame.x_low)
    balls = [
        element(
            "circle",
            {
                "cx": round(frame.x(MM * center[across]), 1),
                "cy": round(frame.y(MM * center[2]), 1),
                "r": round(scale * MM * radius, 1),
                **({"class": "contact"} if at else {}),
            },
        )
        for center, radius, at in zip(
            posture.center_m.tolist(), posture.radius_m.tolist(), posture.at.tolist(), strict=True
        )
    ]
    line = frame.path([(MM * link[across], MM * link[2]) for link in posture.links_m.tolist()], False)
    group = element("g", {"class": posture.kind}, element("title", None, posture.words), *balls)
    return element("g", {"class": "posture"}, group, element("path", {"d": line}))


def _frame(view: ArmView, across: int) -> AxesFrame:
    """A frame with the same scale on both axes around all that is drawn."""
    columns = [across, 2]
    reach = [view.part_m[:, columns], view.stops_m[:, columns]]
    for posture in view.postures:
        reach.append(posture.links_m[:, columns])
        reach += [posture.center_m[:, columns] + side * posture.radius_m[:, None] for side in (-1.0, 1.0)]
    everything = MM * np.concatenate(reach)
    low, high = everything.min(axis=0), everything.max(axis=0)
    pad = _PAD * max(1.0, float((high - low).max()))
    low, high = low - pad, high + pad
    left, top, width, height = _FRAME
    scale = float(min(width / (high[0] - low[0]), height / (high[1] - low[1])))
    size = scale * (high - low)
    (x_low, y_low), (x_high, y_high) = low.tolist(), high.tolist()
    return AxesFrame(x_low, x_high, y_low, y_high, left, top, float(size[0]), float(size[1]))
