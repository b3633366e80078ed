import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.acquisition.station import GripPlaces, sweep_of, take_sweep
from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, READY_RAD, Puma560
from surfuse.errors import DeviceError
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import Echo, Fixture, SensorSpec, Status, ToolState

ARM = Puma560(pose(np.eye(3), [0, 0, 0.5]), pose(np.eye(3), [0, 0, 0.08 - FLANGE_OFFSET_M]))
SPEC = SensorSpec("s", "sonar", 0.35, 4.0, 0.4, 0.001)
FIXTURE = Fixture(
    np.array([pose(rotation_about([0, 1, 0], 0.1 * i), [0.02 * i, -0.01 * i, 0.003]) for i in range(4)]), (SPEC,) * 4
)
ECHOES = (
    Echo(0.43, Status.OK, 1.0, 0.9, 2e-4, 5),
    Echo(np.inf, Status.NO_ECHO, 1.1),
    Echo(-np.inf, Status.TOO_CLOSE, 1.2),
    Echo(np.nan, Status.FAULT, 1.3, count=0),
)


class Answering:
    """An array with fixed answers."""

    fixture = FIXTURE

    def __init__(self, echoes: tuple[Echo, ...]) -> None:
        self.echoes = echoes

    def __enter__(self) -> "Answering":
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def sweep(self) -> tuple[Echo, ...]:
        return self.echoes


def standing(t_s: float) -> ToolState:
    return ToolState(t_s, ARM.forward(READY_RAD), READY_RAD)


def test_a_sweep_holds_the_echoes_as_they_are() -> None:
    sweep = take_sweep(7, 2, standing(0.9), Answering(ECHOES))
    assert (sweep.stop, sweep.row) == (7, 2)
    assert_allclose(sweep.t_s, [1.0, 1.1, 1.2, 1.3])
    assert sweep.status.tolist() == [0, 1, 2, 3]
    assert_allclose(sweep.range_m, [0.43, np.inf, -np.inf, np.nan])
    assert_allclose(sweep.amplitude, [0.9, np.nan, np.nan, np.nan])
    assert_allclose(sweep.spread_m, [2e-4, np.nan, np.nan, np.nan])
    assert sweep.count.tolist() == [5, 1, 1, 0]
    assert sweep.sensor.tolist() == [0, 1, 2, 3]
    assert_allclose(sweep.joints_rad, READY_RAD)


def test_sensor_poses_follow_from_the_measured_joints() -> None:
    sweep = take_sweep(0, 0, standing(0.9), Answering(ECHOES))
    grip = ARM.forward(READY_RAD)
    assert_allclose(sweep.world_from_grip, grip, atol=1e-15)
    for i in range(4):
        expected = grip @ FIXTURE.grip_from_sensor[i]
        assert_allclose(sweep.position_m[i], expected[:3, 3], atol=1e-15)
        assert_allclose(sweep.axis[i], expected @ [0, 0, 1, 0] @ np.eye(4, 3), atol=1e-15)


def test_an_arm_in_motion_gives_every_reading_its_own_pose() -> None:
    joints = READY_RAD + np.linspace(0.0, 0.03, 4)[:, None] * np.ones(6)
    sweep = sweep_of(0, 0, ECHOES, FIXTURE, GripPlaces.moving(ARM, joints))
    for i in range(4):
        assert_allclose(sweep.position_m[i], (ARM.forward(joints[i]) @ FIXTURE.grip_from_sensor[i])[:3, 3], atol=1e-15)
    assert_allclose(sweep.world_from_grip, ARM.forward(READY_RAD + 0.015), atol=1e-12)


def test_missing_answers_are_a_device_error() -> None:
    with pytest.raises(DeviceError, match="3 answers of 4 sensors"):
        take_sweep(0, 0, standing(0.0), Answering(ECHOES[:3]))


@pytest.mark.parametrize(
    ("status", "range_m"),
    [(Status.OK, np.nan), (Status.OK, np.inf), (Status.NO_ECHO, 0.4), (Status.TOO_CLOSE, np.inf), (Status.FAULT, 0.4)],
)
def test_a_range_that_contradicts_its_status_is_a_device_error(status: Status, range_m: float) -> None:
    echoes = (dataclasses.replace(ECHOES[0], status=status, range_m=range_m), *ECHOES[1:])
    with pytest.raises(DeviceError, match=status.name):
        take_sweep(3, 0, standing(0.0), Answering(echoes))
