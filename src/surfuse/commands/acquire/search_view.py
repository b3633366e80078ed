"""What the report shows of the search: vision run again on the pictures of the log."""

from __future__ import annotations

import math

import numpy as np

from surfuse.commands.acquire.finding_on_plane import parts_seen, sightings
from surfuse.commands.acquire.locating import finder
from surfuse.errors import DataError
from surfuse.records import CameraFrame, Detection, Outline
from surfuse.report.content import FoundPartView, MarkedLevel
from surfuse.runs.log_records import RunLog
from surfuse.settings import Settings
from surfuse.vision.dominant_points import DominantPointParameters, dominant_points
from surfuse.vision.outline import outline_part
from surfuse.vision.threshold import METHODS, histogram, threshold

_SAME_PLACE_M = 1e-9
_DOWN = 0.87  # more than 60 degrees up or down


def found_parts(log: RunLog, settings: Settings) -> tuple[FoundPartView, ...]:
    """Every part that a picture of the log was centred on, in the order of the pictures; on a plane, every one seen."""
    find = finder(settings)
    if settings.search.plane is not None:
        seen_on_plane = (one for frame in log.frames for one in sightings(frame, find(frame), settings))
        return tuple(
            _part(f"part {number}", one.frame, one.detection, one.outline, settings)
            for number, one in enumerate(parts_seen(seen_on_plane), start=1)
        )
    seen = [(frame, find(frame)) for frame in log.frames]
    centred = [(frame, min(found, key=lambda one: _aside(frame, one))) for frame, found in seen if found]
    return tuple(
        _part(
            f"part {number}",
            frame,
            detection,
            _logged(frame, log) or _from_the_foot(frame, detection, settings),
            settings,
        )
        for number, (frame, detection) in enumerate(centred, start=1)
    )


def _aside(frame: CameraFrame, detection: Detection) -> float:
    return abs(float(detection.centroid_px[0]) - frame.camera.cx_px)


def _part(
    label: str, frame: CameraFrame, detection: Detection, outline: Outline | None, settings: Settings
) -> FoundPartView:
    aspect = frame.camera.fy_px / frame.camera.fx_px
    chosen = dominant_points(detection.contour_px, _dominant(settings), row_scale=1.0 / aspect)
    divided = [threshold(frame.image, method) for method in METHODS]
    return FoundPartView(
        label=label,
        image=frame.image,
        contour_px=detection.contour_px,
        dominant_px=detection.contour_px[chosen.indices],
        pixel_aspect=aspect,
        threshold=detection.level,
        histogram=histogram(frame.image),
        levels=tuple(MarkedLevel(one.method, one.level, one.separability) for one in divided),
        outline=outline,
        facts=_facts(frame, detection, outline),
    )


def _logged(frame: CameraFrame, log: RunLog) -> Outline | None:
    """The outline that the scan followed, if it was seen from where this picture was taken."""
    outline = log.scene.outline if log.scene is not None else None
    if outline is None or outline.viewpoint_m is None:
        return None
    eye = outline.world_from_part[:3, :3] @ outline.viewpoint_m + outline.world_from_part[:3, 3]
    return outline if np.abs(eye - frame.world_from_camera[:3, 3]).max() < _SAME_PLACE_M else None


def _dominant(settings: Settings) -> DominantPointParameters:
    return DominantPointParameters(tolerance_px=settings.search.tolerance_px)


def _from_the_foot(frame: CameraFrame, detection: Detection, settings: Settings) -> Outline | None:
    """The outline of a part that was not scanned: its range is not in the log, its foot is in the picture."""
    try:
        return outline_part(frame, detection, settings.cell.table_height_m, dominant=_dominant(settings)).outline
    except DataError:
        return None


def _facts(frame: CameraFrame, detection: Detection, outline: Outline | None) -> tuple[str, ...]:
    facts = [_from_where(frame)]
    if outline is not None and outline.viewpoint_m is not None:
        facts.append(f"{1e3 * outline.viewpoint_m[2]:.0f} mm away")
    return (*facts, f"{100.0 * detection.confidence:.0f} % of its boundary is an edge")


def _from_where(frame: CameraFrame) -> str:
    """The direction in which a camera looks outwards, or the place of one that looks down or up."""
    axis, place = frame.world_from_camera[:3, 2], frame.world_from_camera[:3, 3]
    if abs(axis[2]) > _DOWN:
        return f"camera at ({', '.join(f'{1e3 * value:.0f}' for value in place)}) mm"
    return f"camera at {math.degrees(math.atan2(axis[1], axis[0])):.1f}°"
