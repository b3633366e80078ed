"""A cell: its devices, and what is known of where they sit. The stages see only this, real or simulated."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import numpy as np

from surfuse.geometry.poses import pose, rotation_about
from surfuse.interfaces import Arm, Camera, Clock, RangeArray, RangeSensor
from surfuse.motion.clearance import ClearanceModel
from surfuse.motion.moving_arm import MovingArm
from surfuse.motion.obstacles import Obstacle
from surfuse.motion.planners import LinePlanner
from surfuse.node.counters import BusCounters
from surfuse.records import CameraFrame, FloatArray, IntArray, SensorSpec


@dataclass(frozen=True)
class Truth:
    """The true surface of the twin's part, for scoring only: vertices (V, 3) in the world, triangles (F, 3)."""

    vertices_m: FloatArray
    triangles: IntArray


def _nothing(obstacles: tuple[Obstacle, ...]) -> None:
    """A cell whose arm checks its motions by itself."""


@dataclass(frozen=True)
class SmoothMotion:
    """The arm as one that other devices are used on while it moves, and its planner for a speed of the tool (m/s)."""

    arm: MovingArm
    planner: Callable[[float], LinePlanner]


@dataclass(frozen=True)
class Rig:
    """Devices and their known places.

    `ready_rad` is the posture in which joint 1 turns during the search. `shoulder_from_camera` and
    `shoulder_from_ranger` (4, 4) are poses in the frame that turns with joint 1 (origin on the floor, x outwards,
    z up). `clearance` makes the collision check for a list of obstacles. `begin` tells a twin which stop comes next;
    a real cell ignores it. `truth` is None in a real cell. `counters` counts what happened on the bus between host and
    array (None: there is no bus). `smooth` is what a pass without stops needs (None: the arm must stand to be used).
    `surround` tells the check of all motions what stands around the arm, once that is known.
    """

    clock: Clock
    arm: Arm
    camera: Camera
    ranger: RangeSensor
    array: RangeArray
    ready_rad: FloatArray
    shoulder_from_camera: FloatArray
    shoulder_from_ranger: FloatArray
    clearance: Callable[[tuple[Obstacle, ...]], ClearanceModel]
    link_poses: Callable[[FloatArray], FloatArray]
    begin: Callable[[str, int], None]
    truth: Truth | None = None
    warnings: tuple[str, ...] = ()
    counters: Callable[[], BusCounters] | None = None
    smooth: SmoothMotion | None = None
    surround: Callable[[tuple[Obstacle, ...]], None] = _nothing

    @property
    def specs(self) -> tuple[SensorSpec, ...]:
        """The sensors of the array."""
        return self.array.fixture.specs

    @contextmanager
    def opened(self) -> Iterator[None]:
        """All devices open, and closed on every way out."""
        with ExitStack() as stack:
            for device in (self.arm, self.camera, self.ranger, self.array):
                stack.enter_context(device)
            yield

    def look(self, joint1_rad: float) -> CameraFrame:
        """Turn joint 1 in the ready posture and take a picture."""
        target = self.ready_rad.copy()
        target[0] = joint1_rad
        state = self.arm.move_to(target)
        image, t_s = self.camera.capture()
        world_from_camera = world_from_shoulder(float(state.position_rad[0])) @ self.shoulder_from_camera
        return CameraFrame(image, t_s, self.camera.model, world_from_camera)


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
