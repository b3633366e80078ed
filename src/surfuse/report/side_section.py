"""The section that shows the run's method beside another one: layers in the same colours, cuts, kinds of evidence."""

from __future__ import annotations

import json

import numpy as np

from surfuse.records import FloatArray, Regime, SurfaceMap
from surfuse.report.blocks import section
from surfuse.report.content import NamedMap, ReportContent
from surfuse.report.deviation import deviation
from surfuse.report.guard_table import guard_table
from surfuse.report.map_data import MM, REGIME_COLOURS, REGIME_LABELS, REGIME_MEANINGS
from surfuse.report.markup import Child, Markup, element

_TITLES = ("kind of evidence", "cells", "share", "median σ (mm)", "RMSE (mm)")


def side_title(content: ReportContent) -> str:
    """What the section is called."""
    own = content.maps[0].label
    return f"{own} beside {content.rival.label}" if content.rival is not None else f"{own} in detail"


def side_section(content: ReportContent) -> Markup:
    """Height, error, sigma, evidence and second surface of both methods, cuts through both, evidence in words."""
    pair = [0] if content.rival is None else [0, len(content.maps)]
    text = "The same readings, the same colours: what is brighter or darker in one picture is so in the other. "
    what = text if content.rival is not None else ""
    cursor = "Point at a map or move the sliders: all maps and both cuts follow."
    truth = content.truth.surface if content.truth is not None else None
    maps = (content.maps[0], *((content.rival,) if content.rival is not None else ()))
    body = element(
        "div",
        {"data-side-by-side": 0, "data-pair": json.dumps(pair)},
        element("div", {"class": "controls"}, _check("own-scale", "errors of each method on their own scale")),
        element("div", {"data-role": "rows"}),
        _cuts(),
    )
    tables: list[Child] = [element("h3", None, "What the cells rest on")]
    tables += [_evidence(named, truth) for named in maps]
    tables += [guard_table(named.surface.decisions) for named in maps if named.surface.decisions]
    return section("methods", side_title(content), element("p", None, what + cursor), body, *tables, long=True)


def _check(role: str, text: str) -> Markup:
    box = element("input", {"type": "checkbox", "data-role": role})
    return element("label", {"class": "check"}, box, text)


def _slider(axis: str) -> Markup:
    shown = element("span", None, f"Cut at {axis} = ", element("output", {"data-role": f"side-at-{axis}"}))
    return element("label", None, shown, element("input", {"type": "range", "data-role": f"side-slide-{axis}"}))


def _cuts() -> Markup:
    choice = element("label", None, "Cuts show", element("select", {"data-role": "cut-of"}))
    note = (
        "Bands are plus and minus two standard deviations. Dotted: only the prior speaks. "
        "Rings: a second surface competes there; the fuller, the more probable."
    )
    charts = element(
        "div",
        {"class": "two"},
        *(element("figure", None, element("div", {"data-role": f"side-cut-{axis}"})) for axis in ("u", "v")),
    )
    return element(
        "div",
        None,
        element("h3", None, "Profile cuts through both"),
        element("p", None, note),
        element("div", {"class": "controls"}, choice, _slider("v"), _slider("u")),
        element("div", {"class": "legend", "data-role": "side-legend"}),
        charts,
    )


def _evidence(named: NamedMap, truth: SurfaceMap | None) -> Markup:
    """One table a method: how many cells rest on what, how sure they are and how wrong, and what the words mean."""
    surface = named.surface
    error = deviation(surface, truth) if truth is not None else None
    total = int(surface.mask.sum())
    heads = _TITLES if error is not None else _TITLES[:-1]
    titles: list[Child] = [element("th", {"scope": "col"}, title) for title in heads]
    rows: list[Child] = []
    for regime in Regime:
        cells = surface.mask & (surface.regime == int(regime))
        number = int(cells.sum())
        if number:
            figures = [
                str(number),
                f"{100.0 * number / total:.1f} %",
                f"{MM * float(np.median(surface.sigma_m[cells])):.3f}",
            ]
            figures += [_rmse(error[cells])] if error is not None else []
            data = [element("td", None, text) for text in figures]
            rows.append(element("tr", None, _name(regime), *data))
    caption = element("caption", None, f"{named.label}: {total} cells with a value")
    table = element(
        "table",
        {"class": "evidence"},
        caption,
        element("thead", None, element("tr", None, *titles)),
        element("tbody", None, *rows),
    )
    region = f"Kinds of evidence, {named.label}"
    return element("div", {"class": "scroll", "tabindex": 0, "role": "region", "aria-label": region}, table)


def _name(regime: Regime) -> Markup:
    kind = "patch hatched" if regime is Regime.PRIOR else "patch"
    label = element("span", {"class": kind, "style": f"--key:#{REGIME_COLOURS[regime]}"}, REGIME_LABELS[regime])
    return element("th", {"scope": "row"}, label, element("span", {"class": "meaning"}, REGIME_MEANINGS[regime]))


def _rmse(error_m: FloatArray) -> str:
    known = error_m[np.isfinite(error_m)]
    return f"{MM * float(np.sqrt(np.mean(known**2))):.2f}" if len(known) else "–"
