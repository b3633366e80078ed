"""What the camera sees and what is found in it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from surfuse.errors import DataError
from surfuse.records.checks import ByteArray, FloatArray, own, own_pose, owned


@dataclass(frozen=True)
class CameraModel:
    """Pinhole with non-square pixels and lens distortion (OpenCV's k1, k2, p1, p2, k3)."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def matrix(self) -> FloatArray:
        """Camera matrix (3, 3)."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class CameraFrame:
    """One grey picture (H, W) uint8 with the pose of the camera that took it."""

    image: ByteArray
    t_s: float
    camera: CameraModel
    world_from_camera: FloatArray

    def __post_init__(self) -> None:
        own(self, np.uint8, image=(self.camera.height_px, self.camera.width_px))
        own_pose(self, "world_from_camera")


@dataclass(frozen=True)
class Detection:
    """A part as the camera sees it: its boundary (N, 2) x, y in pixels of the picture, pixel centres at whole numbers.

    `holes_px` are the boundaries of its holes; `centroid_px` (2,) and `area_px` belong to its pixels without holes;
    `touches_border` says that the picture may cut it; `level` is the grey level that divided the picture, and
    `separability` in [0, 1] how clearly; `confidence` in [0, 1] is the share of the boundary that is a real edge.
    """

    contour_px: FloatArray
    centroid_px: FloatArray
    area_px: float
    touches_border: bool
    level: int
    separability: float
    confidence: float
    holes_px: tuple[FloatArray, ...] = ()

    def __post_init__(self) -> None:
        own(self, np.float64, contour_px=(None, 2), centroid_px=(2,))
        if len(self.contour_px) < 3:
            raise DataError(f"a detection needs at least 3 contour points, this one has {len(self.contour_px)}")
        holes = tuple(
            np.asarray(owned(hole, np.float64, "Detection.holes_px", (None, 2)), dtype=np.float64)
            for hole in self.holes_px
        )
        object.__setattr__(self, "holes_px", holes)


@dataclass(frozen=True)
class Outline:
    """The part's boundary as dominant points in the part frame: (N, 2) u, v in m, counter-clockwise, not repeated.

    `sigma_m` (N,) is the standard deviation of each vertex (0: unknown); `margin_m` says how far it was enlarged.
    `viewpoint_m` (3,) is where the camera was, in the part frame: a point off the plane w = 0 belongs to the part when
    it is seen inside the outline from there (None: seen along w).
    """

    vertices_m: FloatArray
    world_from_part: FloatArray
    margin_m: float = 0.0
    sigma_m: FloatArray = field(default_factory=lambda: np.zeros(0))
    holes_m: tuple[FloatArray, ...] = ()
    viewpoint_m: FloatArray | None = None

    def __post_init__(self) -> None:
        own(self, np.float64, vertices_m=(None, 2))
        if self.viewpoint_m is not None:
            own(self, np.float64, viewpoint_m=(3,))
        if len(self.vertices_m) < 3:
            raise DataError(f"an outline needs at least 3 vertices, this one has {len(self.vertices_m)}")
        if not np.all(np.isfinite(self.vertices_m)):
            raise DataError("an outline must have finite vertices")
        sigma = self.sigma_m if np.size(self.sigma_m) else np.zeros(len(self.vertices_m))
        object.__setattr__(self, "sigma_m", sigma)
        own(self, np.float64, sigma_m=(len(self.vertices_m),))
        own_pose(self, "world_from_part")
        holes = tuple(
            np.asarray(owned(hole, np.float64, "Outline.holes_m", (None, 2)), dtype=np.float64) for hole in self.holes_m
        )
        object.__setattr__(self, "holes_m", holes)
