"""The table `[arm]`: the arm, what drives it, and how it may move."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, field_validator, model_validator

from surfuse import registry
from surfuse.errors import ConfigError, nearest
from surfuse.settings.rig_tables import Value, own_keys
from surfuse.settings.section import Section

SIMULATED_DRIVERS = ("trident", "kinematic", "simulated")
RECORDED_DRIVER = "recorded"
_REAL_SPEED_SHARE = 0.5  # of the joint speeds of a real arm, where nobody said how fast it may be


class ArmSettings(Section):
    """The arm and how it may move."""

    name: str = Field("puma560", description="the built-in arm; `file` gives another one")
    file: str | None = Field(None, description="MJCF or URDF file of another arm")
    tool: str | None = Field(None, description="site, body or link of that file that carries the array; z along beams")
    driver: str | None = Field(
        None,
        description="trident: servo cards and dynamics (default of the PUMA 560); kinematic or simulated: no dynamics, "
        "for speed; of a real rig: bridge, ur_rtde, ...",
    )
    law: str = Field(
        "computed_torque",
        description="control law behind the servo cards: computed_torque, gravity_pd, independent_pid, set_points_28ms",
    )
    fixture_kg: float = Field(0.45, ge=0.0, le=100.0, description="mass of sensors, tubes and bracket at the wrist")
    base_height_m: float = Field(0.50, ge=0.0, le=3.0, description="height of the stand under the arm's base")
    grip_offset_m: float = Field(
        0.08, gt=0.0, le=0.5, description="wrist centre, or tool frame of an arm file, to the faces of the transducers"
    )
    ready_deg: tuple[float, ...] | None = Field(
        None, strict=False, max_length=12, description="joints of the search of an arm file; default: found by itself"
    )
    joint_speed_deg_s: float = Field(60.0, gt=0.0, le=1000.0, description="of every joint of an arm file")
    joint_acceleration_deg_s2: float = Field(120.0, gt=0.0, le=10000.0, description="of every joint of an arm file")
    speed_share: float | None = Field(
        None,
        gt=0.0,
        le=1.0,
        description="share of the joint speeds and accelerations; default: 1 in the simulated cell, 0.5 of a real arm, "
        "behind a bridge what that takes by itself",
    )
    settle_deg: float | None = Field(
        None,
        gt=0.0,
        le=5.0,
        description="behind the servo cards: a joint nearer to its target has arrived; default: what the law can do",
    )
    settle_s: float = Field(0.15, ge=0.0, le=10.0, description="rest after each move, before the array fires")
    repeatability_mm: float = Field(0.1, ge=0.0, le=10.0, description="repeatability at the tool")
    clearance_m: float = Field(0.005, ge=0.0, le=0.5, description="least distance of arm and tubes to table and part")
    collision_check: bool = Field(
        True, description="of a real arm of a file: where its shapes would touch something it does not go"
    )
    tool_speed_max_m_s: float = Field(
        1.0, gt=0.0, le=5.0, description="of the array; faster moves are slowed, faster passes refused"
    )

    world_from_base: list[float] | None = Field(
        None, description="where a real arm of a file stands: pose of its base, 4 x 4 row by row; default: the world"
    )
    parameters: dict[str, Value] = Field({}, description="further keys: the fields of a real driver's Parameters")

    @model_validator(mode="before")
    @classmethod
    def _gather(cls, values: object) -> object:
        driver = values.get("driver") if isinstance(values, dict) else None
        return own_keys(cls, values) if isinstance(driver, str) and driver not in SIMULATED_DRIVERS else values

    @field_validator("driver")
    @classmethod
    def _is_a_driver(cls, driver: str | None) -> str | None:
        known = {*SIMULATED_DRIVERS, *registry.names("arms")}
        if driver is not None and driver not in known:
            raise ConfigError(f"arm.driver = '{driver}'", cure=nearest(driver, known))
        return driver

    @field_validator("law")
    @classmethod
    def _is_known(cls, law: str) -> str:
        if law not in registry.names("control_laws"):
            raise ConfigError(f"arm.law = '{law}'", cure=nearest(law, registry.names("control_laws")))
        return law

    @property
    def driven_by(self) -> Literal["trident", "kinematic"]:
        """The driver: the servo cards unless set, or unless the arm is that of a file."""
        if self.driver is None:
            return "trident" if self.file is None else "kinematic"
        return "trident" if self.driver == "trident" else "kinematic"

    @property
    def share_of_speed(self) -> float:
        """The share of the speeds as set, else all of a simulated arm's and half of a real one's."""
        if self.speed_share is not None:
            return self.speed_share
        return _REAL_SPEED_SHARE if self.is_real else 1.0

    @property
    def is_played_back(self) -> bool:
        """Whether it is the record of an arm, so that nothing moves."""
        return self.driver == RECORDED_DRIVER

    @property
    def is_real(self) -> bool:
        """Whether the driver is that of a real rig."""
        return self.driver is not None and self.driver not in SIMULATED_DRIVERS
