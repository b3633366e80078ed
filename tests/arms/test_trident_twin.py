"""The arm behind servo cards as the twin's cell takes it, and the study of the control laws."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

sys.path.insert(0, str(Path(__file__).parent))
from trident_bench import KINEMATICS, TARGET, Clock

from surfuse import registry
from surfuse.arm_models.puma560 import LIMITS, READY_RAD
from surfuse.commands.outcome import SilentWatcher
from surfuse.commands.servo.servo_study import scan_joints, servo_study
from surfuse.errors import ConfigError, StorageError, UsageError
from surfuse.motion.planners import jerk_limited, torque_limited, trapezoidal
from surfuse.records import ByteArray, CameraModel, FloatArray, SensorSpec
from surfuse.rig.simulated.servo_arm import ServoTwinArm, build_servo_arm, control_law, known_model
from surfuse.settings import load


class ShakyWorld:
    """A world with nothing in it but the error between motor and link."""

    def ping(
        self, world_from_sensor: FloatArray, spec: SensorSpec, pings: int, t_s: float
    ) -> tuple[FloatArray, FloatArray]:
        return np.full(pings, np.inf), np.zeros(pings)

    def image(self, camera: CameraModel, world_from_camera: FloatArray) -> ByteArray:
        return np.zeros((camera.height_px, camera.width_px), dtype=np.uint8)

    def repeatability(self, joints: int) -> FloatArray:
        return np.full(joints, 1e-4)

    def begin(self, stage: str, index: int) -> None:
        return None


def twin_arm() -> ServoTwinArm:
    parts = build_servo_arm(KINEMATICS, Clock(), np.random.default_rng(2))
    return ServoTwinArm(parts, ShakyWorld())


def test_the_links_are_where_the_plant_and_the_error_between_put_them() -> None:
    with twin_arm() as arm:
        state = arm.move_to(TARGET)
        assert_allclose(state.position_rad, TARGET, atol=3e-4)
        assert_allclose(arm.true_joints_rad - 1e-4, state.position_rad, atol=3e-4)
        assert_allclose(arm.true_tool_pose(), KINEMATICS.forward(arm.true_joints_rad))


def test_a_stop_depends_on_itself_and_the_one_before_alone() -> None:
    ends = []
    for detour in (False, True):
        with twin_arm() as arm:
            if detour:
                arm.begin_stop()
                arm.move_to(READY_RAD + np.radians([-5.0, 3.0, 6.0, 0.0, 0.0, 2.0]))
            arm.begin_stop()
            arm.move_to(READY_RAD + np.radians([1.0, -1.0, 1.0, 0.0, 0.0, 0.0]))
            arm.begin_stop()
            ends.append(arm.move_to(TARGET).position_rad)
    assert np.array_equal(ends[0], ends[1])


def test_all_planners_end_where_they_should() -> None:
    for planner in (
        trapezoidal(LIMITS),
        jerk_limited(LIMITS, np.full(6, 5.0)),
        torque_limited(known_model(), LIMITS),
    ):
        move = planner(READY_RAD, TARGET)
        assert_allclose(move.sample([move.duration_s])[0][0], TARGET, atol=1e-12)


def test_laws_have_names() -> None:
    for name in registry.names("control_laws"):
        assert control_law(name, known_model()).name == name
    with pytest.raises(UsageError, match="did you mean 'computed_torque'"):
        control_law("computed_torqe", known_model())


def test_the_study_shows_what_the_cards_were_bought_for(tmp_path: Path) -> None:
    outcome = servo_study(load(), tmp_path / "study", 4, SilentWatcher())
    ratios = outcome.summary["ratios"]
    assert isinstance(ratios, dict)
    assert min(value for name, value in ratios.items() if name.startswith("error")) > 5.0
    assert ratios["scan time saved, rest 0.15 s"] > 0.3
    assert ratios["smooth pass / new start-stop"] < 0.25
    written = json.loads((tmp_path / "study" / "servo_study.json").read_text())
    assert len(written["tracking"]) == 2 * 2 * len(registry.names("control_laws"))
    assert (tmp_path / "study" / "servo_study.svg").read_text().startswith("<svg xmlns=")
    with pytest.raises(StorageError, match="exists already"):
        servo_study(load(), tmp_path / "study", 4, SilentWatcher())
    with pytest.raises(ConfigError, match="stops = 2"):
        servo_study(load(), None, 2, SilentWatcher())


def test_a_plate_out_of_reach_is_an_error() -> None:
    with pytest.raises(ConfigError, match="stops can be reached"):
        scan_joints(load(None, ["scene.radius_m=2.5"]), KINEMATICS)
