"""A touch probe on a machine that takes G-code: it drives towards the part until the probe touches, and back.

The range is the way from where the machine stood to the contact. The probe shares the line of the arm `gcode`, which
finds the machine where it left it. It never drives further than its greatest range.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from types import TracebackType
from typing import Literal, Self

import numpy as np

from surfuse.errors import ConfigError, DeviceError
from surfuse.interfaces import GIVEN_BY_RIG, STANDING_ALONE, SensorSurroundings
from surfuse.records import Echo, SensorSpec, Status
from surfuse.sensors.polaroid import within_limits
from surfuse.serial_line.gcode_board import Connection, GcodeBoard
from surfuse.serial_line.gcode_sharing import check_dialect, given_back, taken
from surfuse.serial_line.gcode_words import Millimetres

SUMMARY = "touch probe on a gantry with a Marlin or GRBL board, on its serial port"
NEEDS = ("serial",)
SPEC = SensorSpec(
    name="gcode_probe",
    kind="touch",
    range_min_m=0.0005,
    range_max_m=0.05,
    beam_full_angle_rad=float(np.radians(1.0)),
    sigma_m=2e-5,
    incidence_limit_rad=float(np.radians(60.0)),
    firing_time_s=5.0,
)
DOWN = (0.0, 0.0, -1.0)


@dataclass(frozen=True)
class Parameters:
    """Where the board is, and how it probes.

    port, baud_bps, dialect : as of the arm `gcode`.
    towards : unit vector in which the probe drives, in the machine's coordinates; it must be the sensor's axis there.
    probe_feed_mm_min : speed towards the part, on which the repeatability of the probe depends.
    back_feed_mm_min : speed back.
    answer_timeout_s, probe_timeout_s, start_timeout_s : longest wait for an answer, for the end of a probing, and for a
        board that starts anew because its port was opened.
    """

    port: str
    dialect: Literal["marlin", "grbl"]
    baud_bps: int = 115_200
    towards: tuple[float, float, float] = DOWN
    probe_feed_mm_min: float = 100.0
    back_feed_mm_min: float = 1000.0
    answer_timeout_s: float = 5.0
    probe_timeout_s: float = 120.0
    start_timeout_s: float = 12.0
    surroundings: SensorSurroundings = field(default=STANDING_ALONE, metadata=GIVEN_BY_RIG)

    def __post_init__(self) -> None:
        check_dialect(self.dialect)
        _ = self.connection
        length = float(np.linalg.norm(self.towards))
        if not abs(length - 1.0) <= 1e-3:
            raise ConfigError(f"towards has the length {length:.6g}", cure="give a unit vector, as 0, 0, -1 for down")
        for name, high in (("probe_feed_mm_min", 5e3), ("back_feed_mm_min", 1e5), ("probe_timeout_s", 3600.0)):
            if not 0.0 < getattr(self, name) <= high:
                raise ConfigError(f"{name} = {getattr(self, name)}", cure=f"give more than 0 and at most {high:g}")

    @property
    def connection(self) -> Connection:
        """The serial line."""
        return Connection(self.port, self.baud_bps, self.answer_timeout_s, self.start_timeout_s)


class GcodeProbe:
    """A ranger that touches."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters, self._clock = parameters, parameters.surroundings.clock
        self._spec = parameters.surroundings.known(SPEC)
        self._board: GcodeBoard | None = None

    def __enter__(self) -> Self:
        self._board = taken(self._parameters.dialect, self._parameters.connection)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        board, self._board = self._board, None
        if board is not None:
            given_back(board)

    @property
    def spec(self) -> SensorSpec:
        """What is known of this probe; it drives at most its greatest range."""
        return self._spec

    def fire(self) -> Echo:
        """Drive to the contact and back; nothing within reach is an answer.

        Raises
        ------
        SafetyStopError : the probe touches already, or the machine was stopped; it has not been driven back.
        DeviceError : the board does not answer or refuses, or the port has vanished.
        """
        if self._board is None:
            raise DeviceError("the probe is not open", cure="use it in a `with` block", where=self._parameters.port)
        asked, board, started_s = self._parameters, self._board, self._clock.now_s()
        start_mm = board.position_mm()
        goal_mm = self._ahead_mm(start_mm)
        try:
            contact_mm = board.probe(goal_mm, asked.probe_feed_mm_min, asked.probe_timeout_s)
            board.go(start_mm, asked.back_feed_mm_min, asked.probe_timeout_s)
        except KeyboardInterrupt:
            board.stop()
            raise
        if contact_mm is None:
            return Echo(float("inf"), Status.NO_ECHO, started_s, count=0)
        way_m = 1e-3 * float(np.subtract(contact_mm, start_mm) @ np.array(asked.towards))
        return within_limits(Echo(way_m, Status.OK, started_s), self._spec)

    def _ahead_mm(self, start_mm: Millimetres) -> Millimetres:
        ahead = np.array(start_mm) + 1e3 * self._spec.range_max_m * np.array(self._parameters.towards)
        x, y, z = (round(float(value), 3) for value in ahead)
        return x, y, z


def create(parameters: Parameters) -> GcodeProbe:
    """A touch probe on a machine that takes G-code."""
    return GcodeProbe(parameters)
