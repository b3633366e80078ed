"""One connection a board, however many drivers use it: an arm and a probe on one port share it."""

from __future__ import annotations

import threading

from surfuse.errors import ConfigError
from surfuse.serial_line.gcode_board import GcodeBoard

_OPEN: dict[str, GcodeBoard] = {}
_OPENING = threading.Lock()


def taken(board: GcodeBoard) -> GcodeBoard:
    """The board on this port, open: the one that another driver has opened, or this one.

    Raises
    ------
    ConfigError : another driver speaks to the same port in another way. DeviceError, SafetyStopError : as `take`.
    """
    port = board.where
    with _OPENING:
        known = _OPEN.get(port)
        if known is not None and (type(known), known.connection.baud_bps) != (type(board), board.connection.baud_bps):
            raise ConfigError(
                "two drivers use this port with different dialects or speeds",
                cure="give the same dialect and baud_bps to both",
                where=port,
            )
        shared = known or board
        shared.take()
        _OPEN[port] = shared
        return shared


def given_back(board: GcodeBoard) -> None:
    """End of the use of a board that was `taken`."""
    with _OPENING:
        if board.release():
            _OPEN.pop(board.where, None)
