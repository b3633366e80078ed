"""The grid of a replayed scan lies where its stops look, however the wrist is turned."""

from __future__ import annotations

import numpy as np
import pytest

from surfuse.commands.fuse.map_of_log import grid_of
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import Readings, SensorSpec
from surfuse.runs.scan_log import ScanLog

SPEC = SensorSpec("us", "ultrasonic", 0.2, 1.2, float(np.radians(13.0)), 3e-4)


def scan(turn_deg: float) -> ScanLog:
    """One sensor on the grip axis, 43 cm in front of places of a plane turned about v; every tenth hears nothing."""
    turn = np.radians(turn_deg)
    turned = rotation_about([0.0, 1.0, 0.0], -turn) @ rotation_about([1.0, 0.0, 0.0], np.pi)
    u, v = np.meshgrid(np.arange(-5, 6) * 0.01, np.arange(-4, 5) * 0.01)
    places = np.column_stack([np.cos(turn) * u.ravel(), v.ravel(), np.sin(turn) * u.ravel()])
    m = len(places)
    position = places - 0.43 * turned[:, 2]
    silent = np.arange(m) % 10 == 3
    readings = Readings(
        specs=(SPEC,), t_s=np.arange(m) * 0.1, sensor=np.zeros(m), position_m=position,
        axis=np.tile(turned[:, 2], (m, 1)), range_m=np.where(silent, np.inf, 0.43), status=silent * 1,
        amplitude=np.full(m, np.nan), sigma_m=np.full(m, np.nan), count=np.ones(m), start=np.arange(m + 1),
        stop=np.arange(m), row=np.repeat(np.arange(9), 11),
        world_from_grip=np.array([pose(turned, p) for p in position]),
    )  # fmt: skip
    return ScanLog(readings, np.eye(4), False)


@pytest.mark.parametrize("turn_deg", [0.0, 5.0, 30.0, 60.0])
def test_the_grid_lies_on_the_places_looked_at(turn_deg: float) -> None:
    grid = grid_of(scan(turn_deg))
    np.testing.assert_allclose(grid.u_m, np.arange(-5, 6) * 0.01 * np.cos(np.radians(turn_deg)), atol=1e-9)
    np.testing.assert_allclose(grid.v_m, np.arange(-4, 5) * 0.01, atol=1e-9)
