"""Where the camera sits on the shoulder, from views of one fixed target while joint 1 turns.

The shoulder frame turns with joint 1: origin on the floor, x outwards, z up. The motion between two views is a turn
about the vertical axis; seen from the camera, that axis has a direction and a place. Height and heading it leaves open:
the known place of one corner of the target gives both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares

from surfuse.errors import ConfigError, DataError
from surfuse.geometry.poses import inverse, pose, rotation_about, transform_points
from surfuse.records import CameraModel, FloatArray
from surfuse.vision.calibration_target import Target, TargetView, camera_from_target

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class ShoulderParameters:
    """What a set of views must offer.

    Parameters
    ----------
    views_min : least number of views of the target.
    turn_min_rad : least turn of joint 1 between the first and the last view.
    reprojection_max_px : largest root mean square distance of corners from where the result puts them.
    position_sigma_max_m : largest standard deviation of the camera's place.
    """

    views_min: int = 4
    turn_min_rad: float = math.radians(15.0)
    reprojection_max_px: float = 1.5
    position_sigma_max_m: float = 0.01

    def __post_init__(self) -> None:
        if self.views_min < 3:
            raise ConfigError(f"views_min = {self.views_min}", cure="give at least 3")


@dataclass(frozen=True)
class ShoulderCamera:
    """Pose of the camera in the shoulder frame and of the target in the world, and how certain the former is.

    `sigma` (6,) are standard deviations of the camera's place along the shoulder's x, y, z (m), then of its turn about
    them (rad).

    Both poses are (4, 4). `reprojection_px` is the root mean square over all corners, `per_view_px` (V,) that of each
    picture.
    """

    shoulder_from_camera: FloatArray
    world_from_target: FloatArray
    sigma: FloatArray
    reprojection_px: float
    per_view_px: FloatArray


def calibrate_shoulder_camera(
    camera: CameraModel,
    target: Target,
    views: tuple[TargetView, ...],
    joint1_rad: FloatArray,
    first_corner_m: FloatArray,
    parameters: ShoulderParameters | None = None,
) -> ShoulderCamera:
    """Pose of the camera from views at joint angles (N,); `first_corner_m` (3,) is the target's corner 0 in the world.

    Raises
    ------
    DataError : too few views, too small a turn, or a result that is too uncertain.
    """
    chosen = parameters or ShoulderParameters()
    _check_views(len(views), joint1_rad, chosen)
    seen = np.array([camera_from_target(camera, target, view) for view in views])
    corner = target.points()[0]
    start, board = _closed_form(seen, joint1_rad, corner, first_corner_m)
    turns = np.array([pose(rotation_about(_UP, angle), np.zeros(3)) for angle in joint1_rad])

    def poses(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        shoulder = pose(cv2.Rodrigues(x[3:6])[0] @ start[:3, :3], start[:3, 3] + x[:3])
        turned = np.asarray(cv2.Rodrigues(x[6:9])[0]) @ board[:3, :3]
        return shoulder, pose(turned, first_corner_m - turned @ corner)

    def misses(x: FloatArray) -> FloatArray:
        shoulder, target_pose = poses(x)
        parts = []
        for turn, view in zip(turns, views, strict=True):
            there = transform_points(inverse(turn @ shoulder) @ target_pose, target.points()[view.numbers])
            parts.append(_projected(camera, there) - view.corners_px)
        return np.concatenate(parts).ravel()

    fit = least_squares(misses, np.zeros(9), x_scale="jac")
    residual = np.asarray(fit.fun, dtype=np.float64)
    variance = float(residual @ residual) / max(len(residual) - 9, 1)
    covariance = variance * np.linalg.pinv(np.asarray(fit.jac).T @ np.asarray(fit.jac))
    shoulder, target_pose = poses(np.asarray(fit.x, dtype=np.float64))
    ends = np.cumsum([2 * len(view.numbers) for view in views])[:-1]
    result = ShoulderCamera(
        shoulder_from_camera=shoulder,
        world_from_target=target_pose,
        sigma=np.sqrt(np.diag(covariance)[:6]),
        reprojection_px=_rms_px(residual),
        per_view_px=np.array([_rms_px(part) for part in np.split(residual, ends)]),
    )
    _check_result(result, views, chosen)
    return result


def _check_views(count: int, joint1_rad: FloatArray, chosen: ShoulderParameters) -> None:
    if count < chosen.views_min:
        raise DataError(
            f"the target is found in {count} pictures, at least {chosen.views_min} are needed",
            cure="add pictures of the whole board at other angles of joint 1",
        )
    turn = float(np.ptp(joint1_rad))
    if turn < chosen.turn_min_rad:
        raise DataError(
            f"joint 1 turns by {math.degrees(turn):.1f} degrees between the views, too little to see its axis",
            cure=f"turn it by {math.degrees(chosen.turn_min_rad):.0f} degrees or more, the board still in view",
        )


def _check_result(result: ShoulderCamera, views: tuple[TargetView, ...], chosen: ShoulderParameters) -> None:
    if not result.reprojection_px <= chosen.reprojection_max_px:
        worst = int(np.argmax(result.per_view_px))
        raise DataError(
            f"the corners are {result.reprojection_px:.2f} px from where the result puts them (limit "
            f"{chosen.reprojection_max_px:g}), worst {views[worst].name} with {result.per_view_px[worst]:.2f} px",
            cure="check the joint angles, their sign, and that neither target nor camera moved",
        )
    if result.shoulder_from_camera[2, 1] >= 0.0:
        raise DataError(
            "the camera would hang upside down",
            cure="check the joint angles and their sign: counter-clockwise is positive",
        )
    place = float(result.sigma[:3].max())
    if place > chosen.position_sigma_max_m:
        raise DataError(
            f"the views leave the camera's place uncertain by {1e3 * place:.0f} mm (limit "
            f"{1e3 * chosen.position_sigma_max_m:g} mm)",
            cure="use a larger or nearer board, and a larger turn",
        )


def _closed_form(
    seen: FloatArray, joint1_rad: FloatArray, corner: FloatArray, first_corner_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """First estimate of camera and target from the target's poses (N, 4, 4) in the camera.

    Turning by a moves the target in the camera by a turn of -a about the arm's axis: direction from the rotations,
    place from the translations, (I - R) p = t.
    """
    order = np.argsort(joint1_rad)
    first = int(order[0])
    axes, rows, sides = [], [], []
    for other in order[1:].tolist():
        moved = seen[first] @ inverse(seen[other])
        turn = np.ravel(cv2.Rodrigues(moved[:3, :3])[0])
        # In the camera's frame the vertical is the axis by which later views must be turned to the first one.
        axes.append(turn * np.sign(joint1_rad[other] - joint1_rad[first]))
        rows.append(np.eye(3) - moved[:3, :3])
        sides.append(moved[:3, 3])
    axis = np.sum(axes, axis=0)
    if float(np.linalg.norm(axis)) < 1e-6:
        raise DataError("the target does not move in the pictures", cure="check the joint angles of the pictures")
    axis = axis / np.linalg.norm(axis)
    point = np.linalg.lstsq(np.vstack(rows), np.concatenate(sides), rcond=None)[0]
    point = point - (point @ axis) * axis
    # A shoulder frame around that axis with any heading and height, then the known corner sets both.
    x = np.cross([0.0, 1.0, 0.0], axis) if abs(axis[1]) < 0.9 else np.cross([1.0, 0.0, 0.0], axis)
    x = x / np.linalg.norm(x)
    camera_from_any = pose(np.column_stack([x, np.cross(axis, x), axis]), point)
    any_from_camera = inverse(camera_from_any)
    there = transform_points(any_from_camera @ seen[first], corner[None, :])[0]
    heading = math.atan2(first_corner_m[1], first_corner_m[0]) - joint1_rad[first] - math.atan2(there[1], there[0])
    shoulder = pose(rotation_about(_UP, heading), [0.0, 0.0, first_corner_m[2] - there[2]]) @ any_from_camera
    world = pose(rotation_about(_UP, float(joint1_rad[first])), np.zeros(3)) @ shoulder @ seen[first]
    return shoulder, world


def _projected(camera: CameraModel, points_m: FloatArray) -> FloatArray:
    seen, _ = cv2.projectPoints(points_m, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion))
    return np.asarray(seen, dtype=np.float64).reshape(-1, 2)


def _rms_px(residual: FloatArray) -> float:
    return float(np.sqrt(2.0 * np.mean(residual**2)))
