"""A rig: its devices, and what is known of where they sit. The stages see only this, real or simulated."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from surfuse.acquisition.stop_arm import JointStopArm, PoseStopArm, StopArm
from surfuse.bridge.clock import ClockFindings
from surfuse.errors import ConfigError
from surfuse.interfaces import Arm, Camera, Clock, Device, PoseArm, RangeArray, RangeSensor
from surfuse.motion.clearance import ClearanceModel
from surfuse.motion.limits import JointLimits
from surfuse.motion.moving_arm import MovingArm
from surfuse.motion.obstacles import Obstacle
from surfuse.motion.planners import LinePlanner
from surfuse.node.counters import BusCounters
from surfuse.records import CameraFrame, FloatArray, IntArray, JointState, SensorSpec
from surfuse.rig.mounts import world_from_shoulder


@dataclass(frozen=True)
class Truth:
    """The true surface of the twin's part, for scoring only: vertices (V, 3) in the world, triangles (F, 3)."""

    vertices_m: FloatArray
    triangles: IntArray


def _supervised() -> None:
    """The driver of the arm notices by itself when it moves."""


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
    `smooth` is what a pass without stops needs (None: the arm must stand to be used). `look_again`: see `JointStopArm`.
    `limits` are those that its moves keep to (None: not known). `unchecked` says in words what of the arm the check of
    clearance cannot see.
    """

    arm: Arm
    clearance: Callable[[tuple[Obstacle, ...]], ClearanceModel] | None = None
    link_poses: Callable[[FloatArray], FloatArray] | None = None
    surround: Callable[[tuple[Obstacle, ...]], None] = _nothing
    smooth: SmoothMotion | None = None
    look_again: Callable[[], object] = _supervised
    limits: JointLimits | None = None
    unchecked: str = ""


class JointMover(Protocol):
    """What turns a camera on the shoulder: an arm, of which no model need be known."""

    def joint_state(self) -> JointState: ...
    def move_to(self, joints_rad: FloatArray) -> JointState:
        """Go there, settle, and return the state as reached; see `surfuse.interfaces.Arm`."""


@dataclass(frozen=True)
class Lookout:
    """What looks for the part: a camera, and perhaps a ranger, on the shoulder, that turn with joint 1.

    `turn_rad` are the angles of joint 1 from and to which it turns. `ready_rad` is the posture in which it does (None:
    that in which the arm stands). `shoulder_from_camera` and `shoulder_from_ranger` (4, 4) are poses in the frame that
    turns with joint 1 (origin on the floor, x outwards, z up); `world_from_floor` (4, 4) says where that frame is at
    joint 1 = 0 (None: in the origin of the world).
    """

    arm: JointMover
    camera: Camera
    turn_rad: tuple[float, float]
    ready_rad: FloatArray | None
    shoulder_from_camera: FloatArray
    ranger: RangeSensor | None = None
    shoulder_from_ranger: FloatArray | None = None
    world_from_floor: FloatArray | None = None

    def look(self, joint1_rad: float) -> CameraFrame:
        """Turn joint 1 in the ready posture and take a picture."""
        ready = self.arm.joint_state().position_rad if self.ready_rad is None else self.ready_rad
        target = ready.copy()
        target[0] = joint1_rad
        return self._frame(self.arm.move_to(target))

    def look_from_here(self) -> tuple[float, CameraFrame]:
        """Where joint 1 stands, and a picture from there; nothing moves."""
        state = self.arm.joint_state()
        return float(state.position_rad[0]), self._frame(state)

    def _frame(self, state: JointState) -> CameraFrame:
        image, t_s = self.camera.capture()
        place = self.on_shoulder(float(state.position_rad[0]), self.shoulder_from_camera)
        return CameraFrame(image, t_s, self.camera.model, place)

    def on_shoulder(self, joint1_rad: float, shoulder_from_device: FloatArray) -> FloatArray:
        """Pose (4, 4) in the world of what sits on the shoulder, at an angle of joint 1."""
        placed: FloatArray = world_from_shoulder(joint1_rad) @ shoulder_from_device
        return placed if self.world_from_floor is None else self.world_from_floor @ placed


@dataclass(frozen=True)
class Viewpoints:
    """What looks for the part: a camera on the tool or fixed in the world, and the places that it looks from.

    `place` says where the camera is now: `world_from_camera` (4, 4). `moves` bring it to its views, one after the
    other; without any it looks from where it is.
    """

    camera: Camera
    place: Callable[[], FloatArray]
    moves: tuple[Callable[[], object], ...] = ()

    def look(self) -> CameraFrame:
        """A picture from where the camera is."""
        image, t_s = self.camera.capture()
        return CameraFrame(image, t_s, self.camera.model, self.place())


def _no_streams(stage: str, index: int) -> None:
    """A real rig, which has no random streams to choose."""


def _not_supervised(by_hand: bool) -> None:
    """A rig whose arm may be moved by anyone at any time."""


def _looking(lookout: Lookout | Viewpoints | None) -> tuple[Device, ...]:
    """The devices that look for the part."""
    if lookout is None:
        return ()
    ranger = lookout.ranger if isinstance(lookout, Lookout) else None
    return (lookout.camera,) if ranger is None else (lookout.camera, ranger)


@dataclass(frozen=True)
class Stamps:
    """How well the stamps of a rig belong together, whose arm has the clock of a bridge.

    `others` are the sensors that the bridge does not stamp: their stamps are brought from this machine's clock to its.
    """

    clock: ClockFindings
    names: tuple[str, ...]
    others: tuple[str, ...]

    @property
    def off_s(self) -> tuple[float, ...]:
        """How far the stamps of each sensor may be off the arm's clock."""
        return tuple(self.clock.offset.uncertainty_s if name in self.others else 0.0 for name in self.names)

    def in_words(self) -> str:
        """One sentence without its end."""
        if not self.others:
            return f"all stamps are the bridge's; {self.clock.in_words()}"
        return f"{self.clock.in_words()}; so well the stamps of {', '.join(self.others)} are brought to the bridge's"


def _one_clock() -> Stamps | None:
    """A rig whose devices have one clock."""
    return None


@dataclass(frozen=True)
class Rig:
    """Devices and their known places: an array on an arm, and what else there is.

    The arm takes joints (`motion`), with the grip as its tool, or poses (`poses`), with the grip at `tool_from_grip`
    (4, 4) on its tool. `lookout` finds the part (None: the area to scan is given). `begin` tells a twin which stop
    comes next. `stamps` says how well the clocks belong together (None: there is one). `guide` tells the
    supervision of the arm whether a person moves it. `truth` is None in a real rig. `counters` counts what happened on
    the bus between host and array (None: there is no bus). `simulated`: time passes only when the devices say so.
    """

    clock: Clock
    array: RangeArray
    motion: JointMotion | None = None
    poses: PoseArm | None = None
    tool_from_grip: FloatArray = field(default_factory=lambda: np.eye(4))
    lookout: Lookout | Viewpoints | None = None
    begin: Callable[[str, int], None] = _no_streams
    guide: Callable[[bool], None] = _not_supervised
    stamps: Callable[[], Stamps | None] = _one_clock
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
            return JointStopArm(self.motion.arm, self.motion.look_again)
        assert self.poses is not None
        return PoseStopArm(self.poses, self.tool_from_grip)

    @property
    def devices(self) -> tuple[Device, ...]:
        """All devices, in the order in which they are opened."""
        arm = self.motion.arm if self.motion is not None else self.poses
        return (*(() if arm is None else (arm,)), *_looking(self.lookout), self.array)

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
