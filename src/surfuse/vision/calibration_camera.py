"""The camera model from views of a target, with what the views can and cannot determine.

Z. Zhang, A flexible new technique for camera calibration, IEEE Trans. PAMI-22, 2000, as OpenCV has it; standard
deviations from the inverse normal equations and the residuals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

import cv2
import numpy as np

from surfuse.errors import ConfigError, DataError, nearest
from surfuse.records import CameraModel, FloatArray
from surfuse.vision.calibration_target import NotSeen, Target, TargetView

Lens = Literal["none", "radial", "usual", "full"]
LENSES: tuple[Lens, ...] = get_args(Lens)
# Of some hundred coordinates: a ratio of 1.5 between two fits is no accident.
_MIRROR_RATIO = 1.5
_MIRROR_FLOOR_PX = 0.03
_FIXED: dict[Lens, int] = {
    "none": cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST,
    "radial": cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST,
    "usual": cv2.CALIB_FIX_K3,
    "full": 0,
}


@dataclass(frozen=True)
class CalibrationParameters:
    """What a set of views must offer.

    Parameters
    ----------
    lens : distortion to fit: `none`; `radial` k1, k2; `usual` k1, k2, p1, p2; `full` with k3.
    views_min : least number of usable, different views.
    edge_share_max : widest edges of a sharp view, as a share of the picture's width.
    edge_ratio_max : widest edges of a view relative to the median of the set.
    same_px : views whose corners all agree within this are one view.
    tilt_min_rad : least angle between the boards of some two views; parallel boards do not show the focal length.
    reprojection_max_px : largest root mean square distance of corners from where the model puts them.
    focal_sigma_max : largest standard deviation of the focal lengths relative to them.
    centre_sigma_max : largest standard deviation of the principal point as a share of the picture's size.
    """

    lens: Lens = "usual"
    views_min: int = 5
    edge_share_max: float = 0.012
    edge_ratio_max: float = 2.5
    same_px: float = 1.0
    tilt_min_rad: float = math.radians(15.0)
    reprojection_max_px: float = 1.0
    focal_sigma_max: float = 0.01
    centre_sigma_max: float = 0.01

    def __post_init__(self) -> None:
        if self.lens not in LENSES:
            raise ConfigError(f"unknown lens model '{self.lens}'", cure=nearest(self.lens, LENSES))
        if self.views_min < 3:
            raise ConfigError(f"views_min = {self.views_min}", cure="give at least 3")


@dataclass(frozen=True)
class CameraCalibration:
    """The camera, the standard deviations of its parameters, and how well the views fit.

    `sigma` has the camera's fields as standard deviations; 0 is held fixed. `coverage` is the share of the picture
    inside the hulls of the views. `per_view_px` belongs to `used`.
    """

    camera: CameraModel
    sigma: CameraModel
    reprojection_px: float
    coverage: float
    tilt_rad: float
    used: tuple[str, ...]
    per_view_px: tuple[float, ...]
    left_out: tuple[NotSeen, ...]


def calibrate_camera(
    target: Target,
    seen: tuple[TargetView | NotSeen, ...],
    size_px: tuple[int, int],
    parameters: CalibrationParameters | None = None,
) -> CameraCalibration:
    """Fit the camera (width, height px) to views of a target.

    Blurred and repeated views are left out, each with its reason.

    Raises
    ------
    DataError : too few views remain, all boards are parallel, or the fit or a standard deviation is too poor.
    """
    chosen = parameters or CalibrationParameters()
    views, left_out = usable_views(seen, size_px[0], chosen)
    if len(views) < chosen.views_min:
        raise DataError(
            f"{len(views)} usable views, at least {chosen.views_min} are needed{_reasons(left_out)}",
            cure="add sharp pictures of the whole board, each from another place and turned another way",
        )
    points = target.points().astype(np.float32)
    solution = cv2.calibrateCameraExtended(
        [points[view.numbers] for view in views],
        [view.corners_px.astype(np.float32).reshape(-1, 1, 2) for view in views],
        size_px,
        np.eye(3),
        np.zeros(5),
        flags=_FIXED[chosen.lens],
    )
    rms, matrix, distortion, rotations, _, sigma, _, per_view = solution
    camera = _model(
        size_px, np.asarray(matrix, np.float64)[[0, 1, 0, 1], [0, 1, 2, 2]], np.asarray(distortion, np.float64).ravel()
    )
    spread = np.asarray(sigma, dtype=np.float64).ravel()
    result = CameraCalibration(
        camera=camera,
        sigma=_model(size_px, spread[:4], spread[4:9]),
        reprojection_px=float(rms),
        coverage=coverage(views, size_px),
        tilt_rad=_largest_tilt([np.asarray(rotation, dtype=np.float64) for rotation in rotations]),
        used=tuple(view.name for view in views),
        per_view_px=tuple(float(value) for value in np.ravel(per_view)),
        left_out=left_out,
    )
    _check(result, chosen)
    _check_mirrored(result, target, views)
    return result


def usable_views(
    seen: tuple[TargetView | NotSeen, ...], width_px: int, chosen: CalibrationParameters
) -> tuple[tuple[TargetView, ...], tuple[NotSeen, ...]]:
    """Views that are sharp and different from each other, and all others with the reason."""
    found = [view for view in seen if isinstance(view, TargetView)]
    left_out = [view for view in seen if isinstance(view, NotSeen)]
    usual = float(np.median([view.edge_px for view in found])) if found else 0.0
    kept: list[TargetView] = []
    for view in found:
        limit = min(chosen.edge_share_max * width_px, max(chosen.edge_ratio_max * usual, 3.0))
        twin = next((other.name for other in kept if _same(view, other, chosen.same_px)), None)
        if view.edge_px > limit:
            left_out.append(NotSeen(view.name, f"blurred: edges {view.edge_px:.1f} px wide, limit {limit:.1f}"))
        elif twin is not None:
            left_out.append(NotSeen(view.name, f"the same view as {twin}"))
        else:
            kept.append(view)
    return tuple(kept), tuple(left_out)


def coverage(views: tuple[TargetView, ...], size_px: tuple[int, int]) -> float:
    """Share of the picture inside the convex hulls of the views' corners."""
    canvas = np.zeros(size_px[::-1], np.uint8)
    for view in views:
        cv2.fillConvexPoly(canvas, cv2.convexHull(np.rint(view.corners_px).astype(np.int32)), 1)
    return float(canvas.mean())


def _same(view: TargetView, other: TargetView, same_px: float) -> bool:
    if not np.array_equal(view.numbers, other.numbers):
        return False
    return bool(np.abs(view.corners_px - other.corners_px).max() <= same_px)


def _model(size_px: tuple[int, int], pinhole: FloatArray, distortion: FloatArray) -> CameraModel:
    k = np.zeros(5)
    k[: min(len(distortion), 5)] = distortion[:5]
    fx, fy, cx, cy = (float(value) for value in pinhole)
    lens = (float(k[0]), float(k[1]), float(k[2]), float(k[3]), float(k[4]))
    return CameraModel(size_px[0], size_px[1], fx, fy, cx, cy, lens)


def _largest_tilt(rotations: list[FloatArray]) -> float:
    """Largest angle between the normals of two boards."""
    normals = np.array([np.asarray(cv2.Rodrigues(rotation)[0])[:, 2] for rotation in rotations])
    return float(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)).max())


def _reasons(left_out: tuple[NotSeen, ...]) -> str:
    if not left_out:
        return ""
    shown = ", ".join(f"{view.name}: {view.reason}" for view in left_out[:3])
    return f" ({shown}{f', and {len(left_out) - 3} more' if len(left_out) > 3 else ''})"


def _check(result: CameraCalibration, chosen: CalibrationParameters) -> None:
    camera, sigma = result.camera, result.sigma
    if not all(math.isfinite(value) for value in (camera.fx_px, camera.fy_px, sigma.fx_px, result.reprojection_px)):
        raise DataError("the fit did not converge", cure="take the pictures again, with the board turned in each")
    if result.reprojection_px > chosen.reprojection_max_px:
        worst = int(np.argmax(result.per_view_px))
        raise DataError(
            f"the corners are {result.reprojection_px:.2f} px from where one camera would see them (limit "
            f"{chosen.reprojection_max_px:g}), worst {result.used[worst]} with {result.per_view_px[worst]:.2f} px",
            cure="check that the board is flat and that all pictures are of one camera; remove the worst one",
        )
    if result.tilt_rad < chosen.tilt_min_rad:
        raise DataError(
            f"all boards are parallel within {math.degrees(result.tilt_rad):.1f} degrees, which does not show the "
            "focal length",
            cure=f"tilt the board, by {math.degrees(chosen.tilt_min_rad):.0f} degrees or more, in both directions",
        )
    focal = max(sigma.fx_px / camera.fx_px, sigma.fy_px / camera.fy_px)
    centre = max(sigma.cx_px / camera.width_px, sigma.cy_px / camera.height_px)
    for name, value, limit in (
        ("focal length", focal, chosen.focal_sigma_max),
        ("principal point", centre, chosen.centre_sigma_max),
    ):
        if value > limit:
            raise DataError(
                f"the views leave the {name} uncertain by {100.0 * value:.1f} % (limit {100.0 * limit:g} %)",
                cure="add views that fill the picture and are tilted more",
            )


def _check_mirrored(result: CameraCalibration, target: Target, views: tuple[TargetView, ...]) -> None:
    """Refuse a view that fits this camera far better when it is mirrored.

    A checkerboard is its own mirror image, so a mirrored view shows only in a lens or a principal point that is not
    symmetric; a set of which all views are mirrored cannot be told from a set of the mirrored camera.
    """
    camera = result.camera
    for view, error in zip(views, result.per_view_px, strict=True):
        flipped = replace(view, corners_px=np.column_stack([camera.width_px - 1.0 - view.corners_px[:, 0],
                                                            view.corners_px[:, 1]]))  # fmt: skip
        if error > _MIRROR_RATIO * max(view_error(camera, target, flipped), _MIRROR_FLOOR_PX):
            raise DataError(
                f"the picture {view.name} seems to be mirrored", cure="take the pictures without a mirror, unflipped"
            )


def view_error(camera: CameraModel, target: Target, view: TargetView) -> float:
    """Root mean square distance in pixels of a view's corners from those of the best pose of the target."""
    points = target.points()[view.numbers]
    lens = np.array(camera.distortion)
    done, turn, place = cv2.solvePnP(points, view.corners_px, camera.matrix, lens, flags=cv2.SOLVEPNP_ITERATIVE)
    if not done:
        return math.inf
    seen, _ = cv2.projectPoints(points, turn, place, camera.matrix, lens)
    return float(np.sqrt(np.mean(np.sum((seen.reshape(-1, 2) - view.corners_px) ** 2, axis=1))))
