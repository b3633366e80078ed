"""What stands around a real arm, as far as a cell file says it: the part where it is scanned, the table under both."""

from __future__ import annotations

import numpy as np

from surfuse.geometry.poses import inverse
from surfuse.motion.obstacles import HalfSpace, Obstacle, part_box
from surfuse.records import FloatArray, Outline
from surfuse.rig.real.base import world_from_base
from surfuse.rig.real.shape import SENSOR_RADIUS_M
from surfuse.settings import Settings

_UPRIGHT = 0.7  # cosine of the angle between the base's z axis and w up to which both stand on one table
_BEHIND_M = 0.05
_LEAST_M = 1e-3
_COVER = 0.12  # spheres are larger than the rods that they cover by at most this share of the radius


def part_and_table(settings: Settings, outline: Outline) -> tuple[Obstacle, ...]:
    """The part as a box up to the height of its tallest point, and the table.

    Where the arm stands upright to the scanned plane (w = 0), or hangs over it, the table is that plane without an
    end; where its base stands lower, the plane through the base, and the part has a pedestal. Where it does not (a
    plate before an arm), nothing but the part is known.
    """
    box = part_box(outline, part_height_m(settings), _BEHIND_M)
    world_from_part, base = outline.world_from_part, world_from_base(settings)
    w = world_from_part[:3, 2]
    if abs(float(w @ base[:3, 2])) < _UPRIGHT:
        return (box,)
    foot_m = min(0.0, float((inverse(world_from_part) @ base)[2, 3]))
    x, y, z = (world_from_part[:3, 3] + foot_m * w).tolist()
    return box, HalfSpace((x, y, z), (float(w[0]), float(w[1]), float(w[2])))


def part_height_m(settings: Settings) -> float:
    """How far the part stands out of the scanned plane at most, but for what would reach the sensors.

    A part that reaches the sensors is refused, or warned of, when the settings are checked.
    """
    standoff_m = settings.scan.standoff_m
    tallest_m = settings.search.tallest_m if settings.area is None else settings.area.tallest_m
    wanted_m = 0.5 * standoff_m if tallest_m is None else tallest_m
    room_m = settings.arm.clearance_m + _COVER * _thickest_m(settings) + _LEAST_M
    return max(min(wanted_m, standoff_m - _ahead_m(settings) - room_m), _LEAST_M)


def _thickest_m(settings: Settings) -> float:
    return max((0.5 * (sensor.aperture_m or 0.0) for sensor in settings.sensor), default=0.0) + SENSOR_RADIUS_M


def _ahead_m(settings: Settings) -> float:
    """How far the foremost sensor, or the tool frame itself, is ahead of the grip along the beams."""
    positions: FloatArray = np.array([sensor.position_m for sensor in settings.sensor], dtype=np.float64).reshape(-1, 3)
    if len(positions) == 0:
        return 0.0
    axis = np.array([sensor.axis for sensor in settings.sensor], dtype=np.float64).mean(axis=0)
    axis /= np.linalg.norm(axis)
    along = np.vstack([positions, np.zeros(3)]) @ axis
    return float(np.max(along) - np.mean(along[:-1]))
