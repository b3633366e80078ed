"""The ranger on the shoulder of a real arm."""

from __future__ import annotations

from surfuse.bridge.shared import SharedBridge
from surfuse.interfaces import Clock, OpenedTogether, RangeArray
from surfuse.records import Echo, SensorSpec
from surfuse.rig.real.recordings import Recordings
from surfuse.rig.real.sensors import array_of
from surfuse.settings import Settings
from surfuse.settings.looking_tables import SIMULATED
from surfuse.settings.rig_tables import SensorSettings


class ShoulderRanger(OpenedTogether):
    """A `RangeSensor`: an array of one sensor."""

    def __init__(self, array: RangeArray) -> None:
        super().__init__(array)
        self._array = array

    @property
    def spec(self) -> SensorSpec:
        """What is known of it."""
        return self._array.fixture.specs[0]

    def fire(self) -> Echo:
        """One range; no echo is an answer."""
        return self._array.sweep()[0]


def shoulder_ranger(
    settings: Settings, bridge: SharedBridge | None, clock: Clock, recordings: Recordings
) -> ShoulderRanger | None:
    """The ranger of the table [ranger]; None where it names no driver.

    Raises
    ------
    UsageError, ConfigError : no such driver, or its keys are wrong.
    """
    own = settings.ranger
    if own.driver is None or own.driver == SIMULATED:
        return None
    described = SensorSettings(
        name=own.name,
        driver=own.driver,
        range_min_m=own.range_min_m,
        range_max_m=own.range_max_m,
        sigma_m=own.sigma_m,
        parameters=own.parameters,
    )
    return ShoulderRanger(array_of(settings.model_copy(update={"sensor": [described]}), bridge, clock, recordings))
