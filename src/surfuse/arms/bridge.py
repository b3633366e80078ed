"""Any arm behind a bridge: a program that answers the bridge protocol, over TCP or as a child process."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from surfuse.bridge.child import ChildTransport
from surfuse.bridge.client import BridgeClient
from surfuse.bridge.clock import ClockFindings
from surfuse.bridge.consistency import Tolerances
from surfuse.bridge.messages import Ability, MoveTo, State
from surfuse.bridge.patience import Patience
from surfuse.bridge.shared import SharedBridge
from surfuse.bridge.transport import TcpTransport, Transport
from surfuse.errors import ConfigError, DeviceError
from surfuse.interfaces import GIVEN_BY_RIG, OpenedTogether
from surfuse.records import BoolArray, FloatArray, ToolState

SUMMARY = "any arm, by a program of yours that answers the bridge protocol"


@dataclass(frozen=True)
class Surroundings:
    """The connection that the sensors of the rig share with the arm."""

    bridge: SharedBridge


@dataclass(frozen=True)
class Parameters:
    """Where the bridge is, how long it may take, and how far its answers may be from what was asked.

    address : `tcp://host:port`; or
    command : the program and its arguments, which then talks on its standard input and output.
    allow_remote : whether the address may be another machine; nothing on the way is authenticated or encrypted.
    speed_share : share in (0, 1] of the arm's own speed; None leaves it to the bridge.
    answer_timeout_s, sweep_timeout_s, move_timeout_s : longest waits for one answer; a rig gives None for the sweep
        twice the time that its sensors need, at least 4 s.
    give_up_s : how long a bridge that does not answer is tried before the run ends with a device error.
    position_tolerance_m, angle_tolerance_rad : between the pose sent and the pose reached, and of an arm at rest.
    """

    address: str = ""
    command: tuple[str, ...] = ()
    allow_remote: bool = False
    speed_share: float | None = None
    answer_timeout_s: float = Patience.answer_timeout_s
    sweep_timeout_s: float | None = None
    move_timeout_s: float = Patience.move_timeout_s
    give_up_s: float = Patience.give_up_s
    position_tolerance_m: float = Tolerances.position_tolerance_m
    angle_tolerance_rad: float = Tolerances.angle_tolerance_rad
    surroundings: Surroundings | None = field(default=None, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        if bool(self.address) == bool(self.command):
            raise ConfigError(
                f"address = '{self.address}' and command = {list(self.command)}",
                cure="give one of them: address = 'tcp://127.0.0.1:5005', or command = ['python3', 'my_robot.py']",
            )
        if self.speed_share is not None and not 0.0 < self.speed_share <= 1.0:
            raise ConfigError(f"speed_share = {self.speed_share}", cure="give a share above 0, at most 1")
        self.patience()
        self.tolerances()

    def patience(self) -> Patience:
        """The waits."""
        return Patience(
            answer_timeout_s=self.answer_timeout_s,
            sweep_timeout_s=Patience.sweep_timeout_s if self.sweep_timeout_s is None else self.sweep_timeout_s,
            move_timeout_s=self.move_timeout_s,
            give_up_s=self.give_up_s,
        )

    def tolerances(self) -> Tolerances:
        """The tolerances."""
        return Tolerances(self.position_tolerance_m, self.angle_tolerance_rad)

    def transport(self) -> Transport:
        """The line to the bridge, not open yet."""
        if self.command:
            return ChildTransport(list(self.command))
        return TcpTransport(self.address, allow_remote=self.allow_remote)


class BridgeArm(OpenedTogether):
    """The arm of a bridge, sent to poses; see `surfuse.interfaces.PoseArm`."""

    def __init__(self, parameters: Parameters, bridge: SharedBridge) -> None:
        super().__init__(bridge)
        self._parameters, self._bridge = parameters, bridge

    @property
    def client(self) -> BridgeClient:
        """The conversation, while it is open."""
        return self._bridge.client

    @property
    def clock(self) -> ClockFindings:
        """How the bridge's clock and this machine's belong together."""
        return self._bridge.clock

    def tool_state(self) -> ToolState:
        """Where the tool stands now."""
        return _tool_state(self.client.state())

    def reachable(self, world_from_tool: FloatArray) -> BoolArray | None:
        """Which of the poses (N, 4, 4) the arm says it can take; None when the bridge does not say it."""
        if not self.client.can(Ability.REACH):
            return None
        return self.client.reach(np.asarray(world_from_tool, dtype=np.float64))

    def move_to_pose(self, world_from_tool: FloatArray, speed_share: float | None = None) -> ToolState:
        """Go to a pose (4, 4), settle, and return the state as reached; `speed_share` as in `PoseArm`."""
        speed = self._speed if speed_share is None else min(speed_share, self._speed or 1.0)
        return _tool_state(self.client.move(MoveTo(world_from_tool=world_from_tool, speed_share=speed)))

    @property
    def _speed(self) -> float | None:
        return self._parameters.speed_share


def _tool_state(state: State) -> ToolState:
    if state.world_from_tool is None:
        raise DeviceError(
            "the bridge says the joints of the arm, but not where its tool is",
            cure="let it answer 'world_from_tool' too, or give the arm's file: [arm] file = 'arm.urdf', tool = '...'",
        )
    joints = np.zeros(0) if state.joints_rad is None else state.joints_rad
    return ToolState(state.t_s, state.world_from_tool, joints)


def create(parameters: Parameters) -> BridgeArm:
    """An arm behind a bridge, sent to poses."""
    given = parameters.surroundings
    return BridgeArm(parameters, shared_bridge(parameters) if given is None else given.bridge)


def shared_bridge(parameters: Parameters) -> SharedBridge:
    """The connection, to be opened by whoever needs it first."""
    return SharedBridge(lambda: BridgeClient(parameters.transport(), parameters.patience(), parameters.tolerances()))
