"""The section that shows, for every part found, what the camera saw and what was made of it."""

from __future__ import annotations

from surfuse.report.blocks import key, section
from surfuse.report.content import FoundPartView
from surfuse.report.markup import Child, Markup, element
from surfuse.report.outline_drawing import BAND_SIGMAS, MM, outline_chart
from surfuse.report.search_drawing import histogram_chart, search_image


def search_section(parts: tuple[FoundPartView, ...], longest_px: int) -> Markup:
    """One block a part: picture with contour and dominant points, histogram with thresholds, outline in metres."""
    keys = [
        key("#56b4e9", "contour"),
        key("#e69f00", "dominant points", "round"),
        key("#d55e00", "threshold that found it"),
        key("#0072b2", "thresholds of the whole picture", "dashed"),
    ]
    if any(part.outline is not None for part in parts):
        keys.append(key("var(--accent)", f"outline, with a band of {BAND_SIGMAS:g} standard deviations to either side"))
    noun = "The part" if len(parts) == 1 else f"The {len(parts)} parts, in order of angle or view,"
    text = f"{noun} in the image of the camera: threshold, contour, dominant points, and the outline in metres."
    legend = element("div", {"class": "legend"}, *keys)
    blocks = [_block(part, longest_px, len(parts) > 1) for part in parts]
    return section("search", "Search", element("p", None, text), legend, *blocks)


def _block(part: FoundPartView, longest_px: int, named: bool) -> Markup:
    facts = [
        f"{part.image.shape[1]} × {part.image.shape[0]} pixels",
        f"{len(part.dominant_px)} dominant points",
        *part.facts,
    ]
    caption = element("figcaption", None, f"{part.label}: {', '.join(facts)}")
    left: list[Child] = [element("figure", None, search_image(part, longest_px), caption)]
    right: list[Child] = []
    if part.outline is not None:
        right.append(element("figure", None, outline_chart(part.outline, part.label), _extent(part)))
    chart = histogram_chart(part)
    if chart is not None:
        left.append(element("figure", None, chart))
    right += _levels(part)
    head = [element("h3", None, part.label)] if named else []
    stacks = [element("div", {"class": "stack"}, *stack) for stack in (left, right) if stack]
    columns = element("div", {"class": "parts"}, *stacks)
    return element("article", None, *head, columns)


def _levels(part: FoundPartView) -> list[Markup]:
    """The thresholds in a table: a screen reader and a printed page have no colours to tell them apart."""
    if not part.levels:
        return []
    head = element("tr", None, *(element("th", {"scope": "col"}, text) for text in ("method", "level", "separable")))
    rows: list[Child] = [
        element(
            "tr",
            None,
            element("th", {"scope": "row"}, one.method),
            element("td", None, f"{one.level}"),
            element("td", None, f"{one.separability:.2f}"),
        )
        for one in part.levels
    ]
    return [element("table", {"class": "small"}, element("thead", None, head), element("tbody", None, *rows))]


def _extent(part: FoundPartView) -> Markup:
    """Size and uncertainty of the outline, in words."""
    assert part.outline is not None
    size = MM * (part.outline.vertices_m.max(axis=0) - part.outline.vertices_m.min(axis=0))
    text = f"Outline in the part frame: {size[0]:.0f} × {size[1]:.0f} mm"
    sigma = MM * part.outline.sigma_m
    if sigma.max(initial=0.0) > 0.0:
        text += f"; standard deviation of a vertex {sigma.min():.1f} to {sigma.max():.1f} mm"
    return element("figcaption", None, f"{text}.")
