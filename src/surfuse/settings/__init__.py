"""The validated configuration: what a person may write into a cell file or pass with `--set key.path=value`."""

from surfuse.settings.arm_table import RECORDED_DRIVER, SIMULATED_DRIVERS, ArmSettings
from surfuse.settings.configuration import Settings
from surfuse.settings.kit_tables import (
    BUS_PINGS_LIMIT,
    NO_BUS,
    AirSettings,
    ArraySettings,
    BusSettings,
    KitSettings,
)
from surfuse.settings.loading import from_tree, load
from surfuse.settings.looking_tables import CameraSettings, RangerSettings, SearchSettings
from surfuse.settings.section import Fraction, Length, Plain, Section
from surfuse.settings.sections import (
    SCENES,
    FusionSettings,
    ScanSettings,
    SceneSettings,
    TableSettings,
)

__all__ = [
    "BUS_PINGS_LIMIT",
    "NO_BUS",
    "RECORDED_DRIVER",
    "SCENES",
    "SIMULATED_DRIVERS",
    "AirSettings",
    "ArmSettings",
    "ArraySettings",
    "BusSettings",
    "CameraSettings",
    "Fraction",
    "FusionSettings",
    "KitSettings",
    "Length",
    "Plain",
    "RangerSettings",
    "ScanSettings",
    "SceneSettings",
    "SearchSettings",
    "Section",
    "Settings",
    "TableSettings",
    "from_tree",
    "load",
]
