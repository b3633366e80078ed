"""Line charts as SVG, on a page of their own or together in one picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from surfuse.report.axes import AxesFrame, drawing, frame_axes
from surfuse.report.colours import CATEGORIES
from surfuse.report.markup import Child, Markup, Value, element, join
from surfuse.report.skeleton import stylesheet

WIDTH, HEIGHT = 520.0, 330.0
_LEFT, _TOP, _RIGHT, _BOTTOM = 66.0, 52.0, 14.0, 48.0
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
_PICTURE_STYLE = (
    "text{fill:#526172;font:12px sans-serif}.axis-title{font-size:13px}.chart-title{font-size:15px;font-weight:bold;"
    "fill:#16202b}.grid{stroke:#e8ecf0}.frame{fill:none;stroke:#d5dbe2}.curve{fill:none;stroke-width:1.8}"
)


@dataclass(frozen=True)
class Series:
    """One line: its name and its points (x, y); a y that is not finite interrupts it."""

    name: str
    points: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Chart:
    """A chart: titles with units, lines, and the least limits of its y axis.

    `y_limits` are widened where a line goes beyond them; `x_title` and `y_title` carry the units.
    """

    title: str
    x_title: str
    y_title: str
    series: tuple[Series, ...]
    y_limits: tuple[float, float] = (math.inf, -math.inf)


def chart_svg(chart: Chart) -> Markup:
    """The chart as one SVG element of `WIDTH` x `HEIGHT`."""
    frame = _frame(chart)
    parts = frame_axes(frame, chart.x_title, chart.y_title)
    parts.append(element("text", {"x": _LEFT, "y": 20, "class": "chart-title mark-label"}, chart.title))
    left = _LEFT
    for number, series in enumerate(chart.series):
        colour = f"#{CATEGORIES[number % len(CATEGORIES)]}"
        line: dict[str, Value] = {"x1": left, "x2": left + 18, "y1": 37, "y2": 37, "stroke": colour, "stroke-width": 3}
        parts += [element("line", line), element("text", {"x": left + 23, "y": 41}, series.name)]
        left += 44.0 + 6.6 * len(series.name)
        parts += [
            element("path", {"d": frame.path(piece, False), "class": "curve", "stroke": colour})
            for piece in _pieces(series)
        ]
    return drawing(WIDTH, HEIGHT, chart.title, parts)


def picture(charts: Sequence[Chart], title: str, columns: int = 2) -> str:
    """All charts in one SVG file."""
    rows = -(-len(charts) // columns)
    width, height = columns * WIDTH, rows * HEIGHT + 40.0
    placed: list[Markup] = [
        element("style", None, Markup(_PICTURE_STYLE)),
        element("rect", {"width": width, "height": height, "fill": "#ffffff"}),
        element("text", {"x": 20, "y": 28, "class": "chart-title"}, title),
    ]
    for number, chart in enumerate(charts):
        row, column = divmod(number, columns)
        shift = {"transform": f"translate({column * WIDTH:g} {row * HEIGHT + 40.0:g})"}
        placed.append(element("g", shift, element("svg", {"width": WIDTH, "height": HEIGHT}, chart_svg(chart))))
    size = {"xmlns": "http://www.w3.org/2000/svg", "viewBox": f"0 0 {width:g} {height:g}", "role": "img"}
    return str(element("svg", {**size, "aria-label": title}, *placed)) + "\n"


def page(
    title: str, text: str, heads: Sequence[str], rows: Sequence[Sequence[str]], charts: Sequence[Chart], note: str
) -> str:
    """A self-contained HTML page without scripts: a table, then the charts."""
    cells = [
        element("tr", None, element("th", None, row[0]), *(element("td", None, cell) for cell in row[1:]))
        for row in rows
    ]
    table = element(
        "table",
        None,
        element("thead", None, element("tr", None, *(element("th", None, head) for head in heads))),
        element("tbody", None, *cells),
    )
    figures = [element("figure", None, chart_svg(chart)) for chart in charts]
    body: list[Child] = [
        element("header", {"class": "top"}, element("h1", None, title), element("p", None, text)),
        element(
            "main",
            None,
            element("section", None, element("div", {"class": "scroll"}, table)),
            element("section", None, element("div", {"class": "two"}, *figures)) if figures else Markup(""),
        ),
        element("footer", None, note),
    ]
    head = element(
        "head",
        None,
        element("meta", {"charset": "utf-8"}),
        element("meta", {"http-equiv": "Content-Security-Policy", "content": _POLICY}),
        element("meta", {"name": "viewport", "content": "width=device-width, initial-scale=1"}),
        element("title", None, title),
        Markup(f"<style>{stylesheet()}</style>"),
    )
    html = element("html", {"lang": "en"}, head, element("body", None, *body))
    return str(join([Markup("<!doctype html>\n"), html, Markup("\n")]))


def _pieces(series: Series) -> list[list[tuple[float, float]]]:
    """The line cut where its value is not finite."""
    pieces: list[list[tuple[float, float]]] = [[]]
    for x, y in series.points:
        if math.isfinite(x) and math.isfinite(y):
            pieces[-1].append((x, y))
        elif pieces[-1]:
            pieces.append([])
    return [piece for piece in pieces if piece]


def _frame(chart: Chart) -> AxesFrame:
    points = [point for series in chart.series for piece in _pieces(series) for point in piece]
    across = [x for x, _ in points] or [0.0, 1.0]
    up = [y for _, y in points] + [limit for limit in chart.y_limits if math.isfinite(limit)] or [0.0, 1.0]
    x_low, x_high = _spread(min(across), max(across), 0.0)
    y_low, y_high = _spread(min(up), max(up), 0.06)
    size = WIDTH - _LEFT - _RIGHT, HEIGHT - _TOP - _BOTTOM
    return AxesFrame(x_low, x_high, y_low, y_high, _LEFT, _TOP, *size)


def _spread(low: float, high: float, pad: float) -> tuple[float, float]:
    """Limits with some room, never empty."""
    room = pad * (high - low) if high > low else max(0.5 * abs(low), 0.5)
    return low - room, high + room
