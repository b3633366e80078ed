"""Several methods on several scenes as one page: maps side by side, one cut through all, errors, words with numbers."""

from __future__ import annotations

from surfuse.report.blocks import (
    about,
    configuration,
    contents,
    event_list,
    heading,
    key_figures,
    safety_note,
    score_table,
    section,
    text_table,
)
from surfuse.report.content import ComparisonContent, SceneComparison
from surfuse.report.map_data import MM, group_data, legends
from surfuse.report.markup import Child, Markup, element
from surfuse.report.page import PageLimits
from surfuse.report.skeleton import document


def _statements(scene: SceneComparison) -> list[Child]:
    said = [("Reported", scene.expected), ("Seen here", scene.found)]
    cards: list[Child] = [
        element("div", None, element("h3", None, title), element("p", None, text)) for title, text in said if text
    ]
    return [element("div", {"class": "statements"}, *cards)] if cards else []


def _figures(scene: SceneComparison, index: int) -> Markup:
    """Small maps with one cursor, then the cut through all of them."""
    across = "v" if scene.cut_along == "u" else "u"
    layer = element("label", None, "Show", element("select", {"data-role": "layer"}))
    scale = element("div", {"class": "scale", "data-role": "scale"})
    at = element("span", None, f"Cut at {across} = ", element("output", {"data-role": "at"}))
    slider = element("label", None, at, element("input", {"type": "range", "data-role": "slide"}))
    return element(
        "div",
        {"data-comparison": index, "data-along": scene.cut_along, "data-at": float(MM * scene.cut_at_m)},
        element("div", {"class": "controls"}, layer, scale),
        element("div", {"class": "multiples", "data-role": "multiples"}),
        element("h3", None, f"Profile along {scene.cut_along}"),
        element("div", {"class": "controls"}, slider),
        element("div", {"class": "legend", "data-role": "legend"}),
        element("figure", None, element("div", {"data-role": "cut"})),
    )


def _scene_section(scene: SceneComparison, index: int) -> Markup:
    children: list[Child] = [*_statements(scene)]
    if scene.figures:
        children.append(key_figures(scene.figures))
    if scene.maps:
        children.append(_figures(scene, index))
    if scene.scores:
        children += [element("h3", None, "Errors against truth"), score_table(scene.scores)]
    return section(f"scene-{index + 1}", scene.name, *children, long=True)


def render_comparison(content: ComparisonContent, limits: PageLimits | None = None) -> str:
    """The whole page as HTML text; all maps of a scene share colours, axes and cursor."""
    limit = limits or PageLimits()
    drawn = sum(len(scene.maps) + (scene.truth is not None) for scene in content.scenes)
    each = max(16, limit.map_nodes_max // max(1, drawn))
    groups = [group_data(scene.maps, scene.truth, each) for scene in content.scenes]
    entries = [(f"scene-{k + 1}", scene.name) for k, scene in enumerate(content.scenes)]
    body: list[Child] = [safety_note(content.safety), key_figures(content.figures)]
    body += [_scene_section(scene, k) for k, scene in enumerate(content.scenes)]
    for k, table in enumerate(content.tables):
        body.append(section(f"table-{k + 1}", table.title, element("p", None, table.text), text_table(table)))
        entries.append((f"table-{k + 1}", table.title))
    if content.events:
        body.append(section("events", "Events and warnings", event_list(content.events)))
        entries.append(("events", "Events"))
    if content.configuration_toml:
        block = configuration(content.configuration_toml)
        body.append(section("configuration", "Configuration", block, long=True))
        entries.append(("configuration", "Configuration"))
    body.append(section("about", "About this page", about(content.version, run_folder=False)))
    entries.append(("about", "About"))
    facts = [content.made, f"surfuse {content.version}" if content.version else ""]
    header = element("div", None, heading(content.title, facts, content.introduction), contents(entries))
    data = {"groups": groups, "words": legends()}
    return document(content.title, header, body, data, "", f"{content.title} · surfuse {content.version}".strip())
