"""The whole configuration: its tables, and what they must agree in."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from surfuse.errors import ConfigError
from surfuse.geometry.sensor_array import step_m as array_step_m
from surfuse.settings.arm_table import ArmSettings
from surfuse.settings.hidden_errors import HiddenErrors
from surfuse.settings.kit_tables import BUS_PINGS_LIMIT, NO_BUS, AirSettings, ArraySettings, BusSettings, KitSettings
from surfuse.settings.looking_tables import CameraSettings, RangerSettings, SearchSettings
from surfuse.settings.rig_tables import AreaSettings, SensorSettings
from surfuse.settings.section import Section
from surfuse.settings.sections import (
    FusionSettings,
    ScanSettings,
    SceneSettings,
    TableSettings,
)

Sensors = Annotated[tuple[SensorSettings, ...], Field(strict=False, max_length=64)]


class Settings(Section):
    """The whole configuration."""

    seed: int = Field(1, ge=0, le=2**63 - 1, description="of everything that is random")
    scene: SceneSettings = SceneSettings()
    cell: TableSettings = TableSettings()
    arm: ArmSettings = ArmSettings()
    camera: CameraSettings = CameraSettings()
    ranger: RangerSettings = RangerSettings()
    search: SearchSettings = SearchSettings()
    array: ArraySettings = ArraySettings()
    bus: BusSettings = BusSettings()
    kit: KitSettings = KitSettings()
    air: AirSettings = AirSettings()
    scan: ScanSettings = ScanSettings()
    fusion: FusionSettings = FusionSettings()
    sensor: Sensors = Field((), description="sensors of a real rig, one table each")
    hidden: HiddenErrors | None = Field(None, description="errors of the simulated rig that nobody knows; see below")
    area: AreaSettings | None = Field(None, description="where a real rig scans; default: a camera looks for it")

    @property
    def pings(self) -> int:
        """Emissions averaged for one reading of the array."""
        return self.array.pings if self.scan.mode == "stops" else self.scan.pings

    @field_validator("sensor")
    @classmethod
    def _names_differ(cls, sensors: tuple[SensorSettings, ...]) -> tuple[SensorSettings, ...]:
        names = [sensor.name for sensor in sensors]
        for name in names:
            if names.count(name) > 1:
                raise ConfigError(f"two sensors are called '{name}'", cure="give every [[sensor]] a name of its own")
        return sensors

    @model_validator(mode="after")
    def _hides_only_what_is_simulated(self) -> Self:
        if self.hidden is not None and self.arm.is_real:
            raise ConfigError(
                f"[hidden] with arm.driver = '{self.arm.driver}'",
                cure="leave it out: errors can be planted in the simulated cell only",
            )
        return self

    @model_validator(mode="after")
    def _can_be_told_where_it_is(self) -> Self:
        if self.scan.mode == "smooth" and self.bus.interface not in (NO_BUS, "virtual"):
            raise ConfigError(
                f"scan.mode = 'smooth' with bus.interface = '{self.bus.interface}': a simulated node in another "
                "process is told where the arm is once a sweep",
                cure="set bus.interface = 'virtual', or scan.mode = 'stops'",
            )
        return self

    @model_validator(mode="after")
    def _fits_the_bus(self) -> Self:
        # On a smooth pass `scan.pings` is what the bus carries, and its own limit is lower.
        if self.bus.interface != NO_BUS and self.scan.mode == "stops" and self.array.pings > BUS_PINGS_LIMIT:
            raise ConfigError(
                f"array.pings = {self.array.pings}, a reading on the bus counts at most {BUS_PINGS_LIMIT}",
                cure="give fewer, or bus.interface = 'none'",
            )
        return self

    @property
    def step_m(self) -> float:
        """Distance between stops: `s = ds / 5` unless set (paper, section 3.2)."""
        if self.scan.step_m is not None:
            return self.scan.step_m
        if self.sensor:
            return array_step_m(np.array([s.position_m for s in self.sensor]), np.array([s.axis for s in self.sensor]))
        return self.array.side_m / 5.0
