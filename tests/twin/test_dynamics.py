"""Dynamics of the PUMA 560: published reference, two formulations, an independent engine, and laws of mechanics."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.arm_models.puma560 import LIMITS, READY_RAD, Puma560
from surfuse.arm_models.puma560_dynamics import FIXTURE, Load, bare_puma560, extra_load, loaded_puma560
from surfuse.errors import ConfigError, DataError
from surfuse.geometry.poses import pose
from surfuse.motion.newton_euler import newton_euler
from surfuse.motion.rigid_body import ArmDynamics
from surfuse.records import FloatArray
from surfuse.twin.dynamics.equations import Bodies, motion_terms, scratch_of
from surfuse.twin.dynamics.plant import ArmPlant, PlantParameters

REFERENCE = json.loads((Path(__file__).parents[1] / "data" / "puma560_rtb_reference.json").read_text())
STATES = REFERENCE["dynamics"]
NAMES = [state["name"] for state in STATES]
BARE = bare_puma560()
FREE = replace(BARE, coulomb_motor_nm=np.zeros((6, 2)), viscous_motor=np.zeros(6))


def motion(state: dict[str, object]) -> tuple[FloatArray, FloatArray, FloatArray]:
    return tuple(np.array(state[key]) for key in ("q", "qd", "qdd"))  # type: ignore[return-value]


def close(value: FloatArray, reference: object, relative: float = 1e-6) -> None:
    wanted = np.array(reference)
    assert_allclose(value, wanted, rtol=0.0, atol=relative * max(float(np.abs(wanted).max()), 1e-6))


def terms(arm: ArmDynamics, q: FloatArray, qd: FloatArray) -> tuple[FloatArray, FloatArray]:
    matrix, bias = np.empty((6, 6)), np.empty(6)
    links = arm.d_m, arm.a_m, arm.alpha_rad, arm.mass_kg, arm.center_m, arm.inertia_kg_m2
    motion_terms(Bodies(*links, arm.gravity_m_s2), q, qd, matrix, bias, scratch_of(6))
    return matrix + np.diag(arm.armature_kg_m2), bias


def plant_of(arm: ArmDynamics, start: FloatArray = READY_RAD, substep_s: float = 2.5e-4) -> ArmPlant:
    plant = ArmPlant(arm, start, LIMITS.lower_rad, LIMITS.upper_rad, PlantParameters(substep_s=substep_s))
    plant.brakes_on = False
    return plant


@pytest.mark.parametrize("state", STATES, ids=NAMES)
def test_the_controllers_model_equals_the_reference(state: dict[str, object]) -> None:
    q, qd, qdd = motion(state)
    close(BARE.inverse_dynamics(q, qd, qdd), state["rne_full"])
    close(BARE.rigid_torque(q, qd, qdd), state["rne_no_friction"])
    close(BARE.gravity(q), state["gravload"])
    close(BARE.inertia(q), state["inertia"])
    close(BARE.friction(qd), -np.array(state["friction"]))


@pytest.mark.parametrize("state", STATES, ids=NAMES)
def test_the_twins_equations_equal_the_reference(state: dict[str, object]) -> None:
    q, qd, _ = motion(state)
    matrix, bias = terms(BARE, q, qd)
    close(matrix, state["inertia"])
    close(bias, np.array(state["coriolis_times_qd"]) + np.array(state["gravload"]))


@pytest.mark.parametrize("state", STATES, ids=NAMES)
def test_mujoco_agrees(state: dict[str, object]) -> None:
    pytest.importorskip("mujoco")
    from surfuse.twin.dynamics.mujoco_arm import MujocoArm

    engine = MujocoArm(BARE, LIMITS)
    q, qd, qdd = motion(state)
    close(engine.inertia(q), state["inertia"])
    close(engine.smooth_torque(q, qd, qdd), state["rne_no_coulomb"])
    close(engine.smooth_torque(q, np.zeros(6), np.zeros(6)), state["gravload"])


def test_the_kernel_equals_its_plain_twin() -> None:
    q, qd, qdd = motion(STATES[-1])
    arm, wanted, plain = BARE.kernel_arguments(), np.empty(6), np.empty(6)
    newton_euler(arm, q, qd, qdd, wanted)
    newton_euler.py_func(arm, q, qd, qdd, plain)  # type: ignore[attr-defined]
    assert_allclose(plain, wanted, rtol=1e-13)


def test_inertia_is_symmetric_and_positive_definite_everywhere() -> None:
    for q in np.random.default_rng(0).uniform(LIMITS.lower_rad, LIMITS.upper_rad, (20, 6)):
        matrix = BARE.inertia(q)
        assert_allclose(matrix, matrix.T, atol=1e-13)
        assert np.linalg.eigvalsh(matrix).min() > 0.0


def test_a_load_adds_the_weight_at_its_place() -> None:
    load = Load(2.0, 0.1, 0.04, 0.05)
    kinematics = Puma560(np.eye(4), pose(np.eye(3), [0.0, 0.0, 0.1 - 0.05625]))
    q = np.array([0.3, 0.7, -2.5, 0.4, 0.8, -0.2])
    weight = np.array([0.0, 0.0, 9.81 * load.mass_kg, 0.0, 0.0, 0.0])
    added = loaded_puma560(load).gravity(q) - BARE.gravity(q)
    assert_allclose(added, kinematics.jacobian(q).T @ weight, atol=1e-12)


def test_two_loads_are_their_sum() -> None:
    q, qd, qdd = motion(STATES[-1])
    both = loaded_puma560(FIXTURE, extra_load(2.0)).rigid_torque(q, qd, qdd)
    added = loaded_puma560(FIXTURE).rigid_torque(q, qd, qdd) + loaded_puma560(extra_load(2.0)).rigid_torque(q, qd, qdd)
    assert_allclose(both, added - BARE.rigid_torque(q, qd, qdd), atol=1e-12)


def test_payload_beyond_the_limit_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"2\.6 kg.*carries 2\.5 kg"):
        extra_load(2.6)
    with pytest.raises(ConfigError, match=r"loads of 2\.55 kg together"):
        loaded_puma560(FIXTURE, extra_load(2.1))
    with pytest.raises(ConfigError, match="nan"):
        Load(float("nan"))


def test_hostile_parameters_are_refused() -> None:
    with pytest.raises(DataError, match="mass_kg"):
        replace(BARE, mass_kg=np.full(6, np.nan))
    with pytest.raises(ConfigError, match="torque_max_nm"):
        replace(BARE, torque_max_nm=np.zeros(6))
    with pytest.raises(ConfigError, match="viscous"):
        replace(BARE, viscous_motor=-BARE.viscous_motor)
    with pytest.raises(DataError, match="wanted"):
        BARE.gravity(np.zeros(5))


def test_energy_is_kept_without_friction() -> None:
    weightless = replace(FREE, gravity_m_s2=0.0)
    plant = plant_of(weightless, substep_s=5e-5)
    plant.drift(np.array([0.5, -0.4, 0.6, 0.3, -0.5, 0.8]))
    before = 0.5 * plant.velocity_rad_s @ weightless.inertia(plant.position_rad) @ plant.velocity_rad_s
    for _ in range(300):
        plant.step(np.zeros(6), 1e-3)
    after = 0.5 * plant.velocity_rad_s @ weightless.inertia(plant.position_rad) @ plant.velocity_rad_s
    assert after == pytest.approx(before, rel=1e-3)
    assert np.abs(plant.position_rad - READY_RAD).max() > 0.05


def test_the_plant_follows_inverse_dynamics() -> None:
    arm = loaded_puma560(FIXTURE)
    plant, h, size = plant_of(arm, substep_s=1e-4), 1e-3, np.array([0.2, 0.1, 0.15, 0.2, 0.1, 0.3])
    rate = 2.0 * np.pi

    def at(t: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        return (
            READY_RAD + size * (1.0 - np.cos(rate * t)),
            size * rate * np.sin(rate * t),
            size * rate**2 * np.cos(rate * t),
        )

    for i in range(400):
        plant.step(arm.inverse_dynamics(*at((i + 0.5) * h)), h)
    assert_allclose(plant.position_rad, at(0.4)[0], atol=2e-3)


def test_the_plant_and_mujoco_move_alike() -> None:
    pytest.importorskip("mujoco")
    from surfuse.twin.dynamics.mujoco_arm import MujocoArm

    arm = replace(loaded_puma560(FIXTURE), coulomb_motor_nm=np.zeros((6, 2)))
    plant, engine = plant_of(arm), MujocoArm(arm, LIMITS)
    engine.set_state(READY_RAD, np.zeros(6))
    for i in range(300):
        torque = arm.gravity(READY_RAD) + np.array([60.0, 25.0, 15.0, 3.0, 2.0, 2.0]) * np.sin(i / 80.0)
        plant.step(torque, 1e-3)
        engine.step(torque, 1e-3)
    assert np.abs(plant.position_rad - READY_RAD).max() > 0.1
    assert_allclose(plant.position_rad, engine.position_rad, atol=1e-9)


def test_dry_friction_holds_up_to_its_size_and_no_further() -> None:
    arm = loaded_puma560(FIXTURE)
    hold = arm.gravity(READY_RAD)
    for share, moves in ((0.95, False), (1.05, True)):
        for side, sign in ((0, 1.0), (1, -1.0)):
            plant = plant_of(arm)
            torque = hold.copy()
            torque[0] += sign * share * arm.coulomb_nm[0, side]
            for _ in range(100):
                plant.step(torque, 1e-3)
            gone = sign * (plant.position_rad[0] - READY_RAD[0])
            assert (gone > 1e-6) if moves else (abs(gone) < 1e-12)


def test_brakes_hold_the_dead_arm() -> None:
    stretched = np.array([0.0, 0.2, -1.7, 0.0, 0.3, 0.0])
    held, falling = plant_of(loaded_puma560(FIXTURE), stretched), plant_of(loaded_puma560(FIXTURE), stretched)
    held.brakes_on = True
    for _ in range(200):
        held.step(np.zeros(6), 1e-3)
        falling.step(np.zeros(6), 1e-3)
    assert_allclose(held.position_rad, stretched, atol=1e-9)
    assert abs(falling.position_rad[1] - stretched[1]) > 0.02


def test_the_end_stop_ends_a_runaway() -> None:
    plant = plant_of(BARE)
    for _ in range(3000):
        plant.step(np.array([90.0, 0.0, 0.0, 0.0, 0.0, 0.0]) + BARE.gravity(plant.position_rad), 1e-3)
    assert plant.position_rad[0] == pytest.approx(LIMITS.upper_rad[0] + 0.05)
    assert plant.velocity_rad_s[0] == 0.0
