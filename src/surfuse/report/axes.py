"""Axes of the static drawings: round ticks and an SVG frame with labels and units; u to the right, v up."""

from __future__ import annotations

import math
from dataclasses import dataclass

from surfuse.report.markup import Markup, Value, element


def round_ticks(low: float, high: float, about: int = 5) -> list[float]:
    """Multiples of 1, 2 or 5 times a power of ten within [low, high], about as many as asked."""
    if not (math.isfinite(low) and math.isfinite(high) and high > low):
        return [low] if math.isfinite(low) else []
    rough = (high - low) / max(about, 1)
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= rough * 0.999)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    ticks = [round(n * step, 12) for n in range(first, last + 1)]
    # A coarse step may miss the range altogether; a finer one does not.
    return ticks or round_ticks(low, high, 2 * max(about, 1))


@dataclass(frozen=True)
class AxesFrame:
    """A plotting area of a drawing: data limits, and its place in SVG units (y downwards).

    `x_low` to `x_high` and `y_low` to `y_high` are in the units of the data; `left`, `top`, `width`, `height` are those
    of the area.
    """

    x_low: float
    x_high: float
    y_low: float
    y_high: float
    left: float
    top: float
    width: float
    height: float

    def x(self, value: float) -> float:
        """SVG abscissa of a data abscissa."""
        return self.left + self.width * (value - self.x_low) / (self.x_high - self.x_low)

    def y(self, value: float) -> float:
        """SVG ordinate of a data ordinate: up is up."""
        return self.top + self.height * (self.y_high - value) / (self.y_high - self.y_low)

    def path(self, points: list[tuple[float, float]], closed: bool) -> str:
        """Path data through data points."""
        steps = [f"{'L' if k else 'M'}{self.x(px):.2f} {self.y(py):.2f}" for k, (px, py) in enumerate(points)]
        return "".join(steps) + ("Z" if closed and steps else "")


def _label(x: float, y: float, text: str, anchor: str, kind: str = "tick-label") -> Markup:
    return element("text", {"x": round(x, 2), "y": round(y, 2), "text-anchor": anchor, "class": kind}, text)


def _number(value: float) -> str:
    return f"{value:g}".replace("-", "−")


def frame_axes(frame: AxesFrame, x_title: str, y_title: str, y_ticks: bool = True) -> list[Markup]:
    """Grid lines, tick labels and axis titles of a frame."""
    bottom, parts = frame.top + frame.height, []
    for tick in round_ticks(frame.x_low, frame.x_high, max(2, round(frame.width / 70))):
        x = round(frame.x(tick), 2)
        parts.append(element("line", {"x1": x, "x2": x, "y1": frame.top, "y2": bottom, "class": "grid"}))
        parts.append(_label(x, bottom + 16, _number(tick), "middle"))
    for tick in round_ticks(frame.y_low, frame.y_high, max(2, round(frame.height / 60))) if y_ticks else []:
        y = round(frame.y(tick), 2)
        right = frame.left + frame.width
        parts.append(element("line", {"x1": frame.left, "x2": right, "y1": y, "y2": y, "class": "grid"}))
        parts.append(_label(frame.left - 6, y + 4, _number(tick), "end"))
    parts.append(_label(frame.left + frame.width / 2, bottom + 36, x_title, "middle", "axis-title"))
    middle = frame.top + frame.height / 2
    turn: dict[str, Value] = {
        "transform": f"translate(18 {middle:.1f}) rotate(-90)",
        "text-anchor": "middle",
        "class": "axis-title",
    }
    parts.append(element("text", turn, y_title))
    box: dict[str, Value] = {
        "x": frame.left,
        "y": frame.top,
        "width": frame.width,
        "height": frame.height,
        "class": "frame",
    }
    return [*parts, element("rect", box)]


def drawing(width: float, height: float, title: str, children: list[Markup], kind: str = "chart static") -> Markup:
    """An SVG picture that scales with its column; the title is its alternative text."""
    attributes = {"viewBox": f"0 0 {width:g} {height:g}", "role": "img", "aria-label": title, "class": kind}
    return element("svg", attributes, *children)
