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
    material: Literal["painted", "matte", "metal", "foam"] = Field(
        "painted",
        description="of the part: painted is heard well at 20 degrees and lost by 25 to 30, matte is heard at any "
        "tilt, metal is a mirror for sound, foam swallows it",
    )
    roughness: Fraction | None = Field(
        None, description="instead of a material: 0 a mirror, 0.35 matte, 1 fully diffuse"
    )


class TableSettings(Section):
    """The ring table."""

    table_height_m: Length = Field(1.00, description="height of its surface above the floor")
    table_inner_radius_m: Length = Field(0.95, description="radius of the hole that the arm stands in")
    table_outer_radius_m: Length = Field(1.25, description="radius of its outer edge; nothing is measured beyond it")


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
