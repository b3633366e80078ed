"""Where a camera sits on the tool, or fixed in the world, from views of a board at known poses of the tool.

On the tool the board stands still in the world; a fixed camera sees the board on the tool. With the inverse poses the
second is the first. Start: F. Park, B. Martin, Robot sensor calibration: solving AX = XB on the Euclidean group, IEEE
Trans. Robotics and Automation 10, 1994; then least squares over all corners.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares

from surfuse.errors import DataError
from surfuse.geometry.poses import inverse, pose, transform_points
from surfuse.records import CameraModel, FloatArray
from surfuse.vision.calibration_target import Target, TargetView, camera_from_target
from surfuse.vision.rays import pixels_of


@dataclass(frozen=True)
class HandEyeParameters:
    """What a set of views must offer.

    Parameters
    ----------
    views_min : least number of views of the target.
    turn_min_rad : least turn of the tool between views, about each of two axes.
    reprojection_max_px : largest root mean square distance of corners from where the result puts them.
    position_sigma_max_m : largest standard deviation of the camera's place.
    """

    views_min: int = 5
    turn_min_rad: float = math.radians(10.0)
    reprojection_max_px: float = 2.0
    position_sigma_max_m: float = 0.01


@dataclass(frozen=True)
class HandEye:
    """Pose (4, 4) of the camera in the frame that carries it, of the target in the other one, and how certain.

    `carrier_from_camera` is `tool_from_camera`, or `world_from_camera` of a fixed one. `other_from_target` is
    `world_from_target`, or `tool_from_target`. `sigma` (6,): place along x, y, z (m), turn about them (rad).
    """

    carrier_from_camera: FloatArray
    other_from_target: FloatArray
    sigma: FloatArray
    reprojection_px: float
    per_view_px: tuple[float, ...]


def calibrate_hand_eye(
    camera: CameraModel,
    target: Target,
    views: tuple[TargetView, ...],
    world_from_tool: FloatArray,
    fixed: bool = False,
    parameters: HandEyeParameters | None = None,
) -> HandEye:
    """Pose of the camera from views at poses (V, 4, 4) of the tool; `fixed`: the board is on the tool.

    Raises
    ------
    DataError : too few views, turns about one axis only, or a result that does not fit or is too uncertain.
    """
    chosen = parameters or HandEyeParameters()
    carriers = inverse(world_from_tool) if fixed else world_from_tool
    _check_views(len(views), carriers, chosen)
    seen = np.array([camera_from_target(camera, target, view) for view in views])
    start = _closed_form(carriers, seen)
    board = carriers[0] @ start @ seen[0]

    def misses(x: FloatArray) -> FloatArray:
        eye, there = _moved(start, x[:6]), _moved(board, x[6:])
        parts = []
        for carrier, view in zip(carriers, views, strict=True):
            points = transform_points(inverse(carrier @ eye) @ there, target.points()[view.numbers])
            parts.append(pixels_of(camera, points) - view.corners_px)
        return np.concatenate(parts).ravel()

    fit = least_squares(misses, np.zeros(12), x_scale="jac")
    residual, x = np.asarray(fit.fun, dtype=np.float64), np.asarray(fit.x, dtype=np.float64)
    variance = float(residual @ residual) / max(len(residual) - 12, 1)
    covariance = variance * np.linalg.pinv(np.asarray(fit.jac).T @ np.asarray(fit.jac))
    ends = np.cumsum([2 * len(view.numbers) for view in views])[:-1]
    result = HandEye(
        carrier_from_camera=_moved(start, x[:6]),
        other_from_target=_moved(board, x[6:]),
        sigma=np.sqrt(np.diag(covariance)[:6]),
        reprojection_px=_rms_px(residual),
        per_view_px=tuple(_rms_px(part) for part in np.split(residual, ends)),
    )
    _check_result(result, views, chosen)
    return result


def _check_views(count: int, carriers: FloatArray, chosen: HandEyeParameters) -> None:
    if count < chosen.views_min:
        raise DataError(
            f"the target is found in {count} pictures, at least {chosen.views_min} are needed",
            cure="add pictures of the whole board at other poses of the tool",
        )
    turns = np.array([np.ravel(cv2.Rodrigues(carriers[0, :3, :3].T @ one[:3, :3])[0]) for one in carriers])
    second = float(np.linalg.svd(turns, compute_uv=False)[1]) / math.sqrt(count)
    if second < 0.5 * chosen.turn_min_rad:
        raise DataError(
            "the tool turns about one axis only between the views, or hardly at all "
            f"({math.degrees(2.0 * second):.1f} degrees about a second one, wanted "
            f"{math.degrees(chosen.turn_min_rad):.0f}): that leaves the camera's place open",
            cure="tilt the tool to the left and right as well as to the front and back, the board in view",
        )


def _check_result(result: HandEye, views: tuple[TargetView, ...], chosen: HandEyeParameters) -> None:
    if not result.reprojection_px <= chosen.reprojection_max_px:
        worst = int(np.argmax(result.per_view_px))
        raise DataError(
            f"the corners are {result.reprojection_px:.2f} px from where the result puts them (limit "
            f"{chosen.reprojection_max_px:g}), worst {views[worst].name} with {result.per_view_px[worst]:.2f} px",
            cure="check that each pose belongs to its picture, is world_from_tool in metres, and that the board is "
            "on the tool for a fixed camera, and stands still for one on the tool",
        )
    place = float(result.sigma[:3].max())
    if place > chosen.position_sigma_max_m:
        raise DataError(
            f"the views leave the camera's place uncertain by {1e3 * place:.0f} mm (limit "
            f"{1e3 * chosen.position_sigma_max_m:g} mm)",
            cure="use a larger or nearer board, more views, and larger turns",
        )


def _closed_form(carriers: FloatArray, seen: FloatArray) -> FloatArray:
    """First estimate X of the camera in the frame that carries it, from both chains of poses (V, 4, 4).

    For two views A X = X B: the rotation vectors of A are those of B turned by X, which the best rotation between two
    sets of vectors finds; then (A - I) t = X b - a.
    """
    first, second = np.triu_indices(len(carriers), 1)
    moved = inverse(carriers[second]) @ carriers[first]
    turned = seen[second] @ inverse(seen[first])
    vectors = [np.array([np.ravel(cv2.Rodrigues(one[:3, :3])[0]) for one in poses]) for poses in (moved, turned)]
    left, _, right = np.linalg.svd(vectors[0].T @ vectors[1])
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    rows = (moved[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    sides = (turned[:, :3, 3] @ rotation.T - moved[:, :3, 3]).ravel()
    return pose(rotation, np.linalg.lstsq(rows, sides, rcond=None)[0])


def _moved(start: FloatArray, by: FloatArray) -> FloatArray:
    """A pose (4, 4) shifted by (3,) m and turned by a rotation vector (3,)."""
    return pose(np.asarray(cv2.Rodrigues(by[3:])[0]) @ start[:3, :3], start[:3, 3] + by[:3])


def _rms_px(residual: FloatArray) -> float:
    return float(np.sqrt(2.0 * np.mean(residual**2)))
