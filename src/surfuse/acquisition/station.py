"""One stop: fire the array and record where every sensor was when it answered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surfuse.errors import DeviceError
from surfuse.interfaces import Kinematics, RangeArray
from surfuse.records import Echo, Fixture, FloatArray, Status, Sweep, ToolState, columns_of_echoes


def take_sweep(stop: int, row: int, standing: ToolState, array: RangeArray) -> Sweep:
    """Fire all sensors of the array from a standing arm, whose tool is the grip.

    Sensor poses follow from the measured pose of the grip, the only one that a real rig knows.

    Raises
    ------
    DeviceError : the array does not answer for every sensor, or answers nonsense.
    """
    return sweep_of(stop, row, array.sweep(), array.fixture, GripPlaces.standing(standing))


@dataclass(frozen=True)
class GripPlaces:
    """Where the grip was during a sweep: `of_readings` (4, 4) or (S, 4, 4), `middle` (4, 4), joints (J,) there."""

    of_readings: FloatArray
    middle: FloatArray
    joints_rad: FloatArray

    @classmethod
    def standing(cls, state: ToolState) -> GripPlaces:
        """A grip that stood still."""
        return cls(state.world_from_tool, state.world_from_tool, state.joints_rad)

    @classmethod
    def moving(cls, kinematics: Kinematics, joints_rad: FloatArray) -> GripPlaces:
        """A grip in motion, with the joints (S, J) at the moment of each emission.

        The middle is half-way between the first and the last emission.
        """
        middle = 0.5 * (joints_rad[0] + joints_rad[-1])
        return cls(kinematics.forward(joints_rad), kinematics.forward(middle), middle)


def sweep_of(stop: int, row: int, echoes: Sequence[Echo], fixture: Fixture, grip: GripPlaces) -> Sweep:
    """The record of one sweep from its echoes, one a sensor in the order of the fixture.

    Raises
    ------
    DeviceError : wrong number of echoes, or an echo whose range contradicts its status.
    """
    if len(echoes) != len(fixture):
        raise DeviceError(
            f"stop {stop}: {len(echoes)} answers of {len(fixture)} sensors", cure="check the wiring of the array"
        )
    for sensor, echo in enumerate(echoes):
        _check(stop, sensor, echo)
    world_from_sensor = grip.of_readings @ fixture.grip_from_sensor
    return Sweep(
        stop=stop,
        row=row,
        world_from_grip=grip.middle,
        sensor=np.arange(len(echoes)),
        position_m=world_from_sensor[:, :3, 3],
        axis=world_from_sensor[:, :3, 2],
        joints_rad=grip.joints_rad,
        **columns_of_echoes(echoes),
    )


def _check(stop: int, sensor: int, echo: Echo) -> None:
    """Refuse an echo whose range is not the one that REP-117 has for its status."""
    fits = {
        Status.OK: np.isfinite(echo.range_m),
        Status.NO_ECHO: echo.range_m == np.inf,
        Status.TOO_CLOSE: echo.range_m == -np.inf,
        Status.FAULT: np.isnan(echo.range_m),
    }
    if not fits[echo.status]:
        raise DeviceError(
            f"stop {stop}, sensor {sensor}: status {echo.status.name} with a range of {echo.range_m} m",
            cure="a driver gives a finite range, +inf, -inf or nan for OK, NO_ECHO, TOO_CLOSE or FAULT",
        )
