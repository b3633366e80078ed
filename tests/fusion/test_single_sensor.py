"""One reading a stop: the chosen sensor's, or the next one's where it has none."""

from __future__ import annotations

import dataclasses

import numpy as np

from surfuse.fusion import single_sensor


def test_takes_only_the_chosen_sensor(scan):
    scene, readings = scan(lambda u, v: 0.0 * u)
    wrong = dataclasses.replace(readings, range_m=np.where(readings.sensor == 2, 0.43, 0.5))
    points = single_sensor.create(single_sensor.Parameters(sensor=2)).replay(scene, wrong, _grid(scene)).points
    np.testing.assert_allclose(points.depth_m, 0.43, atol=1e-12)
    np.testing.assert_array_equal(points.dc, np.where(readings.sensor == 2, 1.0, 0.0))
    np.testing.assert_allclose(points.sigma_m, 0.0003)


def test_the_next_in_turn_stands_in(scan):
    scene, readings = scan(lambda u, v: 0.0 * u, outlined=False)
    ranges = np.where(readings.sensor == 3, np.inf, 0.40 + 0.01 * readings.sensor)
    status = np.where(readings.sensor == 3, 1, 0)
    silent = dataclasses.replace(readings, range_m=ranges, status=status)
    points = single_sensor.create(single_sensor.Parameters(sensor=3)).replay(scene, silent, _grid(scene)).points
    np.testing.assert_allclose(points.depth_m, 0.40, atol=1e-12)


def test_the_map_stands_on_the_sensors_own_axis(scan, mapped):
    slope = np.tan(np.radians(15.0))
    scene, readings = scan(lambda u, v: slope * u, nu=14, nv=10, outlined=False)
    surface = mapped("single_sensor", scene, readings)
    # Sensor 0 sits 25 mm to the left and below: the last stops' side of the map stays a gap.
    assert surface.mask[:7, :11].all()
    assert not surface.mask[:, -1].any()
    inside = np.tile(surface.grid.u_m, (10, 1))[1:7, 1:10]
    np.testing.assert_allclose(surface.height_m[1:7, 1:10], slope * inside, atol=1e-9)


def _grid(scene):
    from surfuse.records import MapGrid

    return MapGrid(np.arange(3) * 0.01, np.arange(3) * 0.01, scene.world_from_part)
