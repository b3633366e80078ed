"""The tables of a cell file that say how the part is looked for: the camera, the shoulder's ranger, the search."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from surfuse.errors import ConfigError
from surfuse.settings.rig_tables import FARTHEST_AREA_M, RigTable, Value, Vector, own_keys

SIMULATED = "simulated"
POSE_TOLERANCE = 2e-3
"""How far the axes of a typed pose may be from unit length and right angles (four digits); they are made exact."""
LARGEST_MOUNT_M = 5.0  # a camera farther from the tool than this was typed in millimetres

Region = Annotated[tuple[int, int, int, int], Field(strict=False)]


class PlaneSettings(RigTable):
    """The plane on which the part lies or that it stands in, in the world: outlines are put onto it."""

    origin_m: Vector = Field((0.0, 0.0, 0.0), description="any point of the plane, such as one of the table top")
    normal: Vector = Field((0.0, 0.0, 1.0), description="unit vector out of the part, at camera and sensors")
    u: Vector | None = Field(
        None, description="along the scan lines; default: x of the world, on a steep plane the horizontal"
    )

    @model_validator(mode="after")
    def _is_a_plane(self) -> Self:
        away = float(np.linalg.norm(self.origin_m))
        if away > FARTHEST_AREA_M:
            raise ConfigError(
                f"search.plane.origin_m = {list(self.origin_m)} is {away:.4g} m away, limit {FARTHEST_AREA_M:g} m",
                cure="give metres (25 mm are 0.025)",
            )
        for name, axis in (("normal", self.normal), ("u", self.u)):
            length = 1.0 if axis is None else float(np.linalg.norm(axis))
            if axis is not None and abs(length - 1.0) > POSE_TOLERANCE:
                raise ConfigError(
                    f"search.plane.{name} = {list(axis)} has the length {length:.4g}, wanted 1",
                    cure="give a unit vector, for example [0.0, 0.0, 1.0]",
                )
        if self.u is not None and abs(float(np.dot(self.u, self.normal))) > POSE_TOLERANCE:
            angle = float(np.degrees(np.arccos(np.clip(np.dot(self.u, self.normal), -1.0, 1.0))))
            raise ConfigError(
                f"search.plane.u and normal enclose {angle:.2f} degrees, wanted 90", cure="give u in the plane"
            )
        return self


class CameraSettings(RigTable):
    """The camera that looks for the part. `surfuse calibrate` writes this section.

    In the simulated cell it sits on the shoulder, turns with joint 1 and looks outward. In a real rig `driver` and
    `mounted` say what it is and where it sits.
    """

    driver: str | None = Field(None, description="of a real rig: bridge, uvc, recorded or another plug-in of cameras")
    mounted: Literal["tool", "shoulder", "fixed"] | None = Field(
        None, description="on the tool (hand-eye), on the shoulder (turns with joint 1), or fixed in the world"
    )
    tool_from_camera: list[float] | None = Field(
        None, description="on the tool: pose of the camera in the frame of the tool, 4 x 4 row by row"
    )
    world_from_camera: list[float] | None = Field(
        None, description="fixed: pose of the camera in the world, 4 x 4 row by row"
    )
    width_px: int = Field(500, ge=64, le=10000, description="columns of the picture")
    height_px: int = Field(582, ge=64, le=10000, description="rows of the picture")
    fx_px: float = Field(520.0, gt=0.0, description="focal length in widths of a pixel")
    fy_px: float = Field(760.0, gt=0.0, description="focal length in heights of a pixel, which need not be square")
    cx_px: float | None = Field(None, ge=0.0, le=10000.0, description="principal point; default: middle of the picture")
    cy_px: float | None = Field(None, ge=0.0, le=10000.0, description="the same, from the top")
    distortion: tuple[float, float, float, float, float] = Field(
        (0.0, 0.0, 0.0, 0.0, 0.0), strict=False, description="k1, k2, p1, p2, k3 of OpenCV's lens model"
    )
    height_m: float = Field(1.30, gt=0.0, le=5.0, description="height of the optical centre above the floor")
    forward_m: float = Field(0.10, ge=-1.0, le=1.0, description="distance of the optical centre from the first axis")
    left_m: float = Field(0.0, ge=-1.0, le=1.0, description="its offset to the left of the outward direction")
    yaw_deg: float = Field(0.0, ge=-90.0, le=90.0, description="turn to the left")
    pitch_deg: float = Field(0.0, ge=-60.0, le=60.0, description="tilt downwards")
    roll_deg: float = Field(0.0, ge=-90.0, le=90.0, description="turn about the optical axis, clockwise as it looks")
    noise_levels: float = Field(2.0, ge=0.0, le=64.0, description="sensor noise, standard deviation in grey levels")
    parameters: dict[str, Value] = Field({}, description="further keys: the fields of a real driver's Parameters")

    @model_validator(mode="before")
    @classmethod
    def _gather(cls, values: object) -> object:
        driver = values.get("driver") if isinstance(values, dict) else None
        return own_keys(cls, values) if isinstance(driver, str) and driver != SIMULATED else values

    @field_validator("tool_from_camera", "world_from_camera")
    @classmethod
    def _is_a_pose(cls, numbers: list[float] | None) -> list[float] | None:
        return None if numbers is None else typed_pose(numbers, "the pose of the camera")

    @model_validator(mode="after")
    def _sits_somewhere(self) -> Self:
        if not self.is_real:
            if self.mounted in ("tool", "fixed"):
                raise ConfigError(
                    f"camera.mounted = '{self.mounted}' without the driver of a real camera",
                    cure="give camera.driver = 'bridge', 'uvc' or 'recorded'; the simulated one sits on the shoulder",
                )
            return self
        wanted = {"tool": "tool_from_camera", "fixed": "world_from_camera"}
        if self.mounted is None:
            raise ConfigError(
                f"camera.driver = '{self.driver}', but nothing says where it sits",
                cure="give mounted = 'tool' with tool_from_camera, 'fixed' with world_from_camera, or 'shoulder'",
            )
        for place, key in wanted.items():
            there = getattr(self, key) is not None
            if there != (self.mounted == place):
                raise ConfigError(
                    f"camera.mounted = '{self.mounted}' {'with' if there else 'without'} {key}",
                    cure=f"'{place}' goes with {key}: 16 numbers, a 4 x 4 pose row by row (z ahead, x right, y down)",
                )
        needed = ["width_px", "height_px", "fx_px", "fy_px"]
        needed += ["height_m", "forward_m"] if self.mounted == "shoulder" else []
        missing = [key for key in needed if key not in self.model_fields_set]
        if missing:
            raise ConfigError(
                f"camera.driver = '{self.driver}', but {', '.join(missing)} of it are not given",
                cure="'surfuse calibrate camera' and 'surfuse calibrate shoulder' write them",
            )
        return self

    @property
    def is_real(self) -> bool:
        """Whether a driver of a real camera is named."""
        return self.driver is not None and self.driver != SIMULATED


class RangerSettings(RigTable):
    """The ranger on the shoulder, its axis parallel to the camera's; of a real rig only with a `driver`."""

    driver: str | None = Field(None, description="of a real rig: bridge, or another plug-in of sensors; default: none")
    name: str = Field("us_shoulder", min_length=1, max_length=64, description="its name behind a bridge")
    height_m: float = Field(1.20, gt=0.0, le=5.0, description="height of its axis above the floor")
    forward_m: float = Field(0.10, ge=-1.0, le=1.0, description="distance of its face from the first axis")
    left_m: float = Field(0.0, ge=-1.0, le=1.0, description="its offset to the left of the outward direction")
    range_min_m: float | None = Field(None, ge=0.0, le=100.0, description="nearest range; default: the driver's")
    range_max_m: float | None = Field(None, gt=0.0, le=100.0, description="farthest range; default: the driver's")
    sigma_m: float | None = Field(None, gt=0.0, le=10.0, description="of a reading; default: the driver's")
    parameters: dict[str, Value] = Field({}, description="further keys: the fields of a real driver's Parameters")

    @model_validator(mode="before")
    @classmethod
    def _gather(cls, values: object) -> object:
        driver = values.get("driver") if isinstance(values, dict) else None
        return own_keys(cls, values) if isinstance(driver, str) and driver != SIMULATED else values


class SearchSettings(RigTable):
    """The search for the part."""

    increment_deg: float = Field(15.0, gt=0.0, le=60.0, description="turn of joint 1 between two pictures")
    from_deg: float | None = Field(
        None, ge=-180.0, le=180.0, description="joint 1 where the turn begins; default: its limit, half a turn at most"
    )
    to_deg: float | None = Field(None, ge=-180.0, le=180.0, description="joint 1 where the turn ends; default as above")
    views: list[list[float]] | None = Field(
        None, max_length=100, description="camera on the tool: poses of the tool to look from, 16 numbers each"
    )
    view_joints_deg: list[list[float]] | None = Field(
        None, max_length=100, description="the same as joints of the arm; default: one picture from where it stands"
    )
    plane: PlaneSettings | None = Field(
        None, description="what the part lies on; needed unless a camera on the shoulder sees it standing on the table"
    )
    region_px: Region | None = Field(
        None, description="left, top, width, height: only this part of the picture is looked at; default: all of it"
    )
    tallest_m: float | None = Field(
        None, ge=0.0, le=10.0, description="nothing of the part stands higher than this over the plane"
    )
    threshold: str = Field("otsu", description="otsu, maximum_entropy, uniform_error or minimum_error")
    smallest_part_m: float = Field(0.03, gt=0.0, le=1.0, description="what is smaller in the picture is no part")
    tolerance_px: float = Field(1.5, gt=0.0, le=50.0, description="how far the outline may cut a corner")
    all_parts: bool = Field(False, description="go on to the end of the turn, or of the views, and show every part")
    part: int = Field(
        1,
        ge=1,
        le=1000,
        description="which part is scanned, in order of angle, or of views and size; above 1 all are sought",
    )

    @field_validator("views")
    @classmethod
    def _are_poses(cls, views: list[list[float]] | None) -> list[list[float]] | None:
        if views is None:
            return None
        return [typed_pose(view, f"view {number} of search.views") for number, view in enumerate(views, start=1)]

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.views is not None and self.view_joints_deg is not None:
            raise ConfigError("search.views and search.view_joints_deg are both given", cure="give one of them")
        for name, views in (("views", self.views), ("view_joints_deg", self.view_joints_deg)):
            if views is not None and not views:
                raise ConfigError(f"search.{name} is empty", cure="give one view or more, or leave it out")
        low, high = self.from_deg, self.to_deg
        if low is not None and high is not None and low > high:
            raise ConfigError(f"the search turns from {low:g} to {high:g} degrees", cure="give the smaller one first")
        if self.region_px is not None and (min(self.region_px[:2]) < 0 or min(self.region_px[2:]) < 8):
            raise ConfigError(
                f"search.region_px = {list(self.region_px)}",
                cure="give left and top of 0 or more, then width and height of 8 pixels or more",
            )
        return self


def typed_pose(numbers: list[float], what: str) -> list[float]:
    """16 numbers that are nearly a rigid pose, row by row, as the exact one that is nearest to them.

    Raises
    ------
    ConfigError : another count, axes that are off by more than four digits explain, a mirror, or millimetres.
    """
    if len(numbers) != 16:
        raise ConfigError(f"{what} has {len(numbers)} numbers, wanted 16", cure="give a 4 x 4 pose, row by row")
    matrix = np.array(numbers, dtype=np.float64).reshape(4, 4)
    turn = matrix[:3, :3]
    off = float(np.abs(turn.T @ turn - np.eye(3)).max())
    if off > 2.0 * POSE_TOLERANCE or np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > POSE_TOLERANCE:
        raise ConfigError(
            f"{what} is not rigid: its axes are {off:.3g} off unit length and right angles, limit {2 * POSE_TOLERANCE}",
            cure="give 16 numbers row by row, the last row 0, 0, 0, 1; by columns, or in degrees?",
        )
    if float(np.linalg.det(turn)) < 0.0:
        raise ConfigError(f"{what} is left-handed: a mirror, no turn", cure="negate one column of the rotation")
    away = float(np.linalg.norm(matrix[:3, 3]))
    if away > FARTHEST_AREA_M:
        raise ConfigError(f"{what} is {away:.4g} m away, limit {FARTHEST_AREA_M:g} m", cure="give metres")
    left, _, right = np.linalg.svd(turn)
    matrix[:3, :3] = turn if off < 1e-12 else left @ right
    matrix[3] = 0.0, 0.0, 0.0, 1.0
    return [float(value) for value in matrix.ravel()]
