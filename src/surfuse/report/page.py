"""The report of one run as one self-contained HTML page."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from surfuse.errors import ConfigError
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
)
from surfuse.report.content import NamedMap, ReportContent
from surfuse.report.map_data import MM, group_data, legends, stop_data
from surfuse.report.markup import Child, Markup, element
from surfuse.report.packing import stride_for
from surfuse.report.scene_limits import SceneLimits
from surfuse.report.search_section import search_section
from surfuse.report.sections import (
    counts_section,
    explorer_section,
    plan_section,
    relief_section,
    replay_section,
    thinning_note,
)
from surfuse.report.side_section import side_section
from surfuse.report.skeleton import document


@dataclass(frozen=True)
class PageLimits:
    """How much data a page may hold, so that it stays below about 2 MB.

    `map_nodes_max` nodes of all maps together, `readings_max` readings behind the stops, `images_px` pixels of the
    longer side of a single image (several share the room), `replay` whether the 3-D replay (0.9 MB) is embedded.
    """

    map_nodes_max: int = 20000
    readings_max: int = 8000
    images_px: int = 760
    replay: bool = True
    scene: SceneLimits = field(default_factory=SceneLimits)

    def __post_init__(self) -> None:
        for name, least in (("map_nodes_max", 16), ("readings_max", 1), ("images_px", 32)):
            if getattr(self, name) < least:
                raise ConfigError(f"{name} = {getattr(self, name)}", cure=f"give at least {least}")


Section = tuple[str, str, Markup]


def _surface_sections(content: ReportContent) -> list[Section]:
    found: list[Section] = []
    if content.maps:
        found.append(("methods", "Methods" if content.rival is not None else "Layers", side_section(content)))
        found.append(("surface", "Surface", relief_section()))
        found.append(("maps", "Maps and cuts", explorer_section(content.points is not None)))
    if content.scores:
        text = element(
            "p", None, "Over the cells where both the map and the truth have a value. Best figures stand out."
        )
        found.append(("scores", "Errors", section("scores", "Errors against truth", text, score_table(content.scores))))
    return found


def _scan_sections(content: ReportContent, limits: PageLimits) -> list[Section]:
    found: list[Section] = []
    if limits.replay and content.readings is not None and content.readings.n_sweeps:
        found.append(("replay", "Replay", replay_section()))
    if content.parts:
        share = max(1.0, len(content.parts) ** 0.5)
        found.append(("search", "Search", search_section(content.parts, round(limits.images_px / share))))
    if content.plan is not None:
        found.append(("plan", "Plan", plan_section(content.plan)))
    if content.points is not None and len(content.points):
        found.append(("gaps", "Gaps", counts_section(content)))
    return found


def _closing_sections(content: ReportContent) -> list[Section]:
    found: list[Section] = []
    if content.events:
        found.append(("events", "Events", section("events", "Events and warnings", event_list(content.events))))
    if content.configuration_toml:
        block = configuration(content.configuration_toml)
        found.append(("configuration", "Configuration", section("configuration", "Configuration", block, long=True)))
    page_is = section("about", "About this page", about(content.version, run_folder=True))
    return [*found, ("about", "About", page_is)]


def _shown(content: ReportContent) -> tuple[NamedMap, ...]:
    """The maps of the page in the order of its data: those of the run, then the rival."""
    return (*content.maps, *((content.rival,) if content.rival is not None else ()))


def _nodes_each(content: ReportContent, limits: PageLimits) -> int:
    return max(16, limits.map_nodes_max // max(1, len(_shown(content)) + (content.truth is not None)))


def _data(content: ReportContent, limits: PageLimits) -> dict[str, object]:
    if not content.maps:
        return {"groups": [], "words": legends()}
    group = group_data(_shown(content), content.truth, _nodes_each(content, limits))
    if content.points is not None and len(content.points):
        pose = content.maps[0].surface.grid.world_from_part
        group["stops"] = stop_data(content.points, content.readings, pose, limits.readings_max)
    if content.plan is not None:
        group["outline"] = np.round(MM * content.plan.outline_m, 2).tolist()
    return {"groups": [group], "words": legends()}


def _strides(content: ReportContent, limits: PageLimits) -> list[tuple[str, int]]:
    each = _nodes_each(content, limits)
    named = [*_shown(content), *([content.truth] if content.truth else [])]
    return [(one.label, stride_for(one.surface.height_m.size, each, 2)) for one in named]


def render_report(content: ReportContent, limits: PageLimits | None = None) -> str:
    """The whole page as HTML text; sections without content are left out."""
    limit = limits or PageLimits()
    recording = ""
    if limit.replay and content.readings is not None and content.readings.n_sweeps:
        from surfuse.report.recording import record_scan

        recording = record_scan(content, limit.scene)
    sections = [*_surface_sections(content), *_scan_sections(content, limit), *_closing_sections(content)]
    facts = [
        f"scene {content.scene}" if content.scene else "",
        f"method {content.method}" if content.method else "",
        content.made,
        f"surfuse {content.version}" if content.version else "",
    ]
    header = [heading(content.title, facts, content.summary), contents([(name, title) for name, title, _ in sections])]
    body: list[Child] = [safety_note(content.safety), key_figures(content.figures)]
    body += [markup for _, _, markup in sections]
    body.append(thinning_note(_strides(content, limit)))
    footer = f"{content.title} · surfuse {content.version}".strip()
    return document(content.title, element("div", None, *header), body, _data(content, limit), recording, footer)
