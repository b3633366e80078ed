"""The part that is to be scanned, looked for by whatever camera the rig has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.acquisition.search import FoundPart
from surfuse.commands.acquire.finding_on_plane import Sighting, parts_seen, sightings
from surfuse.commands.acquire.locating import (
    SEARCH,
    LocatedPart,
    finder,
    locate,
    lookout_of,
    outlined_standing,
    turn_and_look,
)
from surfuse.commands.outcome import Watcher
from surfuse.errors import DataError, InterruptError, UnreachableError
from surfuse.records import CameraFrame, Outline
from surfuse.rig.devices import Rig, Viewpoints
from surfuse.settings import Settings


@dataclass(frozen=True)
class PlacedPart:
    """The part on the plane of the search that will be scanned, the pictures for the log, and what was seen whole."""

    outline: Outline
    pictures: int
    frames: tuple[CameraFrame, ...]
    parts: tuple[Sighting, ...]


def look_for_part(rig: Rig, settings: Settings, watcher: Watcher) -> LocatedPart | PlacedPart:
    """Turn joint 1, or go from view to view, or take the one picture of a fixed camera, until the part is found.

    Raises
    ------
    DataError : nothing was seen, the pictures cut it, or fewer parts were seen than the one that is asked for.
    UnreachableError : the arm can take none of the views.
    InterruptError : the watcher asked to stop; the arm has not moved since.
    """
    if isinstance(rig.lookout, Viewpoints):
        return _chosen(_looked_from_views(rig, rig.lookout, settings, watcher), settings, watcher)
    if settings.search.plane is None:
        return locate(rig, settings, watcher)
    turned = turn_and_look(rig, settings, watcher)
    (part,) = sightings(turned.chosen.frame, (turned.chosen.detection,), settings)
    if not part.whole:
        raise _cut(turned.pictures)
    return PlacedPart(part.outline, turned.pictures, tuple(one.frame for one in turned.found.parts), (part,))


def look_from_here(rig: Rig, settings: Settings, watcher: Watcher) -> LocatedPart | PlacedPart:
    """The part in the one picture that can be taken without a move; errors as `look_for_part`."""
    watcher.stage("search")
    rig.begin(SEARCH, 0)
    if isinstance(rig.lookout, Viewpoints):
        frame = rig.lookout.look()
        return _chosen(_Looked(_seen(frame, settings), 1, frame), settings, watcher)
    angle_rad, frame = lookout_of(rig).look_from_here()
    if settings.search.plane is not None:
        return _chosen(_Looked(_seen(frame, settings), 1, frame), settings, watcher)
    found = finder(settings)(frame)
    if not found:
        raise nothing_seen(1, frame)
    middle = min(found, key=lambda one: abs(float(one.centroid_px[0]) - frame.camera.cx_px))
    if middle.touches_border:
        watcher.warn(
            "the border of the picture cuts the part: turn joint 1 until all of it is seen; the search itself does so"
        )
    part = FoundPart(angle_rad, angle_rad, frame, middle, False)
    return outlined_standing(rig, settings, part, 1, (part,))


@dataclass(frozen=True)
class _Looked:
    """What was seen in how many pictures, and the last of them."""

    seen: tuple[Sighting, ...]
    pictures: int
    last: CameraFrame


def _looked_from_views(rig: Rig, lookout: Viewpoints, settings: Settings, watcher: Watcher) -> _Looked:
    """From view to view, up to the first that shows a whole part, or through all of them."""
    watcher.stage("search", max(len(lookout.moves), 1))
    every = settings.search.all_parts or settings.search.part > 1
    seen: list[Sighting] = []
    frames: list[CameraFrame] = []
    refused: list[str] = []
    for number in range(max(len(lookout.moves), 1)):
        if watcher.stop_requested():
            raise InterruptError(f"stopped after {len(frames)} pictures of the search, nothing is scanned yet")
        rig.begin(SEARCH, number)
        try:
            for move in lookout.moves[number : number + 1]:
                move()
        except UnreachableError as error:
            refused.append(error.what)
            watcher.warn(f"view {number + 1} of the search is left out: {error.what}")
            continue
        frames.append(lookout.look())
        watcher.advance()
        seen += _seen(frames[-1], settings)
        if not every and any(one.whole for one in seen):
            break
    if not frames:
        raise UnreachableError(
            f"the arm can take none of the {len(refused)} views of the search, the last because {refused[-1]}",
            cure="give views within its reach: 'surfuse doctor --cell' prints the one where it stands",
        )
    return _Looked(tuple(seen), len(frames), frames[-1])


def _seen(frame: CameraFrame, settings: Settings) -> tuple[Sighting, ...]:
    return sightings(frame, finder(settings)(frame), settings)


def _chosen(looked: _Looked, settings: Settings, watcher: Watcher) -> PlacedPart:
    """The part of the number that is wanted."""
    parts, number = parts_seen(looked.seen), settings.search.part
    if not looked.seen:
        raise nothing_seen(looked.pictures, looked.last)
    if not parts:
        raise _cut(looked.pictures)
    told = ", ".join(f"part {k} {_place(part.outline)}" for k, part in enumerate(parts, start=1))
    if number > len(parts):
        raise DataError(
            f"search.part = {number}, but {len(parts)} seen whole in {_counted(looked.pictures)}: {told}",
            cure="give the number of one of them",
        )
    if len(parts) > 1:
        watcher.warn(f"{len(parts)} parts found: {told}; part {number} is scanned")
    frames: list[CameraFrame] = []
    for part in parts:
        if not any(part.frame is frame for frame in frames):
            frames.append(part.frame)
    return PlacedPart(parts[number - 1].outline, looked.pictures, tuple(frames), parts)


def _cut(pictures: int) -> DataError:
    return DataError(
        f"a part is seen in {_counted(pictures)}, and the border of the picture or of search.region_px cuts it in each",
        cure="look from farther away, or move the part: all of it must be seen; where it is the table or something "
        "else that is cut, leave it out by search.region_px",
    )


def _counted(pictures: int) -> str:
    return "1 picture" if pictures == 1 else f"{pictures} pictures"


def _place(outline: Outline) -> str:
    """Where a part lies and how large it is, for messages."""
    place = ", ".join(f"{value:.3f}" for value in outline.world_from_part[:3, 3])
    size = 1e3 * np.ptp(outline.vertices_m, axis=0)
    return f"of {size[0]:.0f} x {size[1]:.0f} mm at ({place}) m"


def nothing_seen(pictures: int, last: CameraFrame) -> DataError:
    """No part in any picture, and what the last one looked like."""
    low, middle, high = np.percentile(last.image, (1.0, 50.0, 99.0))
    return DataError(
        f"no part seen in {_counted(pictures)}; the last one has grey levels {low:.0f} to {high:.0f}, median "
        f"{middle:.0f} of 255",
        cure="put a part where the camera sees it on a ground of another brightness, give light, or change "
        "search.threshold, search.smallest_part_m or search.region_px",
    )
