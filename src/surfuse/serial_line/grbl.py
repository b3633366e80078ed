"""GRBL 1.1 on a serial line: real-time bytes, status reports, alarms (gnea/grbl wiki, "Grbl v1.1 Interface").

Moves and reports are in machine coordinates: `G53`, and `MPos`, or `WPos` with the offset `WCO` that GRBL sends with
every tenth to thirtieth report.
"""

from __future__ import annotations

import re
import time
from dataclasses import dataclass

from surfuse.errors import DeviceError, SafetyStopError, SurfuseError
from surfuse.serial_line.gcode_board import GcodeBoard
from surfuse.serial_line.gcode_words import Millimetres, axes_words, shown
from surfuse.serial_line.grbl_words import ALARMS, ERRORS, POSITION_KEPT

_NUMBER = r"(-?\d+\.\d+)"
_THREE = rf"{_NUMBER},{_NUMBER},{_NUMBER}(?:,-?\d+\.\d+)*"  # boards with more axes tell more
_REPORT = re.compile(rf"<([A-Z][a-z]+)(?::(\d+))?\|(MPos|WPos):{_THREE}(?:\|[^<>]*)?>")
_OFFSET = re.compile(rf"\|WCO:{_THREE}[|>]")
_CONTACT = re.compile(rf"\[PRB:{_THREE}:([01])\]")
_POLL_S = 0.1  # GRBL asks not to be asked more often than 5 to 10 times a second
_REST_S = 0.3  # GRBL may say Idle for a moment before it begins to move
_HALT_S = 5.0
_ASKS_FOR_OFFSET = 60
_ARRIVED_MM = 0.05
_MOVES = ("Run", "Jog", "Home")
_CURE_BY_STATE = {
    "Hold": "release the hold at the machine (~), or reset it, then resume the run",
    "Door": "close the safety door, then resume the run",
    "Check": "leave the check mode ($C)",
    "Sleep": "reset the machine and home it",
}


@dataclass(frozen=True)
class Report:
    """One status report: the state's word, its sub-state, the machine position in mm."""

    state: str
    part: str
    place_mm: Millimetres


class Grbl(GcodeBoard):
    """See the module."""

    _offset_mm: Millimetres | None = None

    @property
    def _stop_bytes(self) -> bytes:
        return b"!"

    def position_mm(self) -> Millimetres:
        """See `GcodeBoard.position_mm`."""
        with self._lock:
            self._get_in_step()
            report = self._report()
            self._check_state(report)
            if report.state in _MOVES:
                raise SafetyStopError(
                    f"the machine moves (state {report.state}, at {shown(report.place_mm)}) though it was not sent",
                    cure="leave it to surfuse alone, then resume the run",
                    where=self.where,
                )
            return report.place_mm

    def go(self, target_mm: Millimetres, feed_mm_min: float, limit_s: float) -> None:
        """See `GcodeBoard.go`."""
        with self._lock:
            self.command(f"G53 G1 {axes_words(target_mm)} F{feed_mm_min:.0f}")
            began_s, resting_s = time.monotonic(), float("nan")
            while True:
                self._check_stopped()
                report, now_s = self._report(), time.monotonic()
                self._check_state(report)
                if report.state != "Idle":
                    resting_s = float("nan")
                elif _near(report.place_mm, target_mm) or now_s - resting_s > _REST_S:
                    return
                elif resting_s != resting_s:
                    resting_s = now_s
                if now_s - began_s > limit_s:
                    self._too_slow(limit_s, report.place_mm)
                time.sleep(_POLL_S)

    def probe(self, target_mm: Millimetres, feed_mm_min: float, limit_s: float) -> Millimetres | None:
        """See `GcodeBoard.probe`; G38.3, which raises no alarm without a contact."""
        with self._lock:
            self._report()
            goal = self._in_work(target_mm)
            heard = self.command(f"G38.3 {axes_words(goal)} F{feed_mm_min:.0f}", limit_s)
            contacts = [found for line in heard if (found := _CONTACT.fullmatch(line))]
            if len(contacts) != 1:
                raise DeviceError(
                    f"the board says {len(contacts)} places of contact after one probing",
                    cure="probe again; check the line",
                    where=self.where,
                )
            *place, touched = contacts[0].groups()
            return _three(tuple(place)) if touched == "1" else None

    def home(self, limit_s: float) -> None:
        """See `GcodeBoard.home`."""
        with self._lock:
            # Not as a command: a machine that is locked until it has been homed takes nothing else.
            self._line.write(b"$H\n")
            self._until(lambda line: line == "ok", limit_s, "'$H'")

    def failure(self, line: str) -> SurfuseError | None:
        """See `GcodeBoard.failure`."""
        if found := re.fullmatch(r"ALARM:(\d+)", line):
            return self._alarm(int(found[1]))
        if found := re.fullmatch(r"error:(\d+)", line):
            what = ERRORS.get(int(found[1]), "a number that GRBL 1.1 does not have")
            return DeviceError(
                f"the board refuses: error:{found[1]}, {what}",
                cure="home or unlock the machine" if found[1] == "9" else "check dialect and settings of the board",
                where=self.where,
            )
        return None

    def is_banner(self, line: str) -> bool:
        """See `GcodeBoard.is_banner`."""
        return re.match(r"Grbl(HAL)? \d", line) is not None

    def _first_answer(self) -> None:
        self._ask_until(b"?", lambda heard: _REPORT.fullmatch(heard) is not None, 0.3)

    def _prepare(self) -> None:
        self._offset_mm = None
        self._check_state(self._report())
        settings = self.command("$$")
        if any(re.match(r"\$13=1\b", line) for line in settings):
            raise DeviceError("the board reports in inches ($13=1)", cure="send $13=0 to it once", where=self.where)
        for text in ("G21", "G90", "G94"):
            self.command(text)

    def _halt(self) -> None:
        """A reset in motion would lose the position: wait for the end of the hold, then reset."""
        give_up_s = time.monotonic() + _HALT_S
        while time.monotonic() < give_up_s:
            self._line.write(b"?")
            found = _REPORT.fullmatch(self._line.read(0.2) or "")
            if found is not None and found[1] not in _MOVES and found.group(1, 2) != ("Hold", "1"):
                break
            time.sleep(_POLL_S)
        self._line.write(b"\x18")
        while time.monotonic() < give_up_s:
            if self.is_banner(self._line.read(0.2) or ""):
                return
        raise DeviceError(
            f"the board does not come to rest within {_HALT_S:g} s", cure="press the emergency stop", where=self.where
        )

    def _report(self) -> Report:
        """Ask where the machine is; as often as it takes to know the offset of work coordinates."""
        for _ in range(_ASKS_FOR_OFFSET):
            self._line.write(b"?")
            line = self._until(
                lambda heard: _REPORT.fullmatch(heard) is not None, self.connection.answer_timeout_s, "'?'"
            )[-1]
            if offset := _OFFSET.search(line):
                self._offset_mm = _three(offset.groups())
            found = _REPORT.fullmatch(line)
            assert found is not None
            place_mm = _three(found.groups()[3:6])
            if found[3] == "MPos":
                return Report(found[1], found[2] or "", place_mm)
            if self._offset_mm is not None:
                return Report(found[1], found[2] or "", _plus(place_mm, self._offset_mm, 1.0))
        raise DeviceError(
            "the board reports work positions (WPos) and never their offset (WCO)",
            cure="send $10=1 to it once, so that it reports machine positions",
            where=self.where,
        )

    def _in_work(self, place_mm: Millimetres) -> Millimetres:
        """Machine to work coordinates, which probing takes; G53 does not go with it."""
        for _ in range(_ASKS_FOR_OFFSET):
            if self._offset_mm is not None:
                return _plus(place_mm, self._offset_mm, -1.0)
            self._report()
        raise DeviceError("the board never tells its work offset (WCO)", cure="send $10=1 to it", where=self.where)

    def _check_state(self, report: Report) -> None:
        if report.state == "Alarm":
            raise self._alarm(None)
        if report.state in _CURE_BY_STATE:
            raise SafetyStopError(
                f"the board is in the state {report.state}", cure=_CURE_BY_STATE[report.state], where=self.where
            )

    def _alarm(self, number: int | None) -> SafetyStopError:
        if number is None:
            what = "the board is in alarm: it was not homed since it started, or has hit a limit"
            cure = "home it ($H, or home = true), or unlock it ($X) if you are sure of its position"
        else:
            what = f"ALARM:{number}, {ALARMS.get(number, 'a number that GRBL 1.1 does not have')}"
            cure = "unlock it ($X)" if number in POSITION_KEPT else "free the machine, home it ($H)"
        return SafetyStopError(what, cure=f"{cure}, then resume the run", where=self.where)


def _three(words: tuple[str, ...]) -> Millimetres:
    x, y, z = (float(word) for word in words)
    return x, y, z


def _plus(one: Millimetres, other: Millimetres, sign: float) -> Millimetres:
    x, y, z = (a + sign * b for a, b in zip(one, other, strict=True))
    return x, y, z


def _near(one: Millimetres, other: Millimetres) -> bool:
    return all(abs(a - b) <= _ARRIVED_MM for a, b in zip(one, other, strict=True))
