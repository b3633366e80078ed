"""Forward model and oriented points against the geometry of planes, spheres and edges."""

from __future__ import annotations

import numpy as np
import pytest

from surfuse.beam_model.echo.arrivals import MIRROR, RIM, SPECKLE
from surfuse.beam_model.echo.detector import DetectorModel, beam_table
from surfuse.beam_model.heard.stations import Stations
from surfuse.beam_model.heard.wavefronts import find_surfels
from surfuse.beam_model.prior.raster import Raster
from surfuse.beam_model.search.estimation import Estimation, arrivals, free_space, problem
from surfuse.records import FloatArray, SensorSpec

WIDE = SensorSpec("us", "ultrasonic", 0.2, 1.2, float(np.radians(26.0)), 3e-4, frequency_hz=63e3, aperture_m=0.0147)
LASER = SensorSpec("tof", "laser", 0.02, 2.0, float(np.radians(2.0)), 1e-3)
RASTER = Raster(-0.1, -0.1, 0.005, np.ones((41, 41), dtype=bool))
U, V = np.meshgrid(*RASTER.nodes())


def stations(position: FloatArray, range_m: FloatArray) -> Stations:
    m = len(position)
    return Stations(
        position, np.tile([0.0, 0.0, -1.0], (m, 1)), range_m, np.full(m, 1e-4), np.full(m, np.nan),
        np.zeros(m, dtype=np.int64), np.ones(m, dtype=np.int64), np.arange(m),
    )  # fmt: skip


def line(spec: SensorSpec = WIDE) -> Estimation:
    u = np.arange(-0.04, 0.0401, 0.01)
    position = np.column_stack([u, np.full(len(u), 0.003), np.full(len(u), 0.43)])
    return problem(stations(position, np.full(len(u), 0.43)), (beam_table(spec, 440, DetectorModel()),), RASTER, 0.01)


def test_a_facing_plane_is_heard_at_its_distance() -> None:
    heard = arrivals(line(), np.zeros(RASTER.shape), 0.003)
    assert np.all(heard.kind == MIRROR)
    np.testing.assert_allclose(heard.range_m, 0.43, atol=5e-5)
    np.testing.assert_allclose(heard.gain, -1.0)


@pytest.mark.parametrize("tilt_deg", [3.0, 8.0])
def test_a_tilted_plane_is_heard_at_its_perpendicular_distance(tilt_deg: float) -> None:
    p, slope = line(), np.tan(np.radians(tilt_deg))
    heard = arrivals(p, slope * U, 0.003)
    s = p.stations.position_m
    perpendicular = (s[:, 2] - slope * s[:, 0]) * np.cos(np.radians(tilt_deg))
    assert np.all(heard.kind == MIRROR)
    late = heard.range_m - perpendicular
    assert np.all((late > -1e-5) & (late < 6e-4))


def test_a_sphere_is_heard_at_the_foot_on_its_surface() -> None:
    p, radius = line(), 0.3
    heard = arrivals(p, np.sqrt(radius**2 - U**2 - V**2) - radius, 0.003)
    centre = np.array([0.0, 0.0, -radius])
    distance = np.linalg.norm(p.stations.position_m - centre, axis=1) - radius
    late = heard.range_m - distance
    assert np.all((late > -5e-5) & (late < 5e-4))


def test_beside_a_step_the_rim_is_heard_and_late() -> None:
    p = line()
    heard = arrivals(p, np.where(U < -0.0026, 0.09, 0.0), 0.003)
    beside = p.stations.position_m[:, 0] > 0.009
    assert np.all(heard.kind[beside] == RIM)
    edge = np.hypot(p.stations.position_m[beside, 0], 0.34)
    assert np.all(heard.range_m[beside] > edge - 1e-4)
    assert np.all(heard.range_m[beside] < edge + 0.01)


def test_a_steep_plane_is_heard_as_speckle_near_the_axis() -> None:
    p = line()
    heard = arrivals(p, np.tan(np.radians(35.0)) * U, 0.01)
    assert np.all(heard.kind == SPECKLE)
    assert np.all(heard.scatter_m > 1e-3)


def test_light_is_heard_on_the_axis_whatever_the_tilt() -> None:
    p = line(LASER)
    heard = arrivals(p, 0.5 * U, 0.01)
    np.testing.assert_allclose(heard.range_m, 0.43 - 0.5 * p.stations.position_m[:, 0], atol=1e-9)


def test_derivative_of_the_arrival_by_finite_differences() -> None:
    p = line()
    height = 0.05 * U
    heard, raised = arrivals(p, height, 0.003), arrivals(p, height + 1e-5, 0.003)
    np.testing.assert_allclose((raised.range_m - heard.range_m) / 1e-5, heard.gain, rtol=0.02)


def test_free_space_of_a_facing_plane_is_the_plane() -> None:
    u = np.arange(-0.08, 0.0801, 0.01)
    uu, vv = np.meshgrid(u, u)
    position = np.column_stack([uu.ravel(), vv.ravel(), np.full(uu.size, 0.43)])
    p = problem(stations(position, np.full(uu.size, 0.43)), line().tables, RASTER, 0.01)
    bound = free_space(p, np.arange(uu.size))
    inner = (np.abs(U) < 0.07) & (np.abs(V) < 0.07)
    assert np.all(bound[inner] > -1e-9)
    assert np.all(bound[inner] < 1e-3)


def grid_of_stations(distance: FloatArray, u: FloatArray, v: FloatArray) -> Stations:
    position = np.column_stack([u.ravel(), v.ravel(), np.full(u.size, 0.43)])
    return stations(position, distance.ravel())


def test_oriented_points_lie_on_a_sphere() -> None:
    u, v = np.meshgrid(np.arange(-0.05, 0.051, 0.01), np.arange(-0.05, 0.051, 0.01))
    radius = 0.25
    s = grid_of_stations(np.sqrt(u**2 + v**2 + (0.43 + radius) ** 2) - radius, u, v)
    found = find_surfels(s, 0.01, np.full(len(s), 0.4))
    assert np.mean(found.coherent) > 0.9
    off = np.linalg.norm(found.point_m[found.coherent] - [0.0, 0.0, -radius], axis=1) - radius
    assert np.max(np.abs(off)) < 3e-4


def test_oriented_points_gather_on_an_edge() -> None:
    u, v = np.meshgrid(np.arange(0.02, 0.061, 0.01), np.arange(-0.05, 0.051, 0.01))
    s = grid_of_stations(np.hypot(u, 0.34), u, v)
    found = find_surfels(s, 0.01, np.full(len(s), 0.4))
    # At the border of the scan the neighbours lie on one side only.
    inner = (s.position_m[:, 0] > 0.025) & (s.position_m[:, 0] < 0.055) & (np.abs(s.position_m[:, 1]) < 0.045)
    assert np.all(found.coherent[inner])
    assert np.max(np.abs(found.point_m[inner, 0])) < 6e-3


def test_noise_as_of_speckle_is_not_coherent() -> None:
    u, v = np.meshgrid(np.arange(-0.05, 0.051, 0.01), np.arange(-0.05, 0.051, 0.01))
    s = grid_of_stations(0.43 + np.random.default_rng(0).exponential(0.01, u.shape), u, v)
    assert np.mean(find_surfels(s, 0.01, np.full(len(s), 0.15)).coherent) < 0.3
