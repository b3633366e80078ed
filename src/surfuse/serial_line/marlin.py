"""Marlin 2 and Klipper's G-code on a serial line (marlinfw.org, "G-code index": G1, G28, G38, M114, M400, M410)."""

from __future__ import annotations

import re

from surfuse.errors import DeviceError, SurfuseError
from surfuse.serial_line.gcode_board import GcodeBoard
from surfuse.serial_line.gcode_words import Millimetres, axes_words

_NUMBER = r"(-?\d+\.\d+)"
_PLACE = re.compile(rf"(?:ok )?X:\s*{_NUMBER} Y:\s*{_NUMBER} Z:\s*{_NUMBER}(?: .*)?")
_STOP_LIMIT_S = 5.0


class Marlin(GcodeBoard):
    """Positions are those of `M114`; `M400` is answered when all moves are done."""

    @property
    def _stop_bytes(self) -> bytes:
        return b"M410\n"

    def position_mm(self) -> Millimetres:
        """See `GcodeBoard.position_mm`."""
        with self._lock:
            heard = self.command("M114")
            places = [found for line in heard if (found := _PLACE.fullmatch(line))]
            if len(places) != 1:
                self._in_step = False
                raise DeviceError(
                    f"no position in the answer to M114 ('{heard[0][:60]}')",
                    cure="check dialect and baud_bps, and the line for noise",
                    where=self.where,
                )
            x, y, z = (float(word) for word in places[0].groups())
            return x, y, z

    def go(self, target_mm: Millimetres, feed_mm_min: float, limit_s: float) -> None:
        """See `GcodeBoard.go`."""
        with self._lock:
            self._motion(f"G1 {axes_words(target_mm)} F{feed_mm_min:.0f}", self.connection.answer_timeout_s)
            self._motion("M400", limit_s)

    def probe(self, target_mm: Millimetres, feed_mm_min: float, limit_s: float) -> Millimetres | None:
        """See `GcodeBoard.probe`; it needs a Marlin with G38_PROBE_TARGET.

        Marlin does not tell the contact: it stops there, and ends G38.3 without a complaint when there was none.
        """
        with self._lock:
            self._motion(f"G38.3 {axes_words(target_mm)} F{feed_mm_min:.0f}", limit_s)
            self._motion("M400", limit_s)
            place_mm = self.position_mm()
            reached = max(abs(a - b) for a, b in zip(place_mm, target_mm, strict=True))
            return None if reached < 0.02 else place_mm

    def home(self, limit_s: float) -> None:
        """See `GcodeBoard.home`."""
        with self._lock:
            self._motion("G28", limit_s)
            self._motion("M400", limit_s)

    def failure(self, line: str) -> SurfuseError | None:
        """See `GcodeBoard.failure`."""
        if line.startswith(("Error:", "!!")):
            return DeviceError(
                f"the board says '{line[:100]}'", cure="clear the cause, reset it, home the machine", where=self.where
            )
        if line.startswith(("Resend:", "rs ")):
            return DeviceError(
                f"the board did not understand a line ('{line[:60]}')", cure="check the cable", where=self.where
            )
        return None

    def is_banner(self, line: str) -> bool:
        """See `GcodeBoard.is_banner`."""
        return line == "start" or line.startswith(("Marlin ", "echo:Marlin ", "// Klipper state: Ready"))

    def _motion(self, text: str, limit_s: float) -> None:
        """A command that a board must not pass over."""
        for line in self.command(text, limit_s):
            if "nknown command" in line or re.search(r"Home .*first", line):
                self._in_step = False
                raise DeviceError(
                    f"the board does not do '{text}': '{line[:80]}'",
                    cure="home the machine; when it does not know the command, check dialect and firmware options",
                    where=self.where,
                )

    def _first_answer(self) -> None:
        self._ask_until(b"M114\n", lambda heard: _PLACE.fullmatch(heard) is not None, 1.0)

    def _prepare(self) -> None:
        # Boards without inch mode do not know G21, and say so.
        for text in ("G21", "G90"):
            self.command(text)

    def _halt(self) -> None:
        self._line.drain(0.3, _STOP_LIMIT_S)
