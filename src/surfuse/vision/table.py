"""Where in a picture things that stand on the ring table have their foot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.poses import inverse, transform_points
from surfuse.records import CameraFrame, FloatArray
from surfuse.vision.rays import pixels_of, world_rays


@dataclass(frozen=True)
class TableRing:
    """The ring table around the world's z axis: height of its top, inner and outer radius, in metres."""

    height_m: float = 1.0
    inner_radius_m: float = 0.95
    outer_radius_m: float = 1.25

    def __post_init__(self) -> None:
        if not 0.0 <= self.inner_radius_m < self.outer_radius_m or not math.isfinite(self.height_m):
            raise ConfigError(
                f"table of radii {self.inner_radius_m} and {self.outer_radius_m} m at {self.height_m} m",
                cure="give a finite height and 0 <= inner < outer radius",
            )


def foot_rows(frame: CameraFrame, pixel: FloatArray, table: TableRing) -> tuple[float, float] | None:
    """Rows of the far and of the near edge of the table top above or below a pixel (2,), far one first.

    None where the table cannot be seen in that direction.
    """
    eye = frame.world_from_camera[:3, 3]
    ray = world_rays(frame.camera, frame.world_from_camera, pixel[None, :])[0]
    level = math.hypot(ray[0], ray[1])
    if level < 1e-6:
        return None
    heading = ray[:2] / level
    # |eye + t heading| = radius has its outer solution at t = -b + sqrt(b^2 - c).
    b = float(eye[:2] @ heading)
    points = []
    for radius in (table.outer_radius_m, table.inner_radius_m):
        root = b * b - float(eye[:2] @ eye[:2]) + radius * radius
        ahead = -b + math.sqrt(root) if root > 0.0 else -1.0
        if ahead <= 0.0:
            return None
        points.append([*(eye[:2] + ahead * heading), table.height_m])
    seen = transform_points(inverse(frame.world_from_camera), np.array(points))
    if np.any(seen[:, 2] <= 0.0):
        return None
    far, near = pixels_of(frame.camera, seen)[:, 1]
    return float(min(far, near)), float(max(far, near))
