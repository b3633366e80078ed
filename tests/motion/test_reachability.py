"""How fast a path may be run: known answers, refusals, and the library that the method was first published with."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline

from surfuse.motion.reachability import PathLimits, fastest_speeds


def straight(points: int = 101, square_max: float = np.inf, held: float = 0.0) -> tuple[np.ndarray, PathLimits]:
    """One joint that runs from 0 to 1, with an acceleration of at most 2."""
    grid, ones = np.linspace(0.0, 1.0, points), np.ones((points, 1))
    limits = PathLimits(ones, 0.0 * ones, held * ones, np.array([2.0]), np.full(points, square_max))
    return grid, limits


def test_a_straight_path_is_run_with_full_acceleration_and_full_braking():
    grid, limits = straight()
    assert_allclose(fastest_speeds(grid, limits), np.sqrt(4.0 * np.minimum(grid, 1.0 - grid)), atol=1e-9)


def test_no_speed_is_above_its_limit():
    grid, limits = straight(square_max=0.5)
    assert_allclose(fastest_speeds(grid, limits), np.sqrt(np.minimum(4.0 * np.minimum(grid, 1 - grid), 0.5)), atol=1e-9)


def test_a_load_that_is_held_leaves_less_to_one_side():
    grid, limits = straight(held=1.0)
    # |u + 1| <= 2: accelerate with 1, brake with 3.
    assert_allclose(fastest_speeds(grid, limits), np.sqrt(np.minimum(2.0 * grid, 6.0 * (1.0 - grid))), atol=2e-2)


@pytest.mark.parametrize("held", [2.5, -2.5])
def test_a_load_that_cannot_be_held_has_no_answer(held):
    grid, limits = straight(held=held)
    limits = PathLimits(0.0 * limits.a, limits.b, limits.c, limits.most, limits.square_max)
    assert fastest_speeds(grid, limits) is None


def test_a_load_that_only_pushes_has_no_way_to_start_or_end_at_rest():
    assert fastest_speeds(*straight(held=2.5)) is None
    assert fastest_speeds(*straight(held=-2.5)) is None


@pytest.mark.parametrize("seed", range(6))
def test_it_agrees_with_the_published_library(seed):
    toppra = pytest.importorskip("toppra")
    constraint, algorithm = pytest.importorskip("toppra.constraint"), pytest.importorskip("toppra.algorithm")
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(size=(8, 3)), axis=0)
    at = np.arange(8.0)
    spline = CubicSpline(at, points, bc_type="clamped")
    grid = np.linspace(0.0, 7.0, 57)
    speed, push = rng.uniform(0.5, 3.0, 3), rng.uniform(0.5, 3.0, 3)
    constraints = [
        constraint.JointVelocityConstraint(np.column_stack([-speed, speed])),
        constraint.JointAccelerationConstraint(
            np.column_stack([-push, push]), constraint.DiscretizationType.Interpolation
        ),
    ]
    toppra.setup_logging("ERROR")
    solver = algorithm.TOPPRA(
        constraints, toppra.SplineInterpolator(at, points, "clamped"), gridpoints=grid, solver_wrapper="seidel"
    )
    wanted = solver.compute_parameterization(0.0, 0.0)[1]
    along, bend = spline(grid, 1), spline(grid, 2)
    square = np.min(speed / np.maximum(np.abs(along), 1e-12), axis=1) ** 2
    found = fastest_speeds(grid, PathLimits(along, bend, np.zeros_like(along), push, square))
    assert_allclose(found, wanted, atol=1e-3 * wanted.max())
