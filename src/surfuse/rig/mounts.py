"""Where a camera or ranger sits on the shoulder of the arm, in the frame that turns with joint 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import FloatArray


def world_from_shoulder(joint1_rad: float) -> FloatArray:
    """The frame that turns with joint 1: origin on the floor under it, x outwards, z up."""
    cosine, sine = np.cos(joint1_rad), np.sin(joint1_rad)
    return pose([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]], [0.0, 0.0, 0.0])


_OUTWARDS = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class Mount:
    """Where a camera or ranger sits on the shoulder, and how it is turned out of the outward direction.

    `forward_m`, `left_m` and `height_m` are its place in the frame that turns with joint 1. It is turned to the left by
    `yaw_rad`, then downwards by `pitch_rad`, then about its own axis by `roll_rad`, clockwise as it looks.
    """

    forward_m: float
    height_m: float
    left_m: float = 0.0
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0

    @property
    def shoulder_from_device(self) -> FloatArray:
        """Pose (4, 4) of the device: z along its axis, x to its right, y down."""
        turn = rotation_about([0.0, 0.0, 1.0], self.yaw_rad)
        turn = turn @ rotation_about([0.0, 1.0, 0.0], self.pitch_rad) @ rotation_about([1.0, 0.0, 0.0], self.roll_rad)
        return pose(turn @ _OUTWARDS, [self.forward_m, self.left_m, self.height_m])


def mount_of(shoulder_from_device: FloatArray) -> Mount:
    """The mount that has this pose (4, 4); the device must not look straight up or down."""
    turn = shoulder_from_device[:3, :3] @ _OUTWARDS.T
    forward, left, height = shoulder_from_device[:3, 3].tolist()
    return Mount(
        forward,
        height,
        left,
        float(np.arctan2(turn[1, 0], turn[0, 0])),
        float(-np.arcsin(np.clip(turn[2, 0], -1.0, 1.0))),
        float(np.arctan2(turn[2, 1], turn[2, 2])),
    )


def looking_outwards(forward_m: float, height_m: float) -> FloatArray:
    """Pose of a camera or ranger on the shoulder: z outwards, x to its right, y down."""
    return Mount(forward_m, height_m).shoulder_from_device
