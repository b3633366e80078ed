import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from surfuse.arm_models import puma560
from surfuse.arm_models.puma560 import A_M, ALPHA_RAD, CONFIGURATIONS, D_M, LIMITS, Puma560
from surfuse.errors import DataError
from surfuse.geometry.chains import Chain
from surfuse.geometry.poses import pose, rotation_about

REFERENCE = json.loads((Path(__file__).parents[1] / "data" / "puma560_rtb_reference.json").read_text())
AT_WRIST = pose(np.eye(3), [0.0, 0.0, -puma560.FLANGE_OFFSET_M])
BARE = Puma560(np.eye(4), AT_WRIST)
ANGLES = st.lists(st.floats(-3.1, 3.1), min_size=6, max_size=6).map(np.array)


def turned(angles: np.ndarray) -> np.ndarray:
    """Angles modulo whole turns, in (-pi, pi]."""
    return np.angle(np.exp(1j * angles))


def link(q: float, d: float, a: float, alpha: float) -> np.ndarray:
    """One Denavit-Hartenberg link, factor by factor."""
    z, x = rotation_about([0, 0, 1], q), rotation_about([1, 0, 0], alpha)
    return pose(z, [0, 0, 0]) @ pose(np.eye(3), [0, 0, d]) @ pose(np.eye(3), [a, 0, 0]) @ pose(x, [0, 0, 0])


def random_arm(seed: int) -> Puma560:
    rng = np.random.default_rng(seed)
    base = pose(rotation_about(rng.normal(size=3), 1.0), rng.normal(size=3))
    return Puma560(base, pose(rotation_about(rng.normal(size=3), 2.0), 0.1 * rng.normal(size=3)))


def test_constants_are_those_of_the_reference() -> None:
    links = REFERENCE["links"]
    assert_allclose([row["d"] for row in links], D_M, atol=1e-12)
    assert_allclose([row["a"] for row in links], A_M, atol=1e-12)
    assert_allclose([row["alpha"] for row in links], ALPHA_RAD, atol=1e-12)
    assert_allclose([row["qlim"] for row in links], np.column_stack([LIMITS.lower_rad, LIMITS.upper_rad]), atol=1e-9)


def test_forward_against_the_reference() -> None:
    for case in REFERENCE["fk"]:
        assert_allclose(BARE.forward(case["q"]), case["T"], atol=1e-9)


def test_jacobian_against_the_reference() -> None:
    for case in REFERENCE["jacob0"]:
        assert_allclose(BARE.jacobian(case["q"]), case["J"], atol=1e-9)


@pytest.mark.parametrize("case", REFERENCE["ikine_a"], ids=lambda case: case["name"])
def test_all_eight_configurations_against_the_reference(case: dict) -> None:
    solutions = BARE.solutions(np.array([case["T"]]))[0]
    for k, name in enumerate(CONFIGURATIONS):
        expected = case["solutions"][name]
        if expected["success"]:
            assert_allclose(turned(solutions[k] - expected["q"]), 0.0, atol=1e-9)
        else:
            assert np.all(np.isnan(solutions[k]))


def test_unreachable_poses_are_nan_and_invalid() -> None:
    far = [case["T"] for case in REFERENCE["ikine_a"] if case["name"].startswith("unreachable")]
    poses = np.array([*far, np.full((4, 4), np.nan)])
    joints, valid = BARE.inverse(poses)
    assert not valid.any()
    assert np.isnan(joints).all()


def test_forward_is_the_product_of_the_links() -> None:
    arm = random_arm(3)
    rng = np.random.default_rng(4)
    base = arm.link_poses(np.zeros(6))[0]
    for joints in rng.uniform(-3.0, 3.0, (5, 6)):
        expected = [base]
        for q, d, a, alpha in zip(joints, D_M, A_M, ALPHA_RAD, strict=True):
            expected.append(expected[-1] @ link(q, d, a, alpha))
        links = arm.link_poses(joints)
        assert_allclose(links[:-1], expected, atol=1e-12)
        assert_allclose(links[-1], arm.forward(joints), atol=1e-15)


def test_jacobian_is_the_derivative_of_forward() -> None:
    arm = random_arm(5)
    joints, step = np.array([0.3, 0.7, -2.0, 0.4, 0.9, -1.1]), 1e-6
    jacobian = arm.jacobian(joints)
    for j in range(6):
        ahead, behind = (arm.forward(joints + sign * step * np.eye(6)[j]) for sign in (1, -1))
        rate = (ahead - behind) / (2 * step)
        assert_allclose(jacobian[:3, j], rate[:3, 3], atol=1e-8)
        spin = rate[:3, :3] @ arm.forward(joints)[:3, :3].T
        assert_allclose(jacobian[3:, j], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-8)


@settings(max_examples=60, deadline=None)
@given(ANGLES, st.integers(0, 5))
def test_every_solution_reaches_the_pose(joints: np.ndarray, seed: int) -> None:
    arm = random_arm(seed)
    target = arm.forward(joints)
    solutions = arm.solutions(target[None])[0]
    assert_allclose(arm.forward(solutions), np.broadcast_to(target, (8, 4, 4)), atol=2e-7)


def test_generic_poses_give_eight_different_solutions_with_the_source_among_them() -> None:
    rng = np.random.default_rng(7)
    joints = rng.uniform(LIMITS.lower_rad, LIMITS.upper_rad, (200, 6))
    joints = joints[BARE.singularity_distance(joints).min(axis=1) > 0.02]
    solutions, valid = BARE.inverse(BARE.forward(joints))
    gap = np.abs(turned(solutions - joints[:, None])).max(axis=2)
    assert np.all(gap.min(axis=1) < 1e-9)
    assert np.all(valid[np.arange(len(joints)), gap.argmin(axis=1)])
    between = np.abs(turned(solutions[:, :, None] - solutions[:, None])).max(axis=3) + 10.0 * np.eye(8)
    assert np.all(between.min(axis=(1, 2)) > 1e-3)


def test_valid_means_within_the_limits() -> None:
    rng = np.random.default_rng(8)
    joints, valid = BARE.inverse(BARE.forward(rng.uniform(-3.0, 3.0, (300, 6))))
    inside = np.all((joints >= LIMITS.lower_rad) & (joints <= LIMITS.upper_rad), axis=2)
    assert np.array_equal(valid, inside)
    # Joint 3 reaches -225 degrees: solutions at +170 must come back as -190.
    assert np.any(valid & (joints[..., 2] < -np.pi))


def test_the_compiled_solver_is_its_python_text() -> None:
    from surfuse.arm_models import puma560_closed_form as closed_form

    rng = np.random.default_rng(9)
    flange = np.ascontiguousarray(BARE.forward(rng.uniform(-2.0, 2.0, 6))[:3])
    sizes = np.array([D_M[0], A_M[1], A_M[2], D_M[2], D_M[3]])
    plain, fast = np.full((8, 6), np.nan), np.full((8, 6), np.nan)
    closed_form._solve_arm.py_func(flange, sizes, plain)  # type: ignore[attr-defined]
    closed_form._solve_arm(flange, sizes, fast)
    assert_allclose(fast, plain, atol=1e-14)


def test_stretched_arm_is_reached_despite_rounding() -> None:
    stretched = np.array([0.4, 0.3, -puma560._FOREARM_ANGLE_RAD, 0.2, 0.5, 0.1])
    for turn in np.linspace(-2.0, 2.0, 21):
        target = BARE.forward(stretched + turn * np.eye(6)[0])
        assert_allclose(BARE.forward(BARE.solutions(target[None])[0]), np.broadcast_to(target, (8, 4, 4)), atol=1e-7)


def test_singularities_are_where_the_jacobian_loses_rank() -> None:
    away = np.array([0.3, 0.7, -2.0, 0.4, 0.9, -1.1])
    elbow, wrist = away.copy(), away.copy()
    elbow[2] = -puma560._FOREARM_ANGLE_RAD
    wrist[4] = 0.0
    aligned = away.copy()
    forearm, angle = puma560._FOREARM_M, puma560._FOREARM_ANGLE_RAD
    aligned[1] = np.arctan2(A_M[1] + forearm * np.cos(aligned[2] + angle), forearm * np.sin(aligned[2] + angle))
    names = dict(zip(BARE.singularities, (aligned, elbow, wrist), strict=True))
    for column, (name, joints) in enumerate(names.items()):
        assert BARE.singularity_distance(joints)[column] < 1e-12, name
        assert np.linalg.svd(BARE.jacobian(joints))[1].min() < 1e-9, name
    assert BARE.singularity_distance(away).min() > 0.05
    assert np.linalg.svd(BARE.jacobian(away))[1].min() > 1e-3


def test_nearest_uses_the_closer_turn_of_joint_six() -> None:
    current = np.array([0.1, 0.8, -2.6, 0.2, 0.8, np.radians(200.0)])
    solutions, valid = BARE.inverse(BARE.forward(current)[None])
    joints, index = BARE.nearest_configuration(solutions, valid, current)
    assert CONFIGURATIONS[index[0]] == "ruf"
    assert_allclose(joints[0], current, atol=1e-9)


def test_nearest_without_a_valid_solution_is_nan() -> None:
    joints, index = BARE.nearest_configuration(np.full((2, 8, 6), np.nan), np.zeros((2, 8), dtype=bool), np.zeros(6))
    assert np.isnan(joints).all()
    assert index.tolist() == [-1, -1]


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(DataError, match=r"\(N, 4, 4\)"):
        BARE.inverse(np.eye(4))
    with pytest.raises(DataError, match="6"):
        BARE.forward(np.zeros(5))
    with pytest.raises(DataError, match="rigid"):
        Puma560(2.0 * np.eye(4), np.eye(4))
    with pytest.raises(DataError, match=r"d_m|a_m"):
        Chain(np.zeros(2), np.zeros(3), np.zeros(2), np.eye(4), np.eye(4))
