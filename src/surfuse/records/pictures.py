"""What the camera sees and what is found in it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from surfuse.errors import DataError
from surfuse.records.checks import ByteArray, FloatArray, check_finite, check_least, check_number, own, own_pose, owned
from surfuse.records.columns import ArrayRecord


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

    def __post_init__(self) -> None:
        far = float("inf")
        for name in ("width_px", "height_px"):
            check_number(f"CameraModel.{name}", getattr(self, name), 1.0, 1e5)
        for name in ("fx_px", "fy_px"):
            check_number(f"CameraModel.{name}", getattr(self, name), 0.0, far, above=True)
        for name in ("cx_px", "cy_px"):
            check_number(f"CameraModel.{name}", getattr(self, name), -far, far)
        if len(self.distortion) != 5 or not np.all(np.isfinite(self.distortion)):
            raise DataError(f"CameraModel.distortion = {self.distortion}", cure="give k1, k2, p1, p2, k3, finite")

    @property
    def matrix(self) -> FloatArray:
        """Camera matrix (3, 3)."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class CameraFrame(ArrayRecord):
    """One grey picture (H, W) uint8 with the pose of the camera that took it."""

    image: ByteArray
    t_s: float
    camera: CameraModel
    world_from_camera: FloatArray

    def __post_init__(self) -> None:
        own(self, np.uint8, image=(self.camera.height_px, self.camera.width_px))
        own_pose(self, "world_from_camera")


@dataclass(frozen=True, eq=False)
class Detection(ArrayRecord):
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
            raise DataError(
                f"a detection needs at least 3 contour points, this one has {len(self.contour_px)}",
                cure="leave it out: it is no area",
            )
        check_finite(self.contour_px, "Detection.contour_px")
        check_least(np.array([self.area_px]), "Detection.area_px", 0.0)
        check_number("Detection.confidence", self.confidence, 0.0, 1.0)
        object.__setattr__(self, "holes_px", _rings(self.holes_px, "Detection.holes_px"))


def _rings(rings: tuple[FloatArray, ...], name: str) -> tuple[FloatArray, ...]:
    """Owned boundaries (N, 2) of at least 3 finite points each."""
    kept = tuple(np.asarray(owned(ring, np.float64, name, (None, 2)), dtype=np.float64) for ring in rings)
    for k, ring in enumerate(kept):
        check_finite(ring, f"{name}[{k}]")
        if len(ring) < 3:
            raise DataError(f"{name}[{k}] has {len(ring)} points", cure="give at least 3, or leave the hole out")
    return kept


@dataclass(frozen=True, eq=False)
class Outline(ArrayRecord):
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
            check_finite(self.viewpoint_m, "Outline.viewpoint_m")
        if len(self.vertices_m) < 3:
            raise DataError(
                f"an outline needs at least 3 vertices, this one has {len(self.vertices_m)}",
                cure="give the boundary of an area, or leave the outline out",
            )
        check_finite(self.vertices_m, "Outline.vertices_m")
        check_number("Outline.margin_m", self.margin_m, 0.0, float("inf"))
        sigma = self.sigma_m if np.size(self.sigma_m) else np.zeros(len(self.vertices_m))
        object.__setattr__(self, "sigma_m", sigma)
        own(self, np.float64, sigma_m=(len(self.vertices_m),))
        check_finite(self.sigma_m, "Outline.sigma_m")
        check_least(self.sigma_m, "Outline.sigma_m", 0.0)
        own_pose(self, "world_from_part")
        object.__setattr__(self, "holes_m", _rings(self.holes_m, "Outline.holes_m"))
