"""A rig: its devices, and what is known of where they sit. The stages see only this, real or simulated."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from surfuse.interfaces import Arm, Camera, Clock, RangeArray, RangeSensor
from surfuse.motion.clearance import ClearanceModel
from surfuse.motion.moving_arm import MovingArm
from surfuse.motion.obstacles import Obstacle
from surfuse.motion.planners import LinePlanner
from surfuse.node.counters import BusCounters
from surfuse.records import CameraFrame, FloatArray, IntArray, SensorSpec
from surfuse.rig.mounts import world_from_shoulder


@dataclass(frozen=True)
class Truth:
    """The true surface of the twin's part, for scoring only: vertices (V, 3) in the world, triangles (F, 3)."""

    vertices_m: FloatArray
    triangles: IntArray


def _nothing(obstacles: tuple[Obstacle, ...]) -> None:
    """A rig whose arm checks its motions by itself."""


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
