"""The scan plan over the outline: margin, path, stops, and the stops that were left out."""

from __future__ import annotations

from collections import Counter

import numpy as np

from surfuse.records import FloatArray
from surfuse.report.axes import AxesFrame, drawing, frame_axes
from surfuse.report.content import PlanView
from surfuse.report.markup import Markup, Value, element

MM = 1000.0
# Above this number the dots of the stops merge into a grey; only the path is drawn then.
MOST_DOTS = 3000
MOST_CROSSES = 1000


def _extent(plan: PlanView) -> tuple[FloatArray, FloatArray]:
    left_out = np.array([[stop.u_m, stop.v_m] for stop in plan.skipped]).reshape(-1, 2)
    everything = MM * np.concatenate([plan.outline_m, plan.enlarged_m, plan.stops_m, left_out])
    finite = everything[np.all(np.isfinite(everything), axis=1)]
    if not len(finite):
        return np.zeros(2), np.ones(2)
    low, high = finite.min(axis=0), finite.max(axis=0)
    pad = 0.06 * max(1.0, float((high - low).max()))
    return low - pad, high + pad


def _frame(plan: PlanView) -> AxesFrame:
    """A frame with the same scale on both axes, within 620 x 480."""
    low, high = _extent(plan)
    span = high - low
    scale = min(620.0 / span[0], 480.0 / span[1])
    return AxesFrame(low[0], high[0], low[1], high[1], 66.0, 12.0, float(scale * span[0]), float(scale * span[1]))


def _curve(frame: AxesFrame, points_m: FloatArray, kind: str, closed: bool) -> list[Markup]:
    points = [(float(u), float(v)) for u, v in MM * points_m if np.isfinite(u) and np.isfinite(v)]
    return [element("path", {"d": frame.path(points, closed), "class": kind})] if points else []


def _dots(frame: AxesFrame, plan: PlanView) -> list[Markup]:
    if not 0 < len(plan.stops_m) <= MOST_DOTS:
        return []
    # A path of zero-length round-capped strokes draws all dots with one element.
    dots = "".join(f"M{frame.x(u):.1f} {frame.y(v):.1f}h0" for u, v in (MM * plan.stops_m).tolist())
    u, v = (MM * plan.stops_m[0]).tolist()
    first: dict[str, Value] = {"cx": round(frame.x(u), 2), "cy": round(frame.y(v), 2), "r": 5, "class": "first-stop"}
    return [element("path", {"d": dots, "class": "stops"}), element("circle", first)]


def _crosses(frame: AxesFrame, plan: PlanView) -> list[Markup]:
    layers = []
    for stop in plan.skipped[:MOST_CROSSES]:
        x, y = frame.x(MM * stop.u_m), frame.y(MM * stop.v_m)
        d = f"M{x - 4:.1f} {y - 4:.1f}l8 8m0 -8l-8 8"
        layers.append(element("path", {"d": d, "class": "skipped"}, element("title", None, stop.reason)))
    return layers


def plan_chart(plan: PlanView) -> Markup:
    """Outline, enlarged outline, path and stops in millimetres."""
    frame = _frame(plan)
    layers = [
        *frame_axes(frame, "u (mm)", "v (mm)"),
        *_curve(frame, plan.enlarged_m, "enlarged", True),
        *_curve(frame, plan.outline_m, "outline", True),
        *_curve(frame, plan.stops_m, "route", False),
        *_dots(frame, plan),
        *_crosses(frame, plan),
    ]
    title = f"Scan plan: {len(plan.stops_m)} stops over the outline, {len(plan.skipped)} left out"
    return drawing(frame.left + frame.width + 14, frame.top + frame.height + 46, title, layers)


def skipped_reasons(plan: PlanView) -> list[tuple[str, int]]:
    """How many stops were left out for each reason, most frequent first."""
    return Counter(stop.reason for stop in plan.skipped).most_common()
