"""What the guard of a method decided about the regions of its map, as a table in words."""

from __future__ import annotations

import math

from surfuse.records import GuardReason, RegionDecision
from surfuse.records.guard import in_words
from surfuse.report.markup import Child, Markup, element

MM = 1000.0
SHOWN = 24
"""Regions in the table; those that were not simply the best come first."""

REASONS = {
    GuardReason.BEST: "no other surface predicts them clearly better",
    GuardReason.BEATEN: "predicts them clearly better than the method's own",
    GuardReason.FREE_SPACE: "a better one would stand where the readings heard nothing",
    GuardReason.TOO_FEW: "too few readings to judge",
}


def guard_table(decisions: tuple[RegionDecision, ...]) -> Markup:
    """One row a region: where it is, how well each candidate predicts readings that it had not seen, what was taken."""
    ordered = sorted(decisions, key=lambda one: (one.reason is GuardReason.BEST, one.reason is GuardReason.TOO_FEW))
    names = list(dict.fromkeys(name for one in decisions for name in one.candidates))
    heads = ["region", "cells", "held out", *(f"{name}: miss (mm)" for name in names), "taken", "because"]
    titles: list[Child] = [element("th", {"scope": "col"}, head) for head in heads]
    rows: list[Child] = [_row(one, names) for one in ordered[:SHOWN]]
    text = (
        "Part of the readings was held out of the estimate. Each candidate surface predicts their echoes; the miss is "
        "how far off it is on average. "
    )
    left = f" The table shows {SHOWN} of them." if len(decisions) > SHOWN else ""
    head = element("thead", None, element("tr", None, *titles))
    table = element("table", {"class": "small guard"}, head, element("tbody", None, *rows))
    region = "Decisions of the guard"
    scroll = element("div", {"class": "scroll", "tabindex": 0, "role": "region", "aria-label": region}, table)
    intro = element("p", None, f"{text}Taken: {in_words(decisions)}.{left}")
    return element("div", None, element("h3", None, "How the surface was chosen"), intro, scroll)


def _row(one: RegionDecision, names: list[str]) -> Markup:
    place = f"u {_span(one.low_uv_m[0], one.high_uv_m[0])}, v {_span(one.low_uv_m[1], one.high_uv_m[1])} mm"
    misses = dict(zip(one.candidates, one.miss_m, strict=True))
    cells = [str(one.cells), str(one.held_out)]
    cells += [_miss(misses.get(name, math.nan)) for name in names]
    data: list[Child] = [
        element("td", {"class": "best"} if name == one.chosen else None, cell)
        for name, cell in zip(["", "", *names], cells, strict=True)
    ]
    data += [element("td", None, one.chosen), element("td", None, REASONS[one.reason])]
    return element("tr", None, element("th", {"scope": "row"}, place), *data)


def _span(low_m: float, high_m: float) -> str:
    return f"{MM * low_m:.0f} to {MM * high_m:.0f}".replace("-", "−")


def _miss(value_m: float) -> str:
    return f"{MM * value_m:.2f}" if math.isfinite(value_m) else "–"
