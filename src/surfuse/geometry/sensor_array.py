"""The sensors on the tool as an array: where its grip axis is, how far its sensors are apart."""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import pdist, squareform

from surfuse.errors import ConfigError
from surfuse.geometry.poses import FloatArray, inverse, pose

SINGLE_STEP_M = 0.01
"""Distance between stops for a rig of one sensor."""

_SAME_PLACE_M = 1e-4


def tool_from_sensors(position_m: FloatArray, axis: FloatArray) -> FloatArray:
    """Poses (S, 4, 4) of sensors in the frame of the tool: origin on the face, z along the beam.

    What turns about the beam is of no use and chosen near the tool's own x.
    """
    return np.stack([pose(_turn(a), p) for p, a in zip(position_m, axis, strict=True)])


def tool_from_grip(position_m: FloatArray, axis: FloatArray) -> FloatArray:
    """The grip (4, 4) in the frame of the tool: the mean of the sensors' places, z along the mean of their beams.

    Raises
    ------
    ConfigError : the beams have no common direction, or point back along the tool's z.
    """
    mean = axis.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length < 0.5:
        raise ConfigError(
            f"the sensors look in different directions (their mean axis has the length {length:.2f})",
            cure="give axes that point at the part, roughly along the tool's z",
        )
    if mean[2] <= 0.0:
        raise ConfigError(
            f"the sensors look along {np.round(mean / length, 2).tolist()} in the frame of the tool: back at it",
            cure="z of the tool points along the beams: turn the axes, or the tool frame of the arm",
        )
    return pose(_turn(mean / length), position_m.mean(axis=0))


def grip_from_sensors(position_m: FloatArray, axis: FloatArray) -> FloatArray:
    """Poses (S, 4, 4) of the sensors in the frame of the grip."""
    placed: FloatArray = inverse(tool_from_grip(position_m, axis)) @ tool_from_sensors(position_m, axis)
    return placed


def spacing_m(position_m: FloatArray, axis: FloatArray) -> float | None:
    """Median distance of a sensor to its nearest neighbour, across the beams; None for a single place."""
    across = grip_from_sensors(position_m, axis)[:, :2, 3]
    distance = squareform(pdist(across)) if len(across) > 1 else np.zeros((1, 1))
    np.fill_diagonal(distance, np.inf)
    apart = distance.min(axis=1)
    apart = apart[np.isfinite(apart) & (apart > _SAME_PLACE_M)]
    return float(np.median(apart)) if len(apart) else None


def step_m(position_m: FloatArray, axis: FloatArray) -> float:
    """Distance between stops: a fifth of the sensors' spacing (paper, section 3.2), or that of a single sensor."""
    spacing = spacing_m(position_m, axis)
    return SINGLE_STEP_M if spacing is None else spacing / 5.0


def _turn(z: FloatArray) -> FloatArray:
    """Rotation (3, 3) whose third column is the unit vector z, its first as near to x as it can be."""
    x = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
