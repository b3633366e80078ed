"""The pinhole: pixels to rays and points to pixels, lens distortion included."""

from __future__ import annotations

import cv2
import numpy as np

from surfuse.geometry.poses import rotate_vectors
from surfuse.records import CameraModel, FloatArray


def camera_rays(camera: CameraModel, pixels: FloatArray) -> FloatArray:
    """Rays (N, 3) with z = 1 in the camera frame through pixels (N, 2), distortion undone (OpenCV's model)."""
    points = np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
    if not any(camera.distortion):
        flat = np.asarray((points.reshape(-1, 2) - [camera.cx_px, camera.cy_px]) / [camera.fx_px, camera.fy_px])
    else:
        undone = cv2.undistortPoints(points, camera.matrix, np.array(camera.distortion))
        flat = np.asarray(undone, dtype=np.float64).reshape(-1, 2)
    return np.column_stack([flat, np.ones(len(flat))])


def world_rays(camera: CameraModel, world_from_camera: FloatArray, pixels: FloatArray) -> FloatArray:
    """Rays (N, 3) in the world frame, scaled to one metre along the optical axis.

    `world_from_camera` (4, 4); `pixels` (N, 2) are x, y, lens distortion is taken out. They are directions: the
    camera's place is not part of them.
    """
    return rotate_vectors(world_from_camera, camera_rays(camera, pixels))


def pixels_of(camera: CameraModel, points_m: FloatArray) -> FloatArray:
    """Pixels (N, 2) of points (N, 3) in the camera frame, all in front of the camera."""
    points = np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 1, 3)
    pixels, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion))
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
