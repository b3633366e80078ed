"""What is asked and answered on the bridge, as frozen records: SI units, poses `world_from_tool` (4, 4)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from surfuse.bridge.fields import check_rigid
from surfuse.errors import DataError
from surfuse.records import BoolArray, ByteArray, FloatArray, Status
from surfuse.records.checks import own

PROTOCOL_VERSION = 1
MOST_SENSORS = 64
MOST_JOINTS = 64
MOST_PIXELS = 12 * 2**20  # base64 of so many bytes fills the 16 MiB of a line


class Question(StrEnum):
    """The word after `do`."""

    HELLO = "hello"
    STATE = "state"
    REACH = "reach"
    MOVE = "move"
    SWEEP = "sweep"
    IMAGE = "image"
    STOP = "stop"
    BEGIN = "begin"
    BYE = "bye"


class Ability(StrEnum):
    """What a bridge can do beyond states, moves and sweeps."""

    REACH = "reach"
    STOP = "stop"
    ECHOES = "echoes"
    ENVELOPE = "envelope"
    IMAGE = "image"
    STREAMS = "streams"


class Refusal(StrEnum):
    """Why a question was not done."""

    UNREACHABLE = "unreachable"
    SAFETY = "safety"
    DEVICE = "device"
    USAGE = "usage"


class ArmKind(StrEnum):
    """How an arm is sent somewhere."""

    JOINTS = "joints"
    CARTESIAN = "cartesian"


@dataclass(frozen=True)
class ArmOfBridge:
    """An arm that can be moved; `joints` is 0 for a cartesian one."""

    kind: ArmKind
    joints: int = 0


@dataclass(frozen=True)
class CameraOfBridge:
    """The size of the pictures."""

    width_px: int
    height_px: int


@dataclass(frozen=True)
class Hello:
    """What is behind the bridge. `arm` None: poses come with `state` only, somebody else moves."""

    name: str
    arm: ArmOfBridge | None
    sensors: tuple[str, ...]
    camera: CameraOfBridge | None = None
    can: frozenset[Ability] = frozenset()
    protocol: int = PROTOCOL_VERSION


@dataclass(frozen=True)
class State:
    """Where the arm is at `t_s` of the bridge's own clock: a pose, joints (J,) rad, or both."""

    t_s: float
    world_from_tool: FloatArray | None = None
    joints_rad: FloatArray | None = None

    def __post_init__(self) -> None:
        if self.world_from_tool is None and self.joints_rad is None:
            raise DataError("a state without 'world_from_tool' and without 'joints_rad'", cure="give one of them")
        if self.world_from_tool is not None:
            own(self, np.float64, world_from_tool=(4, 4))
            check_rigid(self.world_from_tool, "world_from_tool")
        if self.joints_rad is not None:
            own(self, np.float64, joints_rad=(None,))


@dataclass(frozen=True)
class Reach:
    """Which of the N poses asked for the arm can take: (N,)."""

    reachable: BoolArray

    def __post_init__(self) -> None:
        own(self, np.bool_, reachable=(None,))


@dataclass(frozen=True)
class MoveTo:
    """A move as it is asked for: to a pose or to joints, at a share in (0, 1] of the speed (None: the bridge's own)."""

    world_from_tool: FloatArray | None = None
    joints_rad: FloatArray | None = None
    speed_share: float | None = None

    def __post_init__(self) -> None:
        if (self.world_from_tool is None) == (self.joints_rad is None):
            raise DataError("a move needs one target", cure="give either 'world_from_tool' or 'joints_rad'")
        if self.speed_share is not None and not 0.0 < self.speed_share <= 1.0:
            raise DataError(f"speed_share = {self.speed_share}", cure="give a share above 0, at most 1")
        if self.world_from_tool is not None:
            own(self, np.float64, world_from_tool=(4, 4))
            check_rigid(self.world_from_tool, "world_from_tool")
        if self.joints_rad is not None:
            own(self, np.float64, joints_rad=(None,))


@dataclass(frozen=True)
class Envelope:
    """The strength of the echo over range: value k stands at `range0_m + k * bin_m`."""

    range0_m: float
    bin_m: float
    values: npt.NDArray[np.float32]

    def __post_init__(self) -> None:
        own(self, np.float32, values=(None,))


@dataclass(frozen=True)
class BridgeReading:
    """One sensor's answer. `range_m` as REP-117 (+inf nothing, -inf too close, nan fault); nan elsewhere: not said.

    `echoes` are (range_m, amplitude) in order of range. `spread_m` is the scatter of the `count` pings behind it.
    """

    sensor: str
    t_s: float
    range_m: float
    status: Status
    amplitude: float = float("nan")
    sigma_m: float = float("nan")
    echoes: tuple[tuple[float, float], ...] = ()
    envelope: Envelope | None = None
    spread_m: float = float("nan")
    count: int = 1


@dataclass(frozen=True)
class SweepAnswer:
    """The readings of one sweep; a sensor stands in it at most once."""

    readings: tuple[BridgeReading, ...]


@dataclass(frozen=True)
class Image:
    """One grey picture (H, W) uint8."""

    t_s: float
    grey: ByteArray

    def __post_init__(self) -> None:
        own(self, np.uint8, grey=(None, None))


@runtime_checkable
class Streamed(Protocol):
    """A simulated rig whose random numbers depend on the stop alone: it is told which one comes next."""

    def begin(self, stage: str, index: int) -> None: ...


class Bridgeable(Protocol):
    """A rig that can be put behind a bridge: it returns the answers, or raises errors of surfuse.

    UnreachableError becomes `unreachable`, SafetyStopError `safety`, UsageError, DataError and ConfigError `usage`,
    all else `device`. `stop` is called while a `move` is under way, from another thread; all else one at a time.
    """

    def hello(self) -> Hello: ...
    def state(self) -> State: ...
    def reach(self, world_from_tool: FloatArray) -> BoolArray:
        """Which of the poses (N, 4, 4) can be taken: (N,)."""

    def move(self, to: MoveTo) -> State:
        """Go there, settle, and say where the arm stands."""

    def sweep(self, sensors: tuple[str, ...]) -> SweepAnswer:
        """Fire these sensors, one after the other or together."""

    def image(self) -> Image: ...
    def stop(self) -> State:
        """Stop at once, also a move under way."""
