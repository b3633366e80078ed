"""Parts on a known plane, such as a table that the camera looks down at: found in pictures, outlined, told apart."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.polygons import contains
from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import CameraFrame, CameraModel, Detection, FloatArray, Outline
from surfuse.settings import Settings
from surfuse.settings.looking_tables import Region
from surfuse.vision.dominant_points import DominantPointParameters
from surfuse.vision.part_finder import FindParameters, find_parts
from surfuse.vision.polarity import Polarity
from surfuse.vision.support_plane import height_over, outline_on_support, plane_frame

_AREA_MIN_PX = 16.0
_EITHER: tuple[Polarity, ...] = ("bright", "dark")

Find = Callable[[CameraFrame], tuple[Detection, ...]]
"""Names the parts in a picture."""


@dataclass(frozen=True)
class Sighting:
    """A part in a picture, and its outline on the plane."""

    frame: CameraFrame
    detection: Detection
    outline: Outline

    @property
    def whole(self) -> bool:
        """Whether the picture, or the region of it that is looked at, does not cut it."""
        return not self.detection.touches_border


def plane_of(settings: Settings) -> FloatArray:
    """`world_from_plane` (4, 4) of the search.

    Raises
    ------
    ConfigError : it has none.
    """
    plane = settings.search.plane
    if plane is None:
        raise ConfigError("no plane says where the part lies", cure="give [search] plane = {origin_m, normal}")
    return plane_frame(np.array(plane.origin_m), np.array(plane.normal), None if plane.u is None else np.array(plane.u))


def finder_on_plane(settings: Settings) -> Find:
    """The function that finds parts in a picture, the largest first.

    Where the border cuts all of them, they may be the table itself, seen with what is beside it: then regions brighter
    and regions darker than the rest are looked for, and those that are whole are the parts.
    """
    world_from_plane = plane_of(settings)
    base = FindParameters(method=settings.search.threshold)

    def find(frame: CameraFrame) -> tuple[Detection, ...]:
        focal_px = np.sqrt(frame.camera.fx_px * frame.camera.fy_px)
        side_px = 0.5 * settings.search.smallest_part_m / height_over(frame, world_from_plane) * focal_px
        chosen = replace(base, area_min_px=max(float(side_px) ** 2, _AREA_MIN_PX))
        found = find_parts(frame, chosen)
        if not found or not all(one.touches_border for one in found):
            return found
        bright, dark = (find_parts(frame, replace(chosen, polarity=polarity)) for polarity in _EITHER)
        whole = [one for one in (*bright, *dark) if not one.touches_border]
        return tuple(sorted(whole, key=lambda one: -one.area_px)) or found

    return find


def in_region(find: Find, region: Region | None) -> Find:
    """The same, of a region of each picture (left, top, width, height) as if it were the whole; None: the picture."""
    if region is None:
        return find
    corner = np.array(region[:2], dtype=np.float64)
    return lambda frame: tuple(_shifted(one, corner) for one in find(_cut_out(frame, region)))


def sightings(frame: CameraFrame, found: Iterable[Detection], settings: Settings) -> tuple[Sighting, ...]:
    """The parts that were found in a picture, with their outlines."""
    world_from_plane = plane_of(settings)
    dominant = DominantPointParameters(tolerance_px=settings.search.tolerance_px)
    return tuple(Sighting(frame, one, outline_on_support(frame, one, world_from_plane, dominant)) for one in found)


def parts_seen(seen: Iterable[Sighting]) -> tuple[Sighting, ...]:
    """Every part once: the first sighting that shows all of it, in order; those that no picture shows whole are out.

    Two sightings are one part when the middle of one lies inside the outline of the other.
    """
    kept: list[Sighting] = []
    for one in seen:
        if one.whole and not any(_same(one.outline, other.outline) for other in kept):
            kept.append(one)
    return tuple(kept)


def _same(one: Outline, other: Outline) -> bool:
    there = transform_points(inverse(other.world_from_part), one.world_from_part[:3, 3])[:2]
    here = transform_points(inverse(one.world_from_part), other.world_from_part[:3, 3])[:2]
    return bool(contains(there[None], other.vertices_m)[0] or contains(here[None], one.vertices_m)[0])


def _cut_out(frame: CameraFrame, region: Region) -> CameraFrame:
    """The region of a picture as a picture of its own.

    Raises
    ------
    ConfigError : it reaches beyond the picture.
    """
    left, top, width, height = region
    camera = frame.camera
    if left + width > camera.width_px or top + height > camera.height_px:
        raise ConfigError(
            f"search.region_px = {list(region)} ends at ({left + width}, {top + height}), "
            f"the picture has {camera.width_px} x {camera.height_px} pixels",
            cure="give left, top, width, height inside of it",
        )
    inner: CameraModel = replace(
        camera, width_px=width, height_px=height, cx_px=camera.cx_px - left, cy_px=camera.cy_px - top
    )
    return CameraFrame(frame.image[top : top + height, left : left + width], frame.t_s, inner, frame.world_from_camera)


def _shifted(detection: Detection, by_px: FloatArray) -> Detection:
    """A detection of a cut-out in the whole picture."""
    return replace(
        detection,
        contour_px=detection.contour_px + by_px,
        centroid_px=detection.centroid_px + by_px,
        holes_px=tuple(hole + by_px for hole in detection.holes_px),
    )
