"""From a detection to the outline in metres: dominant points, distance, projection."""

from __future__ import annotations

from dataclasses import dataclass

from surfuse.records import CameraFrame, Detection, Outline
from surfuse.vision.distance import Distance, ProjectionSigmas, ShoulderRange, measure_distance
from surfuse.vision.dominant_points import DominantPointParameters, DominantPoints, dominant_points
from surfuse.vision.projection import project_outline


@dataclass(frozen=True)
class PartOutline:
    """The outline in the part frame, the dominant points it goes through, and the distance it rests on."""

    outline: Outline
    dominant: DominantPoints
    distance: Distance


def outline_part(
    frame: CameraFrame,
    detection: Detection,
    table_height_m: float,
    shoulder: ShoulderRange | None = None,
    dominant: DominantPointParameters | None = None,
    sigmas: ProjectionSigmas | None = None,
) -> PartOutline:
    """Outline of a detected part standing on a table of known height; the tolerance is in columns of the picture.

    Raises
    ------
    DataError : the distance is unknown, or the contour has fewer than 3 points.
    """
    points = dominant_points(detection.contour_px, dominant, row_scale=frame.camera.fx_px / frame.camera.fy_px)
    distance = measure_distance(frame, detection.contour_px, points.indices, table_height_m, shoulder, sigmas)
    outline = project_outline(frame, detection, points.indices, distance, table_height_m, sigmas)
    return PartOutline(outline, points, distance)
