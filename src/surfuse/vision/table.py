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


def edge_rows(frame: CameraFrame, pixels: FloatArray, table: TableRing) -> FloatArray:
    """Rows (N, 2) of the far and of the near edge of the table top above or below pixels (N, 2), far one first.

    nan where the table cannot be seen in that direction.
    """
    eye = frame.world_from_camera[:3, 3]
    rays = world_rays(frame.camera, frame.world_from_camera, pixels)
    level = np.hypot(rays[:, 0], rays[:, 1])
    heading = rays[:, :2] / np.where(level < 1e-6, np.nan, level)[:, None]
    # |eye + t heading| = radius has its outer solution at t = -b + sqrt(b^2 - c).
    b = heading @ eye[:2]
    rows = np.empty((len(pixels), 2))
    for edge, radius in enumerate((table.outer_radius_m, table.inner_radius_m)):
        root = b * b - float(eye[:2] @ eye[:2]) + radius * radius
        ahead = -b + np.sqrt(np.where(root > 0.0, root, np.nan))
        there = np.column_stack([eye[:2] + ahead[:, None] * heading, np.full(len(pixels), table.height_m)])
        seen = transform_points(inverse(frame.world_from_camera), there)
        visible = (ahead > 0.0) & (seen[:, 2] > 0.0)
        rows[:, edge] = np.where(visible, pixels_of(frame.camera, np.where(visible[:, None], seen, 1.0))[:, 1], np.nan)
    rows[np.isnan(rows).any(axis=1)] = np.nan
    return np.sort(rows, axis=1)


def foot_rows(frame: CameraFrame, pixel: FloatArray, table: TableRing) -> tuple[float, float] | None:
    """Rows of the far and of the near edge of the table top above or below a pixel (2,); None where it is not seen."""
    far, near = edge_rows(frame, pixel[None, :], table)[0].tolist()
    return None if math.isnan(far) else (far, near)
