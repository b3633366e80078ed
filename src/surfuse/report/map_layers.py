"""The layers of a map that a scene can show: height or sigma, as colours with a legend."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Literal, get_args

import numpy as np
import trimesh
import viser

from surfuse.records import FloatArray, SurfaceMap
from surfuse.report.colours import ANCHORS, colourise
from surfuse.report.meshes import both_windings, map_mesh
from surfuse.report.moving_parts import BEAM_LEGEND

Layer = Literal["height", "sigma"]
LAYERS: tuple[Layer, ...] = get_args(Layer)
_COLOURS: dict[Layer, str] = {"height": "viridis", "sigma": "magma"}
_MEANING: dict[Layer, str] = {"height": "height w above the part plane", "sigma": "standard deviation of the height"}
EVEN_LIGHT = 2.0
_LEAST_SPAN_M: dict[Layer, float] = {"height": 1e-3, "sigma": 1e-5}


@dataclass(frozen=True)
class ColourRange:
    """Which values (m) the ends of the colours stand for."""

    layer: Layer
    low_m: float
    high_m: float


def values_of(surface: SurfaceMap, layer: Layer) -> FloatArray:
    """The layer (R, C) in m, nan where there is no value."""
    chosen = surface.height_m if layer == "height" else surface.sigma_m
    return np.where(surface.mask, chosen, np.nan)


def colour_range(surfaces: Sequence[SurfaceMap], layer: Layer) -> ColourRange:
    """One range for several maps: nearly all heights, or sigma from zero to nearly all."""
    values = [values_of(surface, layer)[surface.mask] for surface in surfaces]
    joined = np.concatenate(values) if values else np.zeros(0)
    low, high = np.percentile(joined, [0.5, 99.5]) if joined.size else (0.0, 0.0)
    low = float(low) if layer == "height" else 0.0
    return ColourRange(layer, low, max(float(high), low + _LEAST_SPAN_M[layer]))


def coloured_mesh(surface: SurfaceMap, most_nodes: int, shown: ColourRange) -> trimesh.Trimesh | None:
    """The map as a mesh in the world, coloured by the layer; None where no cell has all its corners."""
    vertices, faces, height = map_mesh(surface, most_nodes)
    if not len(faces):
        return None
    values = height
    if shown.layer == "sigma":
        _, _, values = map_mesh(surface, most_nodes, surface.sigma_m)
    # The GLB path carries vertex colours but draws front sides only.
    twice, both = both_windings(vertices, faces)
    colours = colourise(np.tile(values, 2), shown.low_m, shown.high_m, _COLOURS[shown.layer])
    return trimesh.Trimesh(twice, both, vertex_colors=colours, process=False)


def add_even_light(scene: viser.SceneApi) -> None:
    """Light from everywhere, by which colours look as in the legend on whichever side they are seen."""
    scene.add_light_ambient("/light", intensity=EVEN_LIGHT)


def legend_html(shown: ColourRange | None, beams: bool) -> str:
    """What the colours mean, with units, as HTML of the viewer's side bar."""
    parts = [] if shown is None else [_bar(shown)]
    if beams:
        dots = "".join(
            f'<div><span style="display:inline-block;width:1.4em;height:0.35em;background:{colour};'
            f'margin:0 0.5em 0.2em 0"></span>{escape(text)}</div>'
            for colour, text in BEAM_LEGEND
        )
        parts.append(f'<div style="margin-top:0.6em"><b>beams</b>{dots}</div>')
    return f'<div style="font-size:0.8em;padding:0 0.9em 0.4em 0.9em">{"".join(parts)}</div>'


def _bar(shown: ColourRange) -> str:
    stops = ", ".join(f"#{code}" for code in ANCHORS[_COLOURS[shown.layer]].split())
    low, high = 1e3 * shown.low_m, 1e3 * shown.high_m
    digits = int(np.clip(2 - np.floor(np.log10(max(high - low, 1e-9))), 0, 4))
    ticks = "".join(f"<span>{value:.{digits}f}</span>" for value in (low, 0.5 * (low + high), high))
    return (
        f"<b>{shown.layer}, mm</b> ({escape(_MEANING[shown.layer])})"
        f'<div style="height:0.8em;margin:0.3em 0;background:linear-gradient(to right, {stops})"></div>'
        f'<div style="display:flex;justify-content:space-between">{ticks}</div>'
        '<div><span style="display:inline-block;width:1.4em;height:0.7em;background:#969696;'
        'margin-right:0.5em"></span>no reading holds it</div>'
    )
