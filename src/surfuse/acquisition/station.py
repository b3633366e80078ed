"""One stop: fire the array and record where every sensor was when it answered."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surfuse.errors import DeviceError
from surfuse.interfaces import Kinematics, RangeArray
from surfuse.records import Echo, Fixture, FloatArray, JointState, Status, Sweep, columns_of_echoes


def take_sweep(stop: int, row: int, state: JointState, kinematics: Kinematics, array: RangeArray) -> Sweep:
    """Fire all sensors of the array from a standing arm.

    Sensor poses follow from the measured joints of `state`, the only ones that a real cell knows.

    Raises
    ------
    DeviceError : the array does not answer for every sensor, or answers nonsense.
    """
    return sweep_of(stop, row, array.sweep(), array.fixture, kinematics, state.position_rad)


def sweep_of(
    stop: int,
    row: int,
    echoes: Sequence[Echo],
    fixture: Fixture,
    kinematics: Kinematics,
    joints_rad: FloatArray,
) -> Sweep:
    """The record of one sweep from its echoes, one a sensor in the order of the fixture.

    `joints_rad` is (J,) for a standing arm, or (S, J): the joints at the moment of each emission, for an arm in
    motion; the grip pose of the sweep is then the one half-way between the first and the last emission.

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
    joints = np.asarray(joints_rad, dtype=np.float64)
    middle = joints if joints.ndim == 1 else 0.5 * (joints[0] + joints[-1])
    world_from_sensor = kinematics.forward(joints) @ fixture.grip_from_sensor
    return Sweep(
        stop=stop,
        row=row,
        world_from_grip=kinematics.forward(middle),
        sensor=np.arange(len(echoes)),
        position_m=world_from_sensor[:, :3, 3],
        axis=world_from_sensor[:, :3, 2],
        joints_rad=middle,
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
