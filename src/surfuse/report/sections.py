"""Sections of the report of one run; each is left out when its content is missing."""

from __future__ import annotations

import math

from surfuse.records import Gap, Gate
from surfuse.report.blocks import key, section
from surfuse.report.content import PlanView, ReportContent
from surfuse.report.map_data import GAP_LABELS, GATE_LABELS
from surfuse.report.markup import Attributes, Child, Markup, Value, element
from surfuse.report.plan_drawing import plan_chart, skipped_reasons
from surfuse.report.scan_counts import count_scan

MM = 1000.0


def _select(role: str, text: str) -> Markup:
    return element("label", None, text, element("select", {"data-role": role}))


def _slider(role: str, text: str, output: str, limits: Attributes | None = None) -> Markup:
    shown = element("span", None, text, " ", element("output", {"data-role": output}))
    return element("label", None, shown, element("input", {"type": "range", "data-role": role, **(limits or {})}))


def _relief_view(title: str) -> Markup:
    canvas: dict[str, Value] = {"data-role": "relief", "tabindex": 0, "role": "img", "aria-label": title}
    controls = element(
        "div", {"class": "controls"}, _select("relief-map", "Surface"), _select("relief-colour", "Coloured by")
    )
    return element(
        "figure",
        {"data-role": "view"},
        controls,
        element("canvas", canvas),
        element("figcaption", {"data-role": "relief-caption"}),
    )


def relief_section() -> Markup:
    """The surface in 3-D, two side by side: fused, spline, truth or another method, by height, error or sigma."""
    wire = element("input", {"type": "checkbox", "data-role": "wire"})
    controls = element(
        "div",
        {"class": "controls"},
        _slider("stretch", "Stretch w", "stretch-value", {"min": 0, "max": 2, "step": 0.05, "value": 0}),
        element("label", {"class": "check"}, wire, "truth as lines"),
    )
    views = element(
        "div", {"class": "two"}, *(_relief_view(f"Surface in 3-D, {side} view") for side in ("left", "right"))
    )
    text = "Seen from the sensors: u to the right, v up, w towards the reader. Both views turn together."
    caption = "Drag or use the arrow keys to turn; + and −, two fingers, or Ctrl with the wheel to zoom."
    hint = element("p", {"class": "facts-line screen-only"}, caption)
    body = element("div", {"data-relief": 0}, controls, views, hint)
    return section("surface", "The surface", element("p", None, text), body)


def explorer_section(has_stops: bool) -> Markup:
    """Heat maps with read-out, and profile cuts through the place under the cursor."""
    facts = (
        "its height, its uncertainty, and why the nearest stop has its value" if has_stops else "height and uncertainty"
    )
    intro = element(
        "p",
        None,
        f"Point at a place to read {facts}. A click holds the cursor, a second one frees it; "
        "arrow keys move it by one cell. Places without a value stay empty.",
    )
    return section(
        "maps", "Maps and cuts", intro, element("div", {"data-explorer": 0}, *_heat_map(), *_cuts()), long=True
    )


def _heat_map() -> tuple[Markup, ...]:
    """What chooses a map and a layer, the canvas, and the values under the cursor."""
    canvas: dict[str, Value] = {
        "data-role": "heat",
        "tabindex": 0,
        "role": "img",
        "aria-label": "Heat map; arrow keys move the cursor",
    }
    controls = element(
        "div",
        {"class": "controls"},
        _select("map", "Map"),
        _select("layer", "Show"),
        element("label", {"hidden": True}, "Sensor", element("select", {"data-role": "sensor"})),
    )
    heat = element("figure", None, element("canvas", canvas), element("figcaption", {"data-role": "caption"}))
    readout = element("div", {"class": "readout", "data-role": "readout", "aria-label": "Values under the cursor"})
    return controls, element("div", {"class": "explorer-grid"}, heat, readout)


def _cuts() -> tuple[Markup, ...]:
    """The profile cuts along u and along v, and what moves them."""
    return (
        element("h3", None, "Profile cuts through the cursor"),
        element("p", None, "The band is the chosen map plus and minus two standard deviations."),
        element(
            "div",
            {"class": "controls"},
            _slider("slide-v", "Cut at v =", "at-v"),
            _slider("slide-u", "Cut at u =", "at-u"),
        ),
        element("div", {"class": "legend", "data-role": "legend"}),
        element("div", {"class": "two"}, *(_cut_figure(along) for along in ("u", "v"))),
    )


def _cut_figure(along: str) -> Markup:
    return element("figure", None, element("div", {"data-role": f"cut-{along}"}))


def replay_section() -> Markup:
    """The recorded scan in 3-D, started by the reader."""
    text = (
        "The array moves from stop to stop; beams that took part, beams that were kept out and the fused points appear "
        "as they did in the scan. The button at the lower right of the player lists the parts of the scene: "
        "the eye beside a name shows or hides it. Drag to turn, right-drag to move, wheel to zoom."
    )
    legend = element(
        "div",
        {"class": "legend"},
        key("#009e73", "beam that took part"),
        key("#d55e00", "kept out, or no echo"),
        key("#e69f00", "fused point", "round"),
    )
    button = element("button", {"type": "button", "data-role": "play"}, "▶ Start the 3-D replay")
    poster = element("canvas", {"data-role": "poster", "aria-hidden": "true"})
    stage = element("div", {"class": "stage", "data-role": "stage"}, poster, button)
    body = element("div", {"class": "replay", "data-replay": 0}, legend, stage)
    return section("replay", "Replay of the scan", element("p", None, text), body)


def plan_section(plan: PlanView) -> Markup:
    """The stops over the outline, and what was left out."""
    facts = [f"{len(plan.stops_m)} stops"]
    if math.isfinite(plan.step_m):
        facts.append(f"step {MM * plan.step_m:g} mm")
    if math.isfinite(plan.margin_m) and not plan.margin_text:
        facts.append(f"margin {MM * plan.margin_m:g} mm")
    facts.append(f"{len(plan.skipped)} left out" if plan.skipped else "none left out")
    margin = f" Margin: {plan.margin_text}." if plan.margin_text else ""
    keys: list[Child] = [key("var(--accent)", "outline")]
    if len(plan.enlarged_m):
        keys.append(key("var(--ink-soft)", "outline with margin", "dashed"))
    keys += [key("#0072b2", "stops", "round"), key("#e69f00", "first stop", "round")]
    if plan.skipped:
        keys.append(key("#d55e00", "left out"))
    columns: list[Child] = [element("figure", None, plan_chart(plan))]
    if plan.skipped:
        rows: list[Child] = [
            element("tr", None, element("th", {"scope": "row"}, reason), element("td", None, str(count)))
            for reason, count in skipped_reasons(plan)
        ]
        head = element("tr", None, *(element("th", {"scope": "col"}, text) for text in ("why left out", "stops")))
        columns.append(element("table", None, element("thead", None, head), element("tbody", None, *rows)))
    text, legend = element("p", None, ", ".join(facts) + "." + margin), element("div", {"class": "legend"}, *keys)
    return section("plan", "Plan", text, legend, element("div", {"class": "parts plan"}, *columns))


def _count_cell(count: int, total: int) -> Markup:
    share = count / total if total else 0.0
    text = f"{count}" if count == 0 else f"{count} ({100.0 * share:.1f} %)"
    return element("td", {"class": "tint" if count else "zero", "style": f"--share:{share:.3f}"}, text)


def counts_section(content: ReportContent) -> Markup:
    """Gaps, restarts, and the readings that were kept out, by sensor and reason."""
    assert content.points is not None
    names = [spec.name for spec in content.readings.specs] if content.readings else []
    counts = count_scan(content.points, len(names))
    names += [f"sensor {k}" for k in range(len(names), len(counts.gates))]
    without = counts.stops - int(counts.gaps[Gap.NONE])
    reasons = [f"{GAP_LABELS[gap]}: {counts.gaps[gap]}" for gap in Gap if gap is not Gap.NONE and counts.gaps[gap]]
    gaps = f"{without} of {counts.stops} stops have no value" + (f" ({'; '.join(reasons)})" if reasons else "")
    text = f"{gaps}. The prediction started afresh {counts.resets} times."
    used = [gate for gate in Gate if gate is Gate.PASSED or counts.gates[:, gate].any()]
    titles: list[Child] = [element("th", {"scope": "col"}, GATE_LABELS[gate]) for gate in used]
    rows: list[Child] = []
    for name, row in zip(names, counts.gates, strict=True):
        total = int(row.sum())
        cells: list[Child] = [element("td", None, f"{total}"), element("td", None, f"{row[Gate.PASSED]}")]
        cells += [_count_cell(int(row[gate]), total) for gate in used[1:]]
        rows.append(element("tr", None, element("th", {"scope": "row"}, name), *cells))
    corner = [element("th", {"scope": "col"}, title) for title in ("sensor", "readings")]
    table = element(
        "table", None, element("thead", None, element("tr", None, *corner, *titles)), element("tbody", None, *rows)
    )
    scroll = element("div", {"class": "scroll", "tabindex": 0, "role": "region", "aria-label": "Readings"}, table)
    return section("gaps", "Gaps and readings kept out", element("p", None, text), scroll)


def thinning_note(strides: list[tuple[str, int]]) -> Markup:
    """Says which data were thinned for the page."""
    thinned = [f"one in {stride} nodes of {name} along each axis" for name, stride in strides if stride > 1]
    if not thinned:
        return Markup("")
    text = "To keep this page small it holds " + ", ".join(thinned) + "; surface.nc has all of them."
    return element("p", {"class": "facts-line"}, text)
