"""The vertical plane in front of the camera on which the outline of a part lies."""

from __future__ import annotations

import math

import numpy as np

from surfuse.errors import DataError
from surfuse.records import CameraFrame, FloatArray
from surfuse.vision.rays import world_rays


def viewing_direction(frame: CameraFrame) -> FloatArray:
    """Unit horizontal direction (3,) in which the camera looks.

    In the world; the optical axis, laid into the horizontal.

    Raises
    ------
    DataError : the camera looks straight up or down.
    """
    axis = frame.world_from_camera[:3, 2]
    level = math.hypot(axis[0], axis[1])
    if level < 0.1:
        raise DataError("the camera looks straight up or down", cure="give a camera that looks at the table's side")
    return np.array([axis[0] / level, axis[1] / level, 0.0])


def on_plane(frame: CameraFrame, pixels: FloatArray, forward: FloatArray) -> FloatArray:
    """Where rays (N, 2 px) meet the plane one metre ahead: right and up (N, 2) from the point straight ahead.

    In units of the distance, which is one metre here; `forward` (3,) is the unit direction ahead, in the world.

    Raises
    ------
    DataError : a ray does not reach the plane.
    """
    rays = world_rays(frame.camera, frame.world_from_camera, pixels)
    ahead = rays @ forward
    if np.any(ahead <= 1e-6):
        raise DataError("a boundary point is not in front of the camera", cure="check the camera's pose")
    return np.column_stack([rays @ rightwards(forward), rays[:, 2]]) / ahead[:, None]


def rightwards(forward: FloatArray) -> FloatArray:
    """Unit horizontal direction (3,) to the right of a viewing direction: u = v x w, with w back to the camera."""
    return np.array([forward[1], -forward[0], 0.0])
