"""The rig as it truly is, where that differs from what is known of it; the one reader of `[hidden]`."""

from __future__ import annotations

import numpy as np

from surfuse.errors import ConfigError
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import Fixture, FloatArray
from surfuse.settings import Settings
from surfuse.settings.rig_tables import Vector

RIGHT: Vector = (0.0, 0.0, 0.0)


def true_fixture(settings: Settings, fixture: Fixture) -> Fixture:
    """Where the sensors of the array truly sit; the fixture itself where nothing is hidden.

    Raises
    ------
    ConfigError : errors of more sensors than there are.
    """
    hidden = settings.hidden
    if hidden is None or not (hidden.sensor_mm or hidden.sensor_deg):
        return fixture
    count = len(fixture)
    if max(len(hidden.sensor_mm), len(hidden.sensor_deg)) > count:
        raise ConfigError(
            f"hidden.sensor_mm and sensor_deg hold {len(hidden.sensor_mm)} and {len(hidden.sensor_deg)} vectors",
            cure=f"give at most {count}, one a sensor",
        )
    placed = np.array(fixture.grip_from_sensor)
    for number in range(count):
        given = (hidden.sensor_mm, hidden.sensor_deg)
        away, turn = (vectors[number] if number < len(vectors) else RIGHT for vectors in given)
        placed[number, :3, :3] = _turned(turn) @ placed[number, :3, :3]
        placed[number, :3, 3] += 1e-3 * np.array(away)
    return Fixture(placed, fixture.specs)


def true_place(settings: Settings, place: FloatArray) -> FloatArray:
    """Where in the world (4, 4) something on the arm truly is; `place`: where it would be if the base stood right."""
    hidden = settings.hidden
    if hidden is None or (hidden.base_mm == RIGHT and hidden.base_deg == RIGHT):
        return place
    found: FloatArray = pose(_turned(hidden.base_deg), 1e-3 * np.array(hidden.base_mm)) @ place
    return found


def true_camera(settings: Settings, place: FloatArray) -> FloatArray:
    """Where the camera (4, 4) truly sits, in the frame of the place that it is taken to have."""
    hidden = settings.hidden
    if hidden is None or (hidden.camera_mm == RIGHT and hidden.camera_deg == RIGHT):
        return place
    found: FloatArray = place @ pose(_turned(hidden.camera_deg), 1e-3 * np.array(hidden.camera_mm))
    return found


def true_air(settings: Settings) -> tuple[float, float]:
    """True temperature in degrees Celsius, and the factor on the speed of sound that belongs to it."""
    hidden = settings.hidden
    if hidden is None:
        return settings.air.temperature_c, 1.0
    return settings.air.temperature_c + hidden.temperature_k, 1.0 + 0.01 * hidden.speed_percent


def _turned(turn_deg: Vector) -> FloatArray:
    """Rotation (3, 3) of a rotation vector in degrees."""
    angle = float(np.linalg.norm(turn_deg))
    return np.eye(3) if angle == 0.0 else rotation_about(turn_deg, float(np.radians(angle)))
