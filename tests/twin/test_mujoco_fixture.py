"""The MuJoCo model carries the sensor fixture: mass that acts on the joints, tubes where the kinematics put them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

mujoco = pytest.importorskip("mujoco")

from surfuse.arm_models.puma560 import LIMITS, READY_RAD  # noqa: E402
from surfuse.arm_models.puma560_dynamics import FIXTURE, bare_puma560, loaded_puma560  # noqa: E402
from surfuse.arm_models.puma560_volume import CAPSULES, TOOL_LINK  # noqa: E402
from surfuse.geometry.poses import inverse  # noqa: E402
from surfuse.motion.body import fixture_capsules  # noqa: E402
from surfuse.rig.configured_arm import puma560_kinematics  # noqa: E402
from surfuse.rig.description import square_fixture  # noqa: E402
from surfuse.settings import load  # noqa: E402
from surfuse.twin.dynamics.mujoco_arm import MujocoArm, mjcf  # noqa: E402

SETTINGS = load()
POSTURES = [READY_RAD, READY_RAD + np.radians([35.0, -20.0, 30.0, 40.0, -60.0, 100.0])]


@pytest.mark.parametrize("q", POSTURES)
def test_the_loaded_model_needs_the_torques_of_the_loaded_arm(q: np.ndarray) -> None:
    arm, still = loaded_puma560(FIXTURE), np.zeros(6)
    speed, rate = np.array([0.5, -0.4, 0.3, 1.0, -0.8, 0.6]), np.array([1.0, 2.0, -1.5, 3.0, -2.0, 4.0])
    engine = MujocoArm(arm, LIMITS)
    wanted = arm.rigid_torque(q, speed, rate) + arm.viscous_nm_s * speed
    assert_allclose(engine.smooth_torque(q, speed, rate), wanted, rtol=1e-6, atol=1e-6 * np.abs(wanted).max())
    assert_allclose(engine.inertia(q), arm.inertia(q), rtol=0.0, atol=1e-6 * np.abs(arm.inertia(q)).max())
    added = engine.smooth_torque(q, still, still) - MujocoArm(bare_puma560(), LIMITS).smooth_torque(q, still, still)
    assert np.abs(added).max() > 0.1


@pytest.mark.parametrize("q", POSTURES)
def test_tubes_and_bracket_are_where_the_kinematics_put_them(q: np.ndarray) -> None:
    kinematics = puma560_kinematics(SETTINGS)
    fixture = fixture_capsules(square_fixture(SETTINGS), TOOL_LINK, SETTINGS.kit.tube_length_m)
    rods = (*CAPSULES, *fixture)
    links = kinematics.link_poses(q)
    wrist_from_tool = inverse(links[TOOL_LINK - 1]) @ links[TOOL_LINK]
    text = mjcf(loaded_puma560(FIXTURE), LIMITS, rods, wrist_from_tool, SETTINGS.arm.base_height_m)
    spec = mujoco.MjSpec.from_string(text)
    spec.compiler.balanceinertia = True  # the published inertia of link 3 is that of no body
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    assert sum(capsule.name == "sensor tube" for capsule in rods) == 4
    for k, rod in enumerate(rods):
        middle = 0.5 * (np.array(rod.start_m) + np.array(rod.end_m))
        frame = links[rod.link]
        assert_allclose(data.geom(f"{rod.name} {k}").xpos, frame[:3, :3] @ middle + frame[:3, 3], atol=1e-9)
    assert_allclose(data.site("tool").xpos, kinematics.forward(q)[:3, 3], atol=1e-9)
    bare = mujoco.MjModel.from_xml_string(mjcf(bare_puma560(), LIMITS))
    assert sum(model.body_mass) - sum(bare.body_mass) == pytest.approx(FIXTURE.mass_kg)
