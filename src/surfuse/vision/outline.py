"""From a detection to the outline in metres: dominant points, distance, projection."""

from __future__ import annotations

from dataclasses import dataclass

from surfuse.errors import DataError
from surfuse.geometry.untangling import untangled
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
    DataError : the distance is unknown, or the contour has fewer than 3 points or no area.
    """
    points = dominant_points(detection.contour_px, dominant, row_scale=frame.camera.fx_px / frame.camera.fy_px)
    vertices = points.indices[untangled(points.points_px)]
    if len(vertices) < 3:
        raise DataError(
            f"the outline of {len(points.indices)} dominant points crosses itself and leaves no area",
            cure="give a smaller tolerance, or a sharper picture",
        )
    distance = measure_distance(frame, detection.contour_px, vertices, table_height_m, shoulder, sigmas)
    outline = project_outline(frame, detection, vertices, distance, table_height_m, sigmas)
    return PartOutline(outline, points, distance)
