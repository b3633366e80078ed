"""The Protocols on one page: what a camera, an arm, a range sensor, a fusion method and a file format must do.

Devices are context managers without side effects in their constructors. Drivers are dumb: they neither validate nor
fuse.

A plug-in is a module. For devices, fusion methods and control laws it has exactly

- `SUMMARY: str`, one line for lists;
- `Parameters`, a frozen dataclass that checks itself: the fields that a file or `--set` may name, each with its unit;
- `create(parameters: Parameters)`, which opens and starts nothing;
- `NEEDS: tuple[str, ...]`, only where it imports optional packages when it is opened: their import names.

What a driver needs and no file can name (the clock, the kinematics, in the simulated rig the world) comes from the rig
as one record in the last field, `surroundings: ... = field(default=..., metadata=GIVEN_BY_RIG)`. Every kind has its
usual record (`SensorSurroundings`, `CameraSurroundings`, `PoseArmSurroundings`,
`motion.arm_surroundings.ArmSurroundings`), which a real rig can give; a driver that needs more, as the simulated ones
do, asks for a record derived from it. Where the default is None, the driver cannot do without (`surrounded`). So a rig
makes any device in one way: it takes its own keys out of the table, gives the others and the surroundings to
`registry.parameters`, and the result to `create`.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Protocol, Self, TypeVar, runtime_checkable

import numpy as np

from surfuse.errors import ConfigError
from surfuse.records import (
    BoolArray,
    ByteArray,
    CameraModel,
    Echo,
    Fixture,
    FloatArray,
    FusedPoints,
    FusionResult,
    FusionScene,
    JointState,
    MapGrid,
    Readings,
    SensorSpec,
    SurfaceMap,
    Sweep,
    ToolState,
)

GIVEN_BY_RIG: Mapping[str, bool] = MappingProxyType({"given_by_rig": True})
"""Metadata of the field `surroundings` of a plug-in's `Parameters`: no file can name it."""
S = TypeVar("S")


class Device(Protocol):
    """Anything with a connection: opened by `with`, closed on every way out."""

    def __enter__(self) -> Self: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class AlwaysOpen:
    """Base of devices without a connection: nothing to open, nothing to close."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return None


class OpenedTogether:
    """Base of devices made of other devices: opened in order, all or none, and closed in reverse."""

    def __init__(self, *parts: Device) -> None:
        self._parts, self._open = parts, ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as opening:
            for part in self._parts:
                opening.enter_context(part)
            self._open = opening.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.__exit__(kind, error, trace)


class Clock(Protocol):
    """Time that only goes forward; simulated devices advance a simulated one."""

    def now_s(self) -> float: ...
    def advance(self, duration_s: float) -> None: ...


class MonotonicClock:
    """Seconds of the machine that never go back; waiting is real."""

    def now_s(self) -> float:
        """Seconds since an arbitrary moment."""
        return time.monotonic()

    def advance(self, duration_s: float) -> None:
        """Wait."""
        time.sleep(max(duration_s, 0.0))


MACHINE_CLOCK = MonotonicClock()


def surrounded(surroundings: S | None, driver: str) -> S:
    """The surroundings of a driver that cannot do without.

    Raises
    ------
    ConfigError : there are none.
    """
    if surroundings is None:
        raise ConfigError(f"the driver '{driver}' stands in no rig", cure="give Parameters(surroundings=...)")
    return surroundings


class Camera(Device, Protocol):
    """A monochrome camera."""

    @property
    def model(self) -> CameraModel: ...
    def capture(self) -> tuple[ByteArray, float]:
        """One image (H, W) uint8 and its time in seconds."""


@dataclass(frozen=True)
class CameraSurroundings:
    """What a rig tells a camera: its lens and pixels, as calibrated, and the clock of the rig."""

    model: CameraModel
    clock: Clock = MACHINE_CLOCK


class Kinematics(Protocol):
    """A serial arm of J joints with a named tool frame; base and tool transforms included."""

    @property
    def lower_rad(self) -> FloatArray: ...
    @property
    def upper_rad(self) -> FloatArray: ...
    def forward(self, joints_rad: FloatArray) -> FloatArray:
        """Pose of the tool in the world: (..., J) -> (..., 4, 4)."""

    def inverse(self, world_from_tool: FloatArray) -> tuple[FloatArray, BoolArray]:
        """All solutions for poses (N, 4, 4): joints (N, K, J), and which (N, K) reach the pose within the joint limits.

        Column k is the same configuration of the arm in every row; joints are nan where the pose is out of reach.
        """

    @property
    def singularities(self) -> tuple[str, ...]:
        """Names of the singularities of the arm."""

    def singularity_distance(self, joints_rad: FloatArray) -> FloatArray:
        """How far joints (..., J) are from each named singularity: (..., len(singularities)) in [0, 1], 0 on it."""


class Arm(Device, Protocol):
    """An arm that goes to joint positions and says where it is."""

    @property
    def kinematics(self) -> Kinematics: ...
    def joint_state(self) -> JointState: ...
    def move_to(self, joints_rad: FloatArray, speed_share: float | None = None) -> JointState:
        """Go there, settle, and return the state as reached.

        `speed_share` in (0, 1] of the arm's joint speeds, where that is slower than it is set to; None: as it is set.

        Raises
        ------
        SafetyStopError : the target is outside a limit; the arm has not moved.
        DeviceError : the arm did not get there.
        """


@runtime_checkable
class PoseArm(Device, Protocol):
    """An arm that goes to poses of its tool; its own controller finds the joints."""

    def tool_state(self) -> ToolState:
        """Where the tool stands now.

        Raises
        ------
        SafetyStopError : it is not where it was sent, though nothing moved it.
        DeviceError : the arm does not answer.
        """

    def reachable(self, world_from_tool: FloatArray) -> BoolArray | None:
        """Which of the poses (N, 4, 4) the arm can take: (N,); None when it cannot tell."""

    def move_to_pose(self, world_from_tool: FloatArray, speed_share: float | None = None) -> ToolState:
        """Go to a pose (4, 4), settle, and return the state as reached.

        `speed_share` in (0, 1] of the arm's own speed; None: the one that it is set to.

        Raises
        ------
        UnreachableError : the arm cannot go there; it has not moved.
        SafetyStopError, DeviceError : the arm was stopped, or did not get there.
        """


@dataclass(frozen=True)
class PoseArmSurroundings:
    """What a rig tells an arm that goes to poses: the clock of the rig."""

    clock: Clock = MACHINE_CLOCK


class RangeSensor(Device, Protocol):
    """One ranger; its spec is known before it is opened."""

    @property
    def spec(self) -> SensorSpec: ...
    def fire(self) -> Echo:
        """One trigger, one averaged answer; no echo is an answer, not an error."""


@dataclass(frozen=True)
class SensorSurroundings:
    """What a rig tells a ranger: its clock, and what it knows of this ranger (None: what the driver says)."""

    clock: Clock = MACHINE_CLOCK
    spec: SensorSpec | None = None

    def known(self, usual: SensorSpec) -> SensorSpec:
        """The spec: that of the rig, else the driver's."""
        return usual if self.spec is None else self.spec


STANDING_ALONE = SensorSurroundings()
"""Of a ranger that is used without a rig."""


class RangeArray(Device, Protocol):
    """The sensors of a fixture, fired one after the other."""

    @property
    def fixture(self) -> Fixture: ...
    def sweep(self) -> tuple[Echo, ...]:
        """One answer a sensor, in the order of the fixture."""


@runtime_checkable
class World(Protocol):
    """All that a simulated device may feel of the twin: echoes and light, never the truth itself."""

    def ping(
        self, world_from_sensor: FloatArray, spec: SensorSpec, pings: int, t_s: float
    ) -> tuple[FloatArray, FloatArray]:
        """Ranges (pings,) and amplitudes (pings,) of repeated emissions from one pose."""

    def image(self, camera: CameraModel, world_from_camera: FloatArray) -> ByteArray: ...
    def repeatability(self, joints: int) -> FloatArray:
        """Error (J,) rad that the arm makes at this stop."""

    def begin(self, stage: str, index: int) -> None:
        """Choose the random stream of a stop: it depends on seed, stage and index alone."""


@runtime_checkable
class FusionMethod(Protocol):
    """Readings in, fused points (and perhaps a map) out, with explicit state.

    Every field of its `Parameters` has a default. Live (`start`, `step`, `finish`) and replayed (`replay`) fusion give
    the same numbers to the last bit.
    """

    @property
    def name(self) -> str: ...
    def start(self, scene: FusionScene) -> object:
        """A fresh state."""

    def step(self, state: object, sweep: Sweep) -> FusedPoints:
        """Take in one sweep: the state moves on, the one point of this stop is returned."""

    def finish(self, state: object, grid: MapGrid) -> FusionResult:
        """All points so far; methods which need all readings at once make their map here."""

    def replay(self, scene: FusionScene, readings: Readings, grid: MapGrid) -> FusionResult:
        """The whole scan at once."""


@runtime_checkable
class LiveMapping(Protocol):
    """A `FusionMethod` that can also show its map while the scan runs."""

    def preview(self, state: object, grid: MapGrid) -> SurfaceMap:
        """The map of the sweeps so far; the final map does not depend on whether it was asked for."""


class MapFormat(Protocol):
    """One file format of maps; the plug-in module itself has all that stands here.

    `MARKS_PRIOR` says whether it writes the cells that only the prior fills, marked as such; else it leaves them out.
    A format that cannot be read back has, instead of `read`, the reason in `NOT_READ: str`.
    """

    SUMMARY: str
    SUFFIXES: tuple[str, ...]
    MARKS_PRIOR: bool

    def write(self, path: Path, surface: SurfaceMap) -> None: ...
    def read(self, path: Path) -> SurfaceMap: ...


Generator = np.random.Generator
