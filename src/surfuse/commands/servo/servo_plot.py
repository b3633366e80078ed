"""The plot of the servo study: tool error of every law over one smooth pass, on a logarithmic scale."""

from __future__ import annotations

import numpy as np

from surfuse.records import FloatArray
from surfuse.report.axes import AxesFrame, drawing, frame_axes
from surfuse.report.colours import CATEGORIES
from surfuse.report.markup import Markup, Value, element

_STYLE = (
    "text{font:12px sans-serif;fill:#333}.grid{stroke:#ddd}.frame{fill:none;stroke:#666}"
    "path{fill:none;stroke-width:1.3}.axis-title{font-size:13px}"
)
_POINTS = 600
_FLOOR_MM = 1e-3


def study_drawing(series: list[tuple[str, FloatArray, FloatArray]]) -> str:
    """An SVG file: for every law its name, times (T,) in s and tool errors (T,) in mm."""
    end = max(float(t[-1]) for _, t, _ in series)
    logs = [np.log10(np.maximum(error, _FLOOR_MM)) for _, _, error in series]
    low, high = min(float(np.floor(log.min())) for log in logs), max(float(np.ceil(log.max())) for log in logs)
    frame = AxesFrame(0.0, end, low, high, 70.0, 20.0, 620.0, 320.0)
    parts = [element("style", {}, Markup(_STYLE)), *frame_axes(frame, "time, s", "tool error, mm", y_ticks=False)]
    for power in range(int(low), int(high) + 1):
        y = round(frame.y(power), 2)
        parts.append(element("line", {"x1": 70, "x2": 690, "y1": y, "y2": y, "class": "grid"}))
        parts.append(element("text", {"x": 62, "y": y + 4, "text-anchor": "end"}, f"{10.0**power:g}"))
    for k, ((name, t, _), log) in enumerate(zip(series, logs, strict=True)):
        colour = f"#{CATEGORIES[k % len(CATEGORIES)]}"
        parts.append(element("path", {"d": frame.path(_thinned(t, log), closed=False), "stroke": colour}))
        label: dict[str, Value] = {"x": 80 + 150 * k, "y": 400, "style": f"fill:{colour}"}
        parts.append(element("text", label, name))
    picture = drawing(720, 410, "Tool error over one smooth pass", parts)
    return str(picture).replace("<svg", '<svg xmlns="http://www.w3.org/2000/svg"', 1) + "\n"


def _thinned(t: FloatArray, log: FloatArray) -> list[tuple[float, float]]:
    """At most some hundred points that keep every peak: the largest value of each stretch."""
    pieces = np.array_split(np.arange(len(t)), min(_POINTS, len(t)))
    kept = [int(piece[np.argmax(log[piece])]) for piece in pieces]
    return [(float(t[i]), float(log[i])) for i in kept]
