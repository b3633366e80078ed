"""The outline of a part on a plane whose place in the world is known, such as the table that the camera looks down at.

The rays of the contour meet the plane. What stands up from it hides a strip of it behind itself, so that the outline is
never too small; `viewpoint_m` of the outline says from where it was seen.
"""

from __future__ import annotations

import numpy as np

from surfuse.errors import DataError
from surfuse.geometry.polygons import signed_area
from surfuse.geometry.poses import frame_from_axes, inverse, rotate_vectors, transform_points
from surfuse.geometry.untangling import untangled
from surfuse.records import CameraFrame, Detection, FloatArray, Outline
from surfuse.vision.distance import ProjectionSigmas
from surfuse.vision.dominant_points import DominantPointParameters, dominant_points
from surfuse.vision.rays import world_rays

_GRAZING = 0.05  # sine of the least angle between a ray and the plane
_STEEP = 0.7  # share of the vertical in the normal below which the plane is a wall


def plane_frame(origin_m: FloatArray, normal: FloatArray, u: FloatArray | None) -> FloatArray:
    """`world_from_plane` (4, 4) with w = `normal` (3,), and u as given, or as a person would lay it.

    On a table u is the x of the world; on a wall it is horizontal and v points up.
    """
    w = normal / np.linalg.norm(normal)
    if u is None:
        up = np.array([0.0, 0.0, 1.0])
        u = np.cross(up, w) if abs(w[2]) < _STEEP else np.array([1.0, 0.0, 0.0]) - w[0] * w
    return frame_from_axes(origin_m, u, np.cross(w, u))


def height_over(frame: CameraFrame, world_from_plane: FloatArray) -> float:
    """How far the camera is in front of the plane (m).

    Raises
    ------
    DataError : it is on it or behind it.
    """
    height_m = float((inverse(world_from_plane) @ frame.world_from_camera)[2, 3])
    if height_m <= 0.0:
        place = ", ".join(f"{value:.3f}" for value in frame.world_from_camera[:3, 3])
        raise DataError(
            f"the camera at ({place}) m is {-1e3 * height_m:.0f} mm behind the plane of the part, wanted before it",
            cure="check the camera's pose, and search.plane: its normal points at the camera",
        )
    return height_m


def on_support(frame: CameraFrame, world_from_plane: FloatArray, pixels: FloatArray) -> FloatArray:
    """Where the rays through pixels (N, 2) meet the plane: (N, 2) u, v in its frame.

    Raises
    ------
    DataError : the camera is behind the plane, or a ray passes it at less than 3 degrees.
    """
    height_over(frame, world_from_plane)
    plane_from_world = inverse(world_from_plane)
    eye = transform_points(plane_from_world, frame.world_from_camera[:3, 3])
    rays = rotate_vectors(plane_from_world, world_rays(frame.camera, frame.world_from_camera, pixels))
    falls = -rays[:, 2] / np.linalg.norm(rays, axis=1)
    if np.any(falls < _GRAZING):
        least = float(np.degrees(np.arcsin(np.clip(falls.min(), -1.0, 1.0))))
        raise DataError(
            f"the camera sees the part's boundary at {least:.0f} degrees to its plane, at least 3 are needed",
            cure="let the camera look at the plane, check its pose, and search.plane",
        )
    return np.asarray(eye[:2] - rays[:, :2] * (eye[2] / rays[:, 2])[:, None], dtype=np.float64)


def outline_on_support(
    frame: CameraFrame,
    detection: Detection,
    world_from_plane: FloatArray,
    dominant: DominantPointParameters | None = None,
    sigmas: ProjectionSigmas | None = None,
) -> Outline:
    """The outline of a detected part on a plane (pose (4, 4)), in a part frame parallel to it under the centroid.

    Raises
    ------
    DataError : the plane is not seen, or the outline has no area.
    """
    points = dominant_points(detection.contour_px, dominant, row_scale=frame.camera.fx_px / frame.camera.fy_px)
    vertices = points.indices[untangled(points.points_px)]
    if len(vertices) < 3:
        raise DataError(
            f"the outline of {len(points.indices)} dominant points crosses itself and leaves no area",
            cure="give a smaller tolerance, or a sharper picture",
        )
    contour_px = detection.contour_px[vertices]
    flat = on_support(frame, world_from_plane, contour_px)
    sigma = _sigma(frame, world_from_plane, contour_px, flat, sigmas or ProjectionSigmas())
    centre = on_support(frame, world_from_plane, detection.centroid_px[None, :])[0]
    world_from_part = world_from_plane.copy()
    world_from_part[:3, 3] = transform_points(world_from_plane, np.array([*centre, 0.0]))
    order = np.arange(len(flat)) if signed_area(flat) >= 0.0 else np.arange(len(flat))[::-1]
    return Outline(
        vertices_m=(flat - centre)[order],
        world_from_part=world_from_part,
        sigma_m=sigma[order],
        holes_m=tuple(on_support(frame, world_from_plane, hole) - centre for hole in detection.holes_px),
        viewpoint_m=transform_points(inverse(world_from_part), frame.world_from_camera[:3, 3]),
    )


def _sigma(
    frame: CameraFrame, world_from_plane: FloatArray, contour_px: FloatArray, flat: FloatArray, errors: ProjectionSigmas
) -> FloatArray:
    """Standard deviation (K,) of vertices `flat` (K, 2) on the plane, along the direction in which it is largest.

    A pixel moves a vertex by what a shift of the contour by a pixel does; the focal length scales it away from the
    point straight ahead of the camera; an error of e rad of the camera's turn moves it by e (d^2 + h^2) / h; one of its
    height by the share d / h. Here h is the height over the plane, d the distance along it.
    """
    eye = (inverse(world_from_plane) @ frame.world_from_camera)[:3, 3]
    height_m, aside_m = float(eye[2]), np.linalg.norm(flat - eye[:2], axis=1)
    shifted = [on_support(frame, world_from_plane, contour_px + shift) - flat for shift in ([1.0, 0.0], [0.0, 1.0])]
    pixel = errors.pixel_px * np.max([np.linalg.norm(moved, axis=1) for moved in shifted], axis=0)
    ahead = on_support(frame, world_from_plane, np.array([[frame.camera.cx_px, frame.camera.cy_px]]))[0]
    focal = errors.focal * np.linalg.norm(flat - ahead, axis=1)
    turn = errors.pitch_rad * (aside_m**2 + height_m**2) / height_m
    height = errors.height_m * aside_m / height_m
    return np.asarray(np.sqrt(pixel**2 + focal**2 + turn**2 + height**2), dtype=np.float64)
