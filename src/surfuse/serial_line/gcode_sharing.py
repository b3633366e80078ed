"""One connection a board, however many drivers use it: an arm and a probe on one port share it."""

from __future__ import annotations

import threading

from surfuse.errors import ConfigError, nearest
from surfuse.serial_line.gcode_board import Connection, GcodeBoard
from surfuse.serial_line.grbl import Grbl
from surfuse.serial_line.marlin import Marlin

BOARDS: dict[str, type[GcodeBoard]] = {"marlin": Marlin, "grbl": Grbl}
_OPEN: dict[str, GcodeBoard] = {}
_OPENING = threading.Lock()


def check_dialect(dialect: str) -> None:
    """Raises ConfigError for a dialect that nobody speaks."""
    if dialect not in BOARDS:
        raise ConfigError(f"dialect = '{dialect}'", cure=nearest(dialect, BOARDS))


def taken(dialect: str, connection: Connection) -> GcodeBoard:
    """The board on a port, open: the one that another driver has opened, or a new one.

    Raises
    ------
    ConfigError : another driver speaks to the same port in another way.
    DeviceError : the port cannot be opened, or no board answers.
    """
    port, kind = connection.port, BOARDS[dialect]
    with _OPENING:
        board = _OPEN.get(port)
        if board is None:
            board = kind(connection)
        elif (type(board), board.connection.baud_bps) != (kind, connection.baud_bps):
            raise ConfigError(
                "two drivers use this port with different dialects or speeds",
                cure="give the same dialect and baud_bps to both",
                where=port,
            )
        board.take()
        _OPEN[port] = board
        return board


def given_back(board: GcodeBoard) -> None:
    """End of the use of a board that was `taken`; after the last one its port is closed."""
    with _OPENING:
        if board.release():
            _OPEN.pop(board.where, None)
