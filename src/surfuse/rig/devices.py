"""A rig: its devices, and what is known of where they sit. The stages see only this, real or simulated."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

import numpy as np

from surfuse.acquisition.stop_arm import JointStopArm, PoseStopArm, StopArm
from surfuse.errors import ConfigError
from surfuse.interfaces import Arm, Camera, Clock, Device, PoseArm, RangeArray, RangeSensor
from surfuse.motion.clearance import ClearanceModel
from surfuse.motion.limits import JointLimits
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
class JointMotion:
    """An arm that takes joints, and what is known of its shape.

    `clearance` makes the collision check for a list of obstacles, `link_poses` gives the poses of its links (None: the
    shape is not known). `surround` tells the check of all motions what stands around the arm, once that is known.
    `smooth` is what a pass without stops needs (None: the arm must stand to be used). `limits` are those that its
    moves keep to (None: not known). `unchecked` says in words what of the arm the check of clearance cannot see.
    """

    arm: Arm
    clearance: Callable[[tuple[Obstacle, ...]], ClearanceModel] | None = None
    link_poses: Callable[[FloatArray], FloatArray] | None = None
    surround: Callable[[tuple[Obstacle, ...]], None] = _nothing
    smooth: SmoothMotion | None = None
    limits: JointLimits | None = None
    unchecked: str = ""


@dataclass(frozen=True)
class Lookout:
    """What looks for the part: a camera and a ranger on the shoulder, that turn with joint 1.

    `ready_rad` is the posture in which joint 1 turns. `shoulder_from_camera` and `shoulder_from_ranger` (4, 4) are
    poses in the frame that turns with joint 1 (origin on the floor, x outwards, z up).
    """

    arm: Arm
    camera: Camera
    ranger: RangeSensor
    ready_rad: FloatArray
    shoulder_from_camera: FloatArray
    shoulder_from_ranger: FloatArray

    def look(self, joint1_rad: float) -> CameraFrame:
        """Turn joint 1 in the ready posture and take a picture."""
        target = self.ready_rad.copy()
        target[0] = joint1_rad
        state = self.arm.move_to(target)
        image, t_s = self.camera.capture()
        world_from_camera = world_from_shoulder(float(state.position_rad[0])) @ self.shoulder_from_camera
        return CameraFrame(image, t_s, self.camera.model, world_from_camera)


def _no_streams(stage: str, index: int) -> None:
    """A real rig, which has no random streams to choose."""


def _not_supervised(by_hand: bool) -> None:
    """A rig whose arm may be moved by anyone at any time."""


@dataclass(frozen=True)
class Rig:
    """Devices and their known places: an array on an arm, and what else there is.

    The arm takes joints (`motion`), with the grip as its tool, or poses (`poses`), with the grip at `tool_from_grip`
    (4, 4) on its tool. `lookout` finds the part (None: the area to scan is given). `begin` tells a twin which stop
    comes next. `guide` tells the supervision of the arm whether a person moves it. `truth` is None in a real rig.
    `counters` counts what happened on the bus between host and array (None: there is no bus). `simulated`: time passes
    only when the devices say so.
    """

    clock: Clock
    array: RangeArray
    motion: JointMotion | None = None
    poses: PoseArm | None = None
    tool_from_grip: FloatArray = field(default_factory=lambda: np.eye(4))
    lookout: Lookout | None = None
    begin: Callable[[str, int], None] = _no_streams
    guide: Callable[[bool], None] = _not_supervised
    truth: Truth | None = None
    warnings: tuple[str, ...] = ()
    counters: Callable[[], BusCounters] | None = None
    simulated: bool = False

    def __post_init__(self) -> None:
        if (self.motion is None) == (self.poses is None):
            raise ConfigError("a rig needs one arm", cure="give one that takes joints, or one that takes poses")

    @property
    def specs(self) -> tuple[SensorSpec, ...]:
        """The sensors of the array."""
        return self.array.fixture.specs

    @property
    def stop_arm(self) -> StopArm:
        """The arm as the walk through a plan uses it."""
        if self.motion is not None:
            return JointStopArm(self.motion.arm)
        assert self.poses is not None
        return PoseStopArm(self.poses, self.tool_from_grip)

    @property
    def devices(self) -> tuple[Device, ...]:
        """All devices, in the order in which they are opened."""
        arm = self.motion.arm if self.motion is not None else self.poses
        looking = () if self.lookout is None else (self.lookout.camera, self.lookout.ranger)
        return (*(() if arm is None else (arm,)), *looking, self.array)

    @contextmanager
    def opened(self) -> Iterator[None]:
        """All devices open, and closed on every way out."""
        with ExitStack() as stack:
            for device in self.devices:
                stack.enter_context(device)
            yield

    @contextmanager
    def guided(self) -> Iterator[None]:
        """While somebody else moves the arm: that it moves without being sent is no reason to stop then."""
        self.guide(True)
        try:
            yield
        finally:
            self.guide(False)

    def joint_motion(self, what: str) -> JointMotion:
        """The arm that takes joints.

        Raises
        ------
        ConfigError : this arm takes poses; `what` says what needs joints.
        """
        if self.motion is None:
            raise ConfigError(f"{what} needs an arm that takes joints", cure="this arm takes poses")
        return self.motion
