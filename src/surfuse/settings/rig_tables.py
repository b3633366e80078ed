"""The tables of a cell file that describe a real rig: its sensors on the tool, and where to scan.

Keys that are not listed here belong to the driver that the table names: they are the fields of its `Parameters`.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from surfuse.errors import ConfigError

Value = str | int | float | bool | list[str] | list[float]
Vector = Annotated[tuple[float, float, float], Field(strict=False)]

UNIT_TOLERANCE = 1e-3
FARTHEST_AREA_M = 30.0
TOOL_REACH_M = 2.0  # a sensor farther from the tool than this was typed in millimetres


class RigTable(BaseModel):
    """A table of a rig: unknown keys are the driver's, values that are not finite are refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True, strict=True)


def own_keys(table: type[BaseModel], values: object) -> object:
    """The values with the keys that `table` does not have gathered under `parameters`, for its driver."""
    if not isinstance(values, dict) or "parameters" in values:
        return values
    known = {key: value for key, value in values.items() if key in table.model_fields}
    return {**known, "parameters": {key: value for key, value in values.items() if key not in known}}


class SensorSettings(RigTable):
    """One sensor on the tool: what drives it, where it sits, and what is known of it."""

    name: str = Field(min_length=1, max_length=64, description="any identifier; it names the sensor in log and map")
    driver: str = Field(
        "bridge",
        description="what reads it: bridge, node (on the CAN bus), or a plug-in: tfmini, maxbotix, iio, ...",
    )
    kind: Literal["ultrasonic", "laser", "infrared", "tof", "touch"] | None = Field(
        None, description="ultrasonic, laser, infrared, tof or touch; default: the driver's"
    )
    position_m: Vector = Field((0.0, 0.0, 0.0), description="its face in the frame of the tool (x, y, z)")
    axis: Vector = Field((0.0, 0.0, 1.0), description="unit vector of its beam in the frame of the tool")
    beam_full_angle_deg: float | None = Field(None, gt=0.0, le=180.0, description="full opening of the beam")
    range_min_m: float | None = Field(None, ge=0.0, le=100.0, description="nearest range that it can give")
    range_max_m: float | None = Field(None, gt=0.0, le=100.0, description="farthest range that it can give")
    sigma_m: float | None = Field(None, gt=0.0, le=10.0, description="standard deviation of a reading")
    incidence_limit_deg: float | None = Field(
        None, gt=0.0, lt=90.0, description="largest usable angle of incidence; default: the driver's, else 25"
    )
    firing_time_s: float | None = Field(
        None, ge=0.0, le=60.0, description="time that a reading takes; default: the driver's, else 0.05"
    )
    frequency_hz: float | None = Field(None, gt=0.0, description="of sound")
    aperture_m: float | None = Field(None, gt=0.0, le=1.0, description="diameter of the mouth or the transducer")
    dead_length_m: float = Field(0.0, ge=0.0, le=10.0, description="from the face to where the beam starts (a tube)")
    lag_s: float = Field(0.0, ge=-10.0, le=10.0, description="how much later than its time stamp a reading was taken")
    offset_m: float = Field(0.0, ge=-10.0, le=10.0, description="true range = scale x reading + offset")
    scale: float = Field(1.0, gt=0.1, lt=10.0, description="true range = scale x reading + offset")
    late_tilt_deg: list[float] = Field([], description="late table: tilts of a plate")
    late_bias_m: list[float] = Field([], description="late table: how much too far it reads there")
    late_scatter_m: list[float] = Field([], description="late table: scatter of the readings there")
    burst_cycles: int | None = Field(None, ge=1, le=1000, description="length of the burst of sound")
    threshold_ratio: float | None = Field(
        None, gt=0.0, lt=1.0, description="detection level over the echo of a facing plate"
    )
    parameters: dict[str, Value] = Field({}, description="further keys: the fields of the driver's Parameters")

    @model_validator(mode="before")
    @classmethod
    def _gather(cls, values: object) -> object:
        return own_keys(cls, values)

    @model_validator(mode="after")
    def _sits_on_the_tool(self) -> Self:
        length = float(np.linalg.norm(self.axis))
        if abs(length - 1.0) > UNIT_TOLERANCE:
            hint = "angles? an axis is a direction" if length > 1.5 else "divide it by its length"
            raise ConfigError(
                f"sensor '{self.name}': axis = {list(self.axis)} has the length {length:.4g}, wanted 1",
                cure=f"give a unit vector, for example [0.0, 0.0, 1.0] ({hint})",
            )
        away = float(np.linalg.norm(self.position_m))
        if away > TOOL_REACH_M:
            raise ConfigError(
                f"sensor '{self.name}': position_m = {list(self.position_m)} is {away:.4g} m from the tool, "
                f"limit {TOOL_REACH_M:g} m",
                cure="give metres (25 mm are 0.025)",
            )
        return self


class AreaSettings(RigTable):
    """Where to scan when no camera looks for the part, and the part frame of the map.

    One of: a rectangle (`width_m`, `height_m`), an outline file, a mesh with its pose, or corners shown by hand.
    """

    origin_m: Vector = Field((0.0, 0.0, 0.0), description="world: origin of the part frame, where the part begins")
    u: Vector = Field((1.0, 0.0, 0.0), description="unit vector along the scan lines, in the world")
    v: Vector = Field((0.0, 1.0, 0.0), description="unit vector across them; w = u x v points towards the sensors")
    width_m: float | None = Field(None, gt=0.0, le=20.0, description="extent along u")
    height_m: float | None = Field(None, gt=0.0, le=20.0, description="extent along v")
    tallest_m: float | None = Field(
        None, ge=0.0, le=10.0, description="nothing stands higher than this (w); default: half the standoff"
    )
    outline: str | None = Field(None, description="file with the columns u,v: the boundary in the part frame")
    mesh: str | None = Field(None, description="mesh of the part in the world (its outline along w is scanned)")
    world_from_mesh: list[float] | None = Field(None, description="pose of the mesh, 4 x 4 row by row; default: none")
    jog: bool = Field(False, description="corners are shown by hand: the arm is guided to three or more")
    corners_m: list[list[float]] | None = Field(None, description="world: corners of the area, as `jog` found them")

    @model_validator(mode="after")
    def _is_a_frame(self) -> Self:
        u, v = np.array(self.u), np.array(self.v)
        for name, axis in (("u", u), ("v", v)):
            if abs(float(np.linalg.norm(axis)) - 1.0) > UNIT_TOLERANCE:
                raise ConfigError(
                    f"area.{name} = {axis.tolist()} has the length {float(np.linalg.norm(axis)):.4g}, wanted 1",
                    cure="give a unit vector",
                )
        away = float(np.linalg.norm(self.origin_m))
        if away > FARTHEST_AREA_M:
            raise ConfigError(
                f"area.origin_m = {list(self.origin_m)} is {away:.4g} m away, limit {FARTHEST_AREA_M:g} m",
                cure="give metres (25 mm are 0.025)",
            )
        if abs(float(u @ v)) > UNIT_TOLERANCE:
            angle = float(np.degrees(np.arccos(np.clip(u @ v, -1.0, 1.0))))
            raise ConfigError(f"area.u and area.v enclose {angle:.2f} degrees, wanted 90", cure="make v across u")
        return self

    @model_validator(mode="after")
    def _is_one_kind(self) -> Self:
        rectangle = self.width_m is not None or self.height_m is not None
        given = [
            name
            for name, there in (
                ("width_m, height_m", rectangle),
                ("outline", self.outline is not None),
                ("mesh", self.mesh is not None),
                ("jog or corners_m", self.jog or self.corners_m is not None),
            )
            if there
        ]
        if len(given) != 1:
            what = " and ".join(given) if given else "nothing that says where to scan"
            raise ConfigError(
                f"[area] holds {what}", cure="give one of: width_m and height_m, outline, mesh, jog = true"
            )
        if rectangle and (self.width_m is None or self.height_m is None):
            missing = "width_m" if self.width_m is None else "height_m"
            raise ConfigError(f"[area] has no {missing}", cure="give both width_m and height_m, in metres")
        return self
