"""How far the vertical plane of a part is from the camera.

Two things know how far that plane is: the shoulder ranger, and the foot of the part, because the height of the table
is known without error (paper, section 3.2). Both are combined by their variances.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError, DataError
from surfuse.records import CameraFrame, FloatArray, IntArray
from surfuse.vision.plane import on_plane, viewing_direction
from surfuse.vision.table_contact import cut_below, foot_points

_DEPRESSION_MIN = 1e-3


@dataclass(frozen=True)
class ProjectionSigmas:
    """Standard deviations of what the projection rests on.

    Parameters
    ----------
    pixel_px : position of a boundary point in the picture.
    focal : relative error of the focal lengths.
    pitch_rad : error of the camera's tilt about its horizontal axis.
    height_m : error of the camera's height over the table.
    range_share : error of the shoulder range relative to the range, beside the ranger's own.
    relief_m : spread of the silhouette's points in front of and behind the plane.
    """

    pixel_px: float = 0.3
    focal: float = 0.002
    pitch_rad: float = 0.002
    height_m: float = 0.001
    range_share: float = 0.005
    relief_m: float = 0.010

    def __post_init__(self) -> None:
        for name in ("pixel_px", "focal", "pitch_rad", "height_m", "range_share", "relief_m"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ConfigError(f"projection {name} = {value}", cure="give a standard deviation >= 0")


@dataclass(frozen=True)
class ShoulderRange:
    """One range of the shoulder ranger: from where (3,), along which unit axis (3,), how far, and how certain.

    A range that is not finite (no echo, too close, faulty) says nothing about the distance.

    `position_m` in m and `axis` are in the world; `range_m` and `sigma_m` in m.
    """

    position_m: FloatArray
    axis: FloatArray
    range_m: float
    sigma_m: float


@dataclass(frozen=True)
class Distance:
    """Distance of the part's plane from the camera, along the horizontal viewing direction.

    `range_m` and `foot_m` are what ranger and foot say alone (nan: nothing), each with its standard deviation;
    `distance_m` and `sigma_m` combine them. When they contradict each other, sigma is larger than either's.
    `relief_m` is the spread of the silhouette's points around the plane: what is assumed, and what a slanted foot
    shows.
    """

    distance_m: float
    sigma_m: float
    range_m: float
    range_sigma_m: float
    foot_m: float
    foot_sigma_m: float
    relief_m: float

    @property
    def disagreement(self) -> float:
        """Difference of range and foot in standard deviations; nan where one of them is missing."""
        return abs(self.range_m - self.foot_m) / math.hypot(self.range_sigma_m, self.foot_sigma_m)


def measure_distance(
    frame: CameraFrame,
    contour_px: FloatArray,
    vertices: IntArray,
    table_height_m: float,
    shoulder: ShoulderRange | None,
    sigmas: ProjectionSigmas | None = None,
) -> Distance:
    """Distance of the vertical plane of a contour (N, 2) px with dominant points `vertices` (K,), from range and foot.

    Raises
    ------
    DataError : the camera looks straight up or down, or neither range nor foot says anything.
    """
    errors = sigmas or ProjectionSigmas()
    ranged, range_sigma = _from_range(frame, shoulder, errors)
    foot, foot_sigma, slant = _from_foot(frame, contour_px, vertices, table_height_m, errors)
    known = [(d, s) for d, s in ((ranged, range_sigma), (foot, foot_sigma)) if math.isfinite(d) and d > 0.0]
    if not known:
        raise DataError(
            "the distance of the part is unknown: no valid shoulder range, and its foot is not below the camera",
            cure="check the shoulder ranger, or mount the camera higher above the table",
        )
    weight = np.array([1.0 / s**2 for _, s in known])
    values = np.array([d for d, _ in known])
    mean = float(weight @ values / weight.sum())
    # Birge's ratio: a contradiction widens the result instead of being averaged away.
    scatter = float(weight @ (values - mean) ** 2)
    sigma = math.sqrt(max(1.0, scatter) / float(weight.sum()))
    return Distance(mean, sigma, ranged, range_sigma, foot, foot_sigma, math.hypot(errors.relief_m, slant))


def _from_range(frame: CameraFrame, shoulder: ShoulderRange | None, errors: ProjectionSigmas) -> tuple[float, float]:
    """Distance along the viewing direction of the point that the ranger sees, and its standard deviation."""
    if shoulder is None or not math.isfinite(shoulder.range_m):
        return math.nan, math.nan
    there = shoulder.position_m + shoulder.range_m * shoulder.axis
    distance = float((there - frame.world_from_camera[:3, 3]) @ viewing_direction(frame))
    return distance, math.hypot(shoulder.sigma_m, errors.range_share * shoulder.range_m, errors.relief_m)


def _from_foot(
    frame: CameraFrame, contour_px: FloatArray, vertices: IntArray, table_height_m: float, errors: ProjectionSigmas
) -> tuple[float, float, float]:
    """Distance at which the lowest rays of a contour meet the table's height, its standard deviation, and the slant.

    d = h / tan(depression), so an error of e rad in the depression makes e (d^2 + h^2) / h. The slant is the standard
    deviation of the distance along the foot beyond what pixels explain.
    """
    height = float(frame.world_from_camera[2, 3]) - table_height_m
    if cut_below(frame.camera, contour_px):
        return math.nan, math.nan, 0.0
    foot = foot_points(frame.camera, contour_px, vertices)
    falls = -on_plane(frame, contour_px[foot], viewing_direction(frame))[:, 1]
    if falls.min() < _DEPRESSION_MIN or height <= 0.0:
        return math.nan, math.nan, 0.0
    distances = height / falls
    distance = float(distances.mean())
    fall = height / distance
    per_rad = (distance**2 + height**2) / height
    pixel = errors.pixel_px / frame.camera.fy_px
    angle = math.hypot(errors.pitch_rad, pixel, errors.focal * fall)
    slant = math.sqrt(max(float(distances.var()) - (pixel * per_rad) ** 2, 0.0))
    return distance, math.hypot(angle * per_rad, errors.height_m / fall), slant
