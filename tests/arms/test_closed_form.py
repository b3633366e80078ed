"""Inverse kinematics of arms from files in closed form: the same answers as the numeric way, and more of them."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

pytest.importorskip("mujoco")
sys.path.insert(0, str(Path(__file__).parent))
from test_model_file import SIX, inside, seven

from surfuse.arm_models import model_file
from surfuse.arm_models.closed_form import in_columns
from surfuse.arm_models.model_file import ModelFileArm, Parameters
from surfuse.geometry.poses import pose

# No three axes are parallel or meet, and no two neighbours do: there is no closed form.
CROOKED = SIX.replace('axis="0 1 0" range="-160 160"', 'axis=".3 1 .2" range="-160 160"').replace(
    'name="a5" axis="0 0 -1"', 'name="a5" axis=".4 .3 -1"'
)


def arm_of(folder: Path, text: str, name: str, tool: str, **how: object) -> ModelFileArm:
    (folder / name).write_text(text)
    return model_file.create(folder / name, tool, pose(np.eye(3), [0.1, 0.0, 0.9]), np.eye(4), Parameters(**how))  # type: ignore[arg-type]


def test_the_closed_form_finds_every_solution(tmp_path: Path) -> None:
    pytest.importorskip("eaik")
    arm = arm_of(tmp_path, SIX, "six.xml", "flange")
    assert arm.has_closed_form
    joints = inside(arm, 200)
    for q, target in zip(joints, arm.forward(joints), strict=True):
        found, valid = arm.inverse(target[None])
        assert_allclose(arm.forward(found[valid]), np.repeat(target[None], valid.sum(), axis=0), atol=1e-8)
        assert np.all((found[valid] >= arm.lower_rad) & (found[valid] <= arm.upper_rad))
        assert np.abs(np.angle(np.exp(1j * (found[valid] - q)))).max(axis=1).min() < 1e-6


def test_the_numeric_way_gives_no_other_answers(tmp_path: Path) -> None:
    pytest.importorskip("eaik")
    closed = arm_of(tmp_path, SIX, "six.xml", "flange")
    numeric = arm_of(tmp_path, SIX, "six.xml", "flange", closed_form=False)
    assert not numeric.has_closed_form
    for target in closed.forward(inside(closed, 20)):
        (all_of_them,), (there,) = closed.inverse(target[None])
        (some,), (reached,) = numeric.inverse(target[None])
        assert reached.any()
        assert there.sum() >= reached.sum()
        for q in some[reached]:
            assert np.abs(np.angle(np.exp(1j * (all_of_them[there] - q)))).max(axis=1).min() < 1e-6


def test_configurations_stay_in_their_columns_along_a_path(tmp_path: Path) -> None:
    pytest.importorskip("eaik")
    arm = arm_of(tmp_path, SIX, "six.xml", "flange")
    path = np.repeat(arm.forward(np.radians([20.0, -60.0, 90.0, -40.0, 70.0, 10.0]))[None], 40, axis=0)
    path[:, 2, 3] += np.linspace(0.0, 0.2, 40)
    joints, valid = arm.inverse(path)
    whole = valid.all(axis=0)
    assert whole.sum() >= 4
    assert np.abs(np.diff(joints[:, whole], axis=0)).max() < 0.2


@pytest.mark.parametrize(
    ("text", "name", "tool"), [(seven(), "seven.urdf", "tool"), (CROOKED, "crooked.xml", "flange")]
)
def test_arms_without_a_closed_form_are_solved_numerically(tmp_path: Path, text: str, name: str, tool: str) -> None:
    arm = arm_of(tmp_path, text, name, tool)
    assert not arm.has_closed_form
    target = arm.forward(inside(arm, 1))
    found, valid = arm.inverse(target)
    assert valid.any()
    assert_allclose(arm.forward(found[valid]), np.repeat(target, valid.sum(), axis=0), atol=1e-8)


def test_columns_follow_their_solution_over_turns_and_gaps() -> None:
    lower, upper = np.full(1, -4.0), np.full(1, 4.0)
    nan = np.nan
    found = np.array([[[3.0], [0.0], [nan]], [[0.1], [-3.0], [nan]], [[nan], [nan], [nan]], [[-2.9], [0.3], [nan]]])
    joints, reached = in_columns(found, lower, upper, 3)
    assert_allclose(joints[reached[:, 0], 0, 0], [0.0, 0.1, 0.3])
    assert_allclose(joints[reached[:, 1], 1, 0], [3.0, 2.0 * np.pi - 3.0, 2.0 * np.pi - 2.9])
    assert reached.tolist() == [[True, True, False], [True, True, False], [False, False, False], [True, True, False]]


def test_solutions_outside_the_limits_are_none() -> None:
    joints, reached = in_columns(np.array([[[2.0], [0.5]]]), np.full(1, -1.0), np.full(1, 1.0), 2)
    assert reached.tolist() == [[True, False]]
    assert joints[0, 0, 0] == 0.5
