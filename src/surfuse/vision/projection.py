"""Pixels to metres: the outline of a part on its vertical plane, with a standard deviation per vertex."""

from __future__ import annotations

import math

import numpy as np

from surfuse.geometry.poses import frame_from_axes, inverse, transform_points
from surfuse.records import CameraFrame, Detection, FloatArray, IntArray, Outline
from surfuse.vision.distance import Distance, ProjectionSigmas
from surfuse.vision.plane import on_plane, rightwards, viewing_direction
from surfuse.vision.table_contact import cut_below, foot_points


def project_outline(
    frame: CameraFrame,
    detection: Detection,
    vertices: IntArray,
    distance: Distance,
    table_height_m: float,
    sigmas: ProjectionSigmas | None = None,
) -> Outline:
    """The outline through the contour points `vertices` (K,), on the plane at `distance`, in the frame of the part.

    Origin: on the table under the centroid; v up, w horizontally back to the camera, u = v x w. Every v is corrected
    so that the foot stands on the table. `sigma_m` is the larger one of the standard deviations along u and v.

    Raises
    ------
    DataError : fewer than 3 vertices, or the camera looks straight up or down.
    """
    errors = sigmas or ProjectionSigmas()
    forward = viewing_direction(frame)
    ahead = on_plane(frame, detection.contour_px, forward)
    aside = float(on_plane(frame, detection.centroid_px[None, :], forward)[0, 0])
    foot = _foot_level(frame, detection, vertices, ahead, distance, table_height_m)
    corners = ahead[vertices] - [aside, foot]
    origin = frame.world_from_camera[:3, 3] + distance.distance_m * (forward + aside * rightwards(forward))
    origin[2] = table_height_m
    order = _counter_clockwise(corners)
    world_from_part = frame_from_axes(origin, rightwards(forward), np.array([0.0, 0.0, 1.0]))
    return Outline(
        vertices_m=distance.distance_m * corners[order],
        world_from_part=world_from_part,
        sigma_m=_vertex_sigma(frame, ahead[vertices], foot, distance, errors)[order],
        holes_m=tuple(
            distance.distance_m * (on_plane(frame, hole, forward) - [aside, foot]) for hole in detection.holes_px
        ),
        viewpoint_m=transform_points(inverse(world_from_part), frame.world_from_camera[:3, 3]),
    )


def _foot_level(
    frame: CameraFrame,
    detection: Detection,
    vertices: IntArray,
    ahead: FloatArray,
    distance: Distance,
    table_height_m: float,
) -> float:
    """How far the table is below the camera, a metre ahead: seen at the foot, or from the height if that is hidden."""
    if cut_below(frame.camera, detection.contour_px):
        return (table_height_m - float(frame.world_from_camera[2, 3])) / distance.distance_m
    return float(ahead[foot_points(frame.camera, detection.contour_px, vertices), 1].mean())


def _vertex_sigma(
    frame: CameraFrame, ahead: FloatArray, foot: float, distance: Distance, errors: ProjectionSigmas
) -> FloatArray:
    """Standard deviation (K,) of vertices whose rays are `ahead` (K, 2), the larger one of those along u and v.

    Distance and focal length scale a vertex away from axis and foot. Relief moves a vertex along its ray, away from
    the point straight ahead of the camera. A pixel moves it by d / f; the foot's own pixel counts in v, where it is
    subtracted.
    """
    scale = math.hypot(distance.sigma_m / distance.distance_m, errors.focal)
    scaled = scale * distance.distance_m * np.abs(ahead - [0.0, foot])
    relief = distance.relief_m * np.abs(ahead)
    pixel = distance.distance_m * errors.pixel_px / np.array([frame.camera.fx_px, frame.camera.fy_px / math.sqrt(2.0)])
    return np.asarray(np.sqrt(scaled**2 + relief**2 + pixel**2).max(axis=1))


def _counter_clockwise(flat: FloatArray) -> IntArray:
    x, y = flat[:, 0], flat[:, 1]
    doubled = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    order = np.arange(len(flat))
    return order if doubled >= 0.0 else order[::-1].copy()
