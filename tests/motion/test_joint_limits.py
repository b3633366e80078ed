import numpy as np
import pytest

from surfuse.errors import ConfigError, SafetyStopError
from surfuse.motion.limits import JointLimits, check_position, check_velocity, first_outside

LIMITS = JointLimits(
    lower_rad=np.radians([-90.0, -45.0]),
    upper_rad=np.radians([90.0, 200.0]),
    velocity_rad_s=np.array([1.0, 2.0]),
    acceleration_rad_s2=np.array([3.0, 4.0]),
)


def test_positions_inside_and_on_the_limits_pass() -> None:
    check_position(np.radians([0.0, 0.0]), LIMITS)
    check_position(np.radians([90.0, -45.0]), LIMITS)


def test_a_position_outside_names_joint_value_and_limits() -> None:
    with pytest.raises(SafetyStopError, match=r"joint 2 is 200\.50 deg, its limits are -45\.0 to 200\.0"):
        check_position(np.radians([0.0, 200.5]), LIMITS)


@pytest.mark.parametrize("bad", [[np.nan, 0.0], [0.0, np.inf], [0.0], [[0.0, 0.0]]])
def test_positions_that_are_no_target_are_refused(bad: list) -> None:
    with pytest.raises(SafetyStopError):
        check_position(np.array(bad), LIMITS)


def test_first_outside_is_vectorised() -> None:
    joints = np.radians([[0.0, 0.0], [-91.0, 0.0], [0.0, -46.0], [-91.0, 300.0]])
    assert first_outside(joints, LIMITS).tolist() == [-1, 0, 1, 0]
    assert first_outside(np.array([[np.nan, 0.0]]), LIMITS).tolist() == [0]


def test_speeds_above_the_limit_name_the_joint() -> None:
    check_velocity(np.array([[1.0, -2.0], [0.0, 0.0]]), LIMITS)
    with pytest.raises(SafetyStopError, match="joint 2"):
        check_velocity(np.array([[1.0, -2.1]]), LIMITS)
    with pytest.raises(SafetyStopError, match="joint 1"):
        check_velocity(np.array([np.nan, 0.0]), LIMITS)


@pytest.mark.parametrize(
    "change",
    [
        {"lower_rad": np.array([2.0, 0.0])},
        {"velocity_rad_s": np.array([0.0, 1.0])},
        {"acceleration_rad_s2": np.array([1.0, -1.0])},
        {"upper_rad": np.array([1.0])},
        {"upper_rad": np.array([np.inf, 1.0])},
    ],
)
def test_limits_that_contradict_each_other_are_refused(change: dict) -> None:
    good = {name: getattr(LIMITS, name) for name in LIMITS.__dataclass_fields__}
    with pytest.raises(ConfigError):
        JointLimits(**(good | change))
