"""The first steps of an acquisition: search, centre, threshold, dominant points, scale (paper, section 3.1)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from surfuse.acquisition.search import FoundPart, SearchParameters, SearchResult, search
from surfuse.commands.acquire.finding_on_plane import Find, finder_on_plane, in_region
from surfuse.commands.outcome import Watcher
from surfuse.errors import ConfigError, DataError, InterruptError
from surfuse.records import CameraFrame, Detection, Outline, Status
from surfuse.rig.devices import Lookout, Rig
from surfuse.settings import Settings
from surfuse.vision.distance import ShoulderRange
from surfuse.vision.dominant_points import DominantPointParameters
from surfuse.vision.outline import PartOutline, outline_part
from surfuse.vision.part_finder import FindParameters, find_parts
from surfuse.vision.table import TableRing

SEARCH, RANGE = "search", "range"


@dataclass(frozen=True)
class LocatedPart:
    """The part that will be scanned: the picture in which it is centred, what was seen, its outline in metres.

    `parts` are all that were found, in order of angle, this one among them.
    """

    frame: CameraFrame
    detection: Detection
    outlined: PartOutline
    pictures: int
    parts: tuple[FoundPart, ...]

    @property
    def outline(self) -> Outline:
        """The outline in the part frame, as seen."""
        return self.outlined.outline

    @property
    def frames(self) -> tuple[CameraFrame, ...]:
        """The pictures for the log: one a part."""
        return tuple(found.frame for found in self.parts)


def finder(settings: Settings) -> Find:
    """The function that finds the parts in a picture: on the plane of the search, or standing on the ring table."""
    find = _finder_on_table(settings) if settings.search.plane is None else finder_on_plane(settings)
    return in_region(find, settings.search.region_px)


def _finder_on_table(settings: Settings) -> Find:
    ring = TableRing(
        settings.cell.table_height_m, settings.cell.table_inner_radius_m, settings.cell.table_outer_radius_m
    )
    smallest_px = settings.search.smallest_part_m / settings.cell.table_outer_radius_m
    area_px = 0.25 * smallest_px**2 * settings.camera.fx_px * settings.camera.fy_px
    parameters = FindParameters(method=settings.search.threshold, area_min_px=max(area_px, 16.0))
    return lambda frame: find_parts(frame, parameters, ring)


def lookout_of(rig: Rig) -> Lookout:
    """What looks for the part.

    Raises
    ------
    ConfigError : the rig has no camera on its shoulder.
    """
    if not isinstance(rig.lookout, Lookout):
        raise ConfigError("no camera looks for the part", cure="add an [area] to the cell file, or a camera")
    return rig.lookout


def locate(rig: Rig, settings: Settings, watcher: Watcher) -> LocatedPart:
    """Search, centre, threshold, dominant points, scale (paper, section 3.1).

    Raises
    ------
    DataError : no part was seen in a whole turn, or fewer than the one that is asked for.
    InterruptError : the watcher asked to stop; the arm has not moved since.
    """
    turned = turn_and_look(rig, settings, watcher)
    found, chosen = turned.found, turned.chosen
    if found.visited_rad[-1] != chosen.angle_rad:
        turned.look_again(chosen.angle_rad)  # the ranger sits beside the camera: it must look at this part again
    return outlined_standing(rig, settings, chosen, turned.pictures, found.parts)


@dataclass
class Turned:
    """A search that turned joint 1: what was found, the part that is wanted, and how many pictures it took."""

    found: SearchResult
    chosen: FoundPart
    pictures: int
    capture: Callable[[float], CameraFrame]

    def look_again(self, joint1_rad: float) -> None:
        """One more picture."""
        self.capture(joint1_rad)
        self.pictures += 1


def turn_and_look(rig: Rig, settings: Settings, watcher: Watcher) -> Turned:
    """Turn joint 1 until a part is seen, and centre it; see `locate`."""
    lookout = lookout_of(rig)
    lower, upper = lookout.turn_rad
    increment = np.radians(settings.search.increment_deg)
    watcher.stage("search", int((upper - lower) / increment) + 1)
    pictures = 0

    def capture(joint1_rad: float) -> CameraFrame:
        nonlocal pictures
        if watcher.stop_requested():
            raise InterruptError(f"stopped after {pictures} pictures of the search, nothing is scanned yet")
        rig.begin(SEARCH, pictures)
        pictures += 1
        watcher.advance()
        return lookout.look(joint1_rad)

    every = settings.search.all_parts or settings.search.part > 1
    turn = SearchParameters(increment_rad=float(increment), all_parts=every)
    found = search(capture, finder(settings), lower, upper, turn)
    chosen = _wanted(found, settings.search.part)
    if len(found.parts) > 1:
        watcher.warn(f"{len(found.parts)} parts found: {_told(found.parts)}; part {settings.search.part} is scanned")
    return Turned(found, chosen, pictures, capture)


def _wanted(found: SearchResult, number: int) -> FoundPart:
    """The part of this number, counted from 1 in order of angle."""
    looked = f"in {len(found.visited_rad)} pictures from {_degrees(min(found.visited_rad))} to "
    looked += f"{_degrees(max(found.visited_rad))} degrees"
    if not found.parts:
        raise DataError(
            f"no part seen {looked}",
            cure="put a part on the table where the camera can see it, or change search.threshold",
        )
    if number > len(found.parts):
        raise DataError(
            f"search.part = {number}, but {len(found.parts)} seen {looked}: {_told(found.parts)}",
            cure="give the number of one of them",
        )
    return found.parts[number - 1]


def _told(parts: tuple[FoundPart, ...]) -> str:
    return ", ".join(
        f"part {number} at {_degrees(part.direction_rad)} degrees (confidence {part.detection.confidence:.2f})"
        for number, part in enumerate(parts, start=1)
    )


def _degrees(angle_rad: float) -> str:
    return f"{math.degrees(angle_rad):.0f}"


def outlined_standing(
    rig: Rig, settings: Settings, part: FoundPart, pictures: int, parts: tuple[FoundPart, ...]
) -> LocatedPart:
    """Range of the centred part, dominant points, pixels to metres: of a part that stands on the table."""
    outlined = outline_part(
        part.frame,
        part.detection,
        settings.cell.table_height_m,
        _ranged(rig, part.angle_rad),
        DominantPointParameters(tolerance_px=settings.search.tolerance_px),
    )
    return LocatedPart(part.frame, part.detection, outlined, pictures, parts)


def _ranged(rig: Rig, joint1_rad: float) -> ShoulderRange | None:
    """What the shoulder's ranger says; None without one, and without an echo."""
    rig.begin(RANGE, 0)
    lookout = lookout_of(rig)
    if lookout.ranger is None or lookout.shoulder_from_ranger is None:
        return None
    echo = lookout.ranger.fire()
    place = lookout.on_shoulder(joint1_rad, lookout.shoulder_from_ranger)
    if echo.status != Status.OK:
        return None
    return ShoulderRange(place[:3, 3], place[:3, 2], echo.range_m, lookout.ranger.spec.sigma_m)
