"""Blocks that every page has: head lines, key figures, scores, events, configuration, safety, what this page is."""

from __future__ import annotations

import math

from surfuse.report.content import KeyFigure, PageTable, ReportEvent, ScoreRow
from surfuse.report.markup import Child, Markup, element, join

MM = 1000.0


def section(name: str, title: str, *children: Child, long: bool = False) -> Markup:
    """A titled part of the page that the list of contents can point to."""
    attributes = {"id": name, "aria-labelledby": f"{name}-title", **({"class": "long"} if long else {})}
    return element("section", attributes, element("h2", {"id": f"{name}-title"}, title), *children)


def key(colour: str, text: str, kind: str = "") -> Markup:
    """One entry of a legend: a swatch of a colour and what it stands for."""
    return element("span", {"class": f"swatch {kind}".strip(), "style": f"--key:{colour}"}, text)


def contents(entries: list[tuple[str, str]]) -> Markup:
    """Links to the sections of the page."""
    links: list[Child] = [element("a", {"href": f"#{name}"}, title) for name, title in entries]
    return element("nav", {"aria-label": "Contents"}, *links)


def heading(title: str, facts: list[str], text: str) -> Markup:
    """Title, one line of facts (empty ones are left out) and an introduction."""
    shown: list[Child] = [element("span", None, fact) for fact in facts if fact]
    parts: list[Child] = [element("h1", None, title)]
    if shown:
        parts.append(element("p", {"class": "facts-line"}, *shown))
    return join([*parts, *([element("p", None, text)] if text else [])])


def key_figures(figures: tuple[KeyFigure, ...]) -> Markup:
    """The headline figures as cards."""
    cards: list[Child] = []
    for figure in figures:
        hint = [element("dd", {"class": "hint"}, figure.hint)] if figure.hint else []
        cards.append(element("div", None, element("dt", None, figure.label), element("dd", None, figure.value), *hint))
    return element("dl", {"class": "figures"}, *cards) if cards else Markup("")


def safety_note(text: str) -> Markup:
    """The safety statement, never left out."""
    return element("p", {"class": "safety", "role": "note"}, element("strong", None, "Safety: "), text)


def _cell(value: float, digits: int, best: bool, unit: str = "") -> Markup:
    text = f"{value:.{digits}f}{unit}".replace("-", "−") if math.isfinite(value) else "–"
    return element("td", {"class": "best"} if best else None, text)


def score_table(rows: tuple[ScoreRow, ...]) -> Markup:
    """Methods against truth in millimetres; the best of each column stands out."""
    edges = any(math.isfinite(row.edge_m) for row in rows)
    columns = [
        ("RMSE (mm)", 3, [MM * row.score.rmse_m for row in rows]),
        ("dense RMSE (mm)", 3, [MM * row.dense.rmse_m for row in rows]),
        ("off the edges (mm)", 3, [MM * row.dense.off_edge_rmse_m for row in rows]),
        ("MAE (mm)", 3, [MM * row.score.mae_m for row in rows]),
        ("bias (mm)", 3, [MM * row.score.bias_m for row in rows]),
        ("95 % below (mm)", 3, [MM * row.score.p95_m for row in rows]),
        *([("edge off by (mm)", 1, [MM * row.edge_m for row in rows])] if edges else []),
        ("coverage (%)", 1, [100.0 * row.score.coverage for row in rows]),
    ]
    titles: list[Child] = [element("th", {"scope": "col"}, title) for title, _, _ in columns]
    head = element(
        "tr", None, element("th", {"scope": "col"}, "method"), *titles, element("th", {"scope": "col"}, "cells")
    )
    body: list[Child] = []
    for k, row in enumerate(rows):
        cells: list[Child] = [
            _cell(values[k], digits, len(rows) > 1 and _is_best(title, values, k)) for title, digits, values in columns
        ]
        name = element("th", {"scope": "row"}, row.method)
        body.append(element("tr", None, name, *cells, element("td", None, f"{row.score.cells}")))
    table = element("table", None, element("thead", None, head), element("tbody", None, *body))
    return element("div", {"class": "scroll", "tabindex": 0, "role": "region", "aria-label": "Table of errors"}, table)


def text_table(table: PageTable) -> Markup:
    """A table of texts; the first cell of a row is its head."""
    head = element("tr", None, *(element("th", {"scope": "col"}, one) for one in table.head))
    body: list[Child] = [
        element("tr", None, element("th", {"scope": "row"}, row[0]), *(element("td", None, cell) for cell in row[1:]))
        for row in table.rows
    ]
    drawn = element("table", None, element("thead", None, head), element("tbody", None, *body))
    return element("div", {"class": "scroll", "tabindex": 0, "role": "region", "aria-label": table.title}, drawn)


def _is_best(title: str, values: list[float], k: int) -> bool:
    known = [abs(value) for value in values if math.isfinite(value)]
    if not known or not math.isfinite(values[k]) or min(known) == max(known):
        return False
    return abs(values[k]) == (max(known) if title.startswith("coverage") else min(known))


def event_list(events: tuple[ReportEvent, ...]) -> Markup:
    """Events in the order given, with their time in the run."""
    items: list[Child] = []
    for event in events:
        when = [element("span", {"class": "when"}, f"{event.t_s:.1f} s")] if math.isfinite(event.t_s) else []
        level = [] if event.level == "info" else [element("span", {"class": "level"}, event.level)]
        items.append(element("li", {"class": event.level}, *when, *level, event.text))
    return element("ul", {"class": "events"}, *items)


def configuration(text: str) -> Markup:
    """The whole configuration, folded."""
    summary = element("summary", None, f"Show the configuration ({len(text.splitlines())} lines of TOML)")
    return element("details", None, summary, element("pre", {"tabindex": 0}, element("code", None, text)))


def about(version: str, run_folder: bool) -> Markup:
    """What this page is and how to open the data behind it elsewhere."""
    made_by = f"surfuse {version}".strip()
    lead = element(
        "p",
        None,
        f"This page was written by {made_by}. It is one file: it works offline, loads nothing from outside and can be "
        "sent on as it is. Numbers shown under the cursor are those of the map, rounded for reading.",
    )
    code = {"surface": "surface.nc", "log": "log/", "run": "run.toml"}
    items: list[Child] = [
        _item(code["surface"], "the map with its uncertainty: NetCDF-4, CF conventions; xarray, Panoply, MATLAB."),
        _item(code["log"], "every image, joint state and reading: MCAP with ROS 2 messages; Foxglove, Lichtblick."),
        _item(code["run"], "the whole configuration with seed and versions."),
        _item("surfuse view RUN", "the same scene live in a browser."),
        _item("surfuse export MAP FILE", "other formats, by suffix, for metrology and CAD programs."),
        _item("surfuse why MAP U V", "the readings behind one cell."),
    ]
    return join([lead, *([element("ul", None, *items)] if run_folder else [])])


def _item(name: str, text: str) -> Markup:
    return element("li", None, element("code", None, name), ": ", text)
