"""The tables of the cell, of the search, the scan and the fusion.

Lengths in metres, angles in degrees: this is the one place, besides reports, where people type them. Every value has
a default (the reference cell of the paper), a unit in its name and limits.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from surfuse.settings.section import Fraction, Length, Plain, Section

SCENES = ("flat", "tilted", "relief")
"""The scenes that are built in; any other name is the path of a mesh."""


class SceneSettings(Section):
    """What stands on the table of the simulated cell, and where."""

    name: str = Field("relief", description="flat, tilted, relief, or the path of a mesh file (STL, PLY, OBJ)")
    azimuth_deg: float = Field(35.0, ge=-180.0, le=180.0, description="direction of the part, seen from the arm")
    radius_m: float = Field(1.12, gt=0.2, le=3.0, description="distance of the part's front from the first axis")
    yaw_deg: float = Field(0.0, ge=-180.0, le=180.0, description="turn about the vertical, added to the scene's own")
    tilt_deg: float = Field(0.0, ge=-90.0, le=90.0, description="lean away from the arm")
    scale: float = Field(1.0, gt=0.0, description="factor on a mesh file's numbers (0.001 for millimetres)")
    up: Literal["x", "y", "z"] = Field("z", description="axis of a mesh file that points up")
    roughness: Fraction = Field(0.35, description="acoustic roughness of the part: 0 a mirror, 1 fully diffuse")


class TableSettings(Section):
    """The ring table."""

    table_height_m: Length = Field(1.00, description="height of its surface above the floor")
    table_inner_radius_m: Length = Field(0.95, description="radius of the hole that the arm stands in")
    table_outer_radius_m: Length = Field(1.25, description="radius of its outer edge; nothing is measured beyond it")


class CameraSettings(Section):
    """The camera on the shoulder; it turns with joint 1 and looks outward. `surfuse calibrate` writes this section."""

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


class RangerSettings(Section):
    """The ultrasonic ranger on the shoulder, its axis parallel to the camera's."""

    height_m: float = Field(1.20, gt=0.0, le=5.0, description="height of its axis above the floor")
    forward_m: float = Field(0.10, ge=-1.0, le=1.0, description="distance of its face from the first axis")
    left_m: float = Field(0.0, ge=-1.0, le=1.0, description="its offset to the left of the outward direction")


class SearchSettings(Section):
    """The search for the part."""

    increment_deg: float = Field(15.0, gt=0.0, le=60.0, description="turn of joint 1 between two pictures")
    threshold: str = Field("otsu", description="otsu, maximum_entropy, uniform_error or minimum_error")
    smallest_part_m: float = Field(0.03, gt=0.0, le=1.0, description="what is smaller in the picture is no part")
    tolerance_px: float = Field(1.5, gt=0.0, le=50.0, description="how far the outline may cut a corner")
    all_parts: bool = Field(False, description="go on to the end of the turn and show every part")
    part: int = Field(1, ge=1, le=1000, description="which part is scanned, in order of angle; above 1 all are sought")


class ScanSettings(Section):
    """The plan and the walk through it."""

    standoff_m: Length = Field(0.43, description="from the faces of the transducers to the acquisition plane")
    margin_m: float | None = Field(
        None, ge=0.0, le=0.5, description="default: what the outline's uncertainty asks for, or two steps"
    )
    step_m: float | None = Field(None, gt=0.0, le=0.5, description="default: a fifth of the array's side")
    mode: Literal["stops", "smooth"] = Field(
        "stops", description="stops: the arm rests at every stop; smooth: the array fires while the arm moves"
    )
    pings: int = Field(1, ge=1, le=31, description="emissions averaged for one reading on a smooth pass")
    speed_m_s: float | None = Field(
        None, gt=0.0, le=1.0, description="speed of the array in a smooth pass; default: one sweep a step"
    )


class FusionSettings(Section):
    """The fusion method, and parameters of any method by its name."""

    method: str = Field("beam", description="one of `surfuse methods`")
    parameters: dict[str, dict[str, Plain]] = Field(
        default_factory=dict, description="a table a method, `fusion.parameters.<method>.<key>`; see below"
    )
