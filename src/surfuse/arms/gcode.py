"""A gantry, printer or router that takes G-code: it goes to places, and never turns its tool.

The board checks nothing but its own travel, so the driver does: limits before a move, the place after it, and that the
machine has not moved between two looks. No motor of such a machine has an encoder: a board that has lost steps without
noticing says that it is where it was sent.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from types import TracebackType
from typing import Literal, Self

import numpy as np

from surfuse.arm_models.cartesian import LOOKING_DOWN, UNTURNED, CartesianMachine
from surfuse.errors import ConfigError, DeviceError, SafetyStopError, UnreachableError
from surfuse.interfaces import GIVEN_BY_RIG, PoseArmSurroundings
from surfuse.records import BoolArray, FloatArray, ToolState
from surfuse.serial_line.gcode_board import Connection, GcodeBoard
from surfuse.serial_line.gcode_sharing import check_dialect, given_back, taken
from surfuse.serial_line.gcode_words import Millimetres, axes_words, shown

SUMMARY = "a gantry with a Marlin, Klipper or GRBL board, on a serial port"
NEEDS = ("serial",)
ALONE = PoseArmSurroundings()
_READS = 6
_SAME_MM = 0.02


@dataclass(frozen=True)
class Parameters:
    """Where the board is, how the machine stands in the world, and how it moves.

    `port`, `baud_bps`, `dialect`: the serial line, and "marlin" (also for Klipper) or "grbl" (1.1).
    `travel_min_m`, `travel_max_m`: least and greatest x, y, z of the machine's own coordinates.
    `world_from_machine`: where the machine stands, 4 x 4 row by row. `tool_turn`: the tool's axes in the machine, 3 x 3
    row by row, its third column along the beams; as it is, the tool looks along the machine's -z.
    `feed_mm_min`: speed of ways towards the part along the beams; `travel_feed_mm_min`: of all other ways.
    `settle_s`: rest after a move. `home`: home the machine when it is opened; it moves.
    `position_tolerance_m`: how far from where it was sent it may say to be. `turn_tolerance_deg`: how much a pose may
    be turned and still be taken.
    `answer_timeout_s`, `move_timeout_s`, `start_timeout_s`: longest wait for an answer, for the end of a move (or of
    homing), and for a board that starts anew because its port was opened.
    """

    port: str
    dialect: Literal["marlin", "grbl"]
    travel_min_m: tuple[float, float, float]
    travel_max_m: tuple[float, float, float]
    baud_bps: int = 115_200
    world_from_machine: tuple[float, ...] = UNTURNED
    tool_turn: tuple[float, ...] = LOOKING_DOWN
    feed_mm_min: float = 600.0
    travel_feed_mm_min: float = 3000.0
    settle_s: float = 0.2
    home: bool = False
    position_tolerance_m: float = 2e-4
    turn_tolerance_deg: float = 0.5
    answer_timeout_s: float = 5.0
    move_timeout_s: float = 120.0
    start_timeout_s: float = 12.0
    surroundings: PoseArmSurroundings = field(default=ALONE, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        check_dialect(self.dialect)
        _ = self.connection, self.machine
        for name, high in _POSITIVE.items():
            if not 0.0 < getattr(self, name) <= high:
                raise ConfigError(f"{name} = {getattr(self, name)}", cure=f"give more than 0 and at most {high:g}")
        if not 0.0 <= self.settle_s <= 60.0:
            raise ConfigError(f"settle_s = {self.settle_s}", cure="give 0 to 60 s")

    @property
    def connection(self) -> Connection:
        """The serial line."""
        return Connection(self.port, self.baud_bps, self.answer_timeout_s, self.start_timeout_s)

    @property
    def machine(self) -> CartesianMachine:
        """Its place in the world, its travel, and which way its tool looks."""
        turn_rad = float(np.radians(self.turn_tolerance_deg))
        return CartesianMachine(self.world_from_machine, self.tool_turn, self.travel_min_m, self.travel_max_m, turn_rad)


_POSITIVE = {
    "feed_mm_min": 1e5,
    "travel_feed_mm_min": 1e5,
    "position_tolerance_m": 0.01,
    "turn_tolerance_deg": 10.0,
    "move_timeout_s": 3600.0,
}


class GcodeArm:
    """An arm that goes to poses of one orientation."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters, self._clock = parameters, parameters.surroundings.clock
        self._machine = parameters.machine
        self._board: GcodeBoard | None = None
        self._rest_mm: Millimetres | None = None
        self._moving = False

    def __enter__(self) -> Self:
        board = taken(self._parameters.dialect, self._parameters.connection)
        try:
            if self._parameters.home:
                board.home(self._parameters.move_timeout_s)
            self._rest_mm = None
            self._board = board
            self._place_mm()
        except BaseException:
            self._board = None
            given_back(board)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        board, self._board = self._board, None
        if board is None:
            return
        try:
            if self._moving:
                board.stop()
        finally:
            self._moving = False
            given_back(board)

    def tool_state(self) -> ToolState:
        """Where the tool stands; see `PoseArm.tool_state`."""
        return self._state(self._place_mm())

    def reachable(self, world_from_tool: FloatArray) -> BoolArray:
        """Which poses (N, 4, 4) have the tool's one orientation, and a place within the travel."""
        return self._machine.reachable(np.asarray(world_from_tool, dtype=np.float64))

    def move_to_pose(self, world_from_tool: FloatArray, speed_share: float | None = None) -> ToolState:
        """Go to a pose (4, 4) on a straight line, settle, and say where the tool is; see `PoseArm.move_to_pose`."""
        excess = self._machine.excess(np.asarray(world_from_tool, dtype=np.float64))
        if excess is not None:
            raise UnreachableError(
                excess,
                cure="leave the pose out, or correct travel, world_from_machine and tool_turn",
                where=self._where,
            )
        board, start_mm = self._opened(), self._place_mm()
        target_mm = self._target_mm(world_from_tool)
        self._rest_mm, self._moving = None, True
        feed_mm_min = self._feed_mm_min(start_mm, target_mm) * (1.0 if speed_share is None else speed_share)
        board.go(target_mm, feed_mm_min, self._parameters.move_timeout_s)
        self._moving = False
        self._clock.advance(self._parameters.settle_s)
        reached_mm = self._place_mm()
        self._compare(target_mm, reached_mm, "the machine is {off} from where it was sent")
        return self._state(reached_mm)

    def stop(self) -> None:
        """Stop at once; a move under way in another thread ends with a `SafetyStopError`.

        Raises
        ------
        DeviceError : the port has vanished, or the machine does not come to rest.
        """
        self._rest_mm = None
        self._opened().stop()

    @property
    def _where(self) -> str:
        return self._parameters.port

    def _opened(self) -> GcodeBoard:
        if self._board is None:
            raise DeviceError("the arm is not open", cure="use it in a `with` block", where=self._where)
        return self._board

    def _place_mm(self) -> Millimetres:
        """Where the machine stands, which is where it stood: said twice alike, as the line has no check sum.

        Raises
        ------
        SafetyStopError : it is elsewhere, or two looks never agree.
        """
        board = self._opened()
        seen = [board.position_mm(), board.position_mm()]
        while len(seen) < _READS and _apart_mm(seen[-2], seen[-1]) > _SAME_MM:
            seen.append(board.position_mm())
        if _apart_mm(seen[-2], seen[-1]) > _SAME_MM:
            raise SafetyStopError(
                f"{_READS} looks at the position do not agree: {shown(seen[-2])}, then {shown(seen[-1])}",
                cure="it moves without being sent, or the line is disturbed: check both, then resume the run",
                where=self._where,
            )
        if self._rest_mm is not None:
            self._compare(self._rest_mm, seen[-1], "the machine has moved by {off} without a move")
        elif not self._moving:
            self._rest_mm = seen[-1]
        return seen[-1]

    def _compare(self, wanted_mm: Millimetres, found_mm: Millimetres, text: str) -> None:
        off_mm, most_mm = _apart_mm(wanted_mm, found_mm), 1e3 * self._parameters.position_tolerance_m
        if not off_mm <= most_mm:
            raise SafetyStopError(
                f"{text.format(off=f'{off_mm:.3f} mm')}, at most {most_mm:g} mm (it says {shown(found_mm)}, wanted "
                f"{axes_words(wanted_mm)})",
                cure="find out what moved it or lost steps, home it, then resume the run",
                where=self._where,
            )

    def _state(self, place_mm: Millimetres) -> ToolState:
        return ToolState(self._clock.now_s(), self._machine.tool_at(1e-3 * np.array(place_mm)))

    def _target_mm(self, world_from_tool: FloatArray) -> Millimetres:
        x, y, z = (round(1e3 * float(value), 3) for value in self._machine.place_of(np.asarray(world_from_tool)))
        return x, y, z

    def _feed_mm_min(self, start_mm: Millimetres, target_mm: Millimetres) -> float:
        """Slow towards the part, which is where the beams point."""
        way = np.array(target_mm) - np.array(start_mm)
        length = float(np.linalg.norm(way))
        near = length > 0.0 and float(self._machine.beam @ way) > 0.5 * length
        return self._parameters.feed_mm_min if near else self._parameters.travel_feed_mm_min


def _apart_mm(one: Millimetres, other: Millimetres) -> float:
    return float(np.linalg.norm(np.subtract(one, other)))


def create(parameters: Parameters) -> GcodeArm:
    """A machine that takes G-code."""
    return GcodeArm(parameters)
