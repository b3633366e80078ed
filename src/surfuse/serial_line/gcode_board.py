"""A board that takes G-code on a serial line: one command at a time, its `ok` awaited, its failures named.

Its answers carry no number that says which command they belong to, so after silence or a complaint the conversation is
begun anew: a late `ok` must not be taken for that of the next command.
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import NoReturn

from surfuse.errors import ConfigError, DeviceError, SafetyStopError, SurfuseError
from surfuse.serial_line.gcode_words import Millimetres, shown
from surfuse.serial_line.text_line import TextLine

_POLL_S = 0.05
_QUIET_S = 0.15


@dataclass(frozen=True)
class Connection:
    """Where a board is, and how long it may take to answer.

    Parameters
    ----------
    port, baud_bps : the serial line.
    answer_timeout_s : longest wait for the answer to a command that moves nothing.
    start_timeout_s : longest wait for its first answer: most boards start anew when their port is opened.
    """

    port: str
    baud_bps: int = 115_200
    answer_timeout_s: float = 5.0
    start_timeout_s: float = 12.0

    def __post_init__(self) -> None:
        if not self.port:
            raise ConfigError("port = ''", cure="give a serial port; `surfuse devices` lists them")
        if not 1_200 <= self.baud_bps <= 4_000_000:
            raise ConfigError(f"baud_bps = {self.baud_bps}", cure="give 1200 to 4000000; most boards have 115200")
        for name in ("answer_timeout_s", "start_timeout_s"):
            if not 0.0 < getattr(self, name) <= 600.0:
                raise ConfigError(f"{name} = {getattr(self, name)}", cure="give more than 0 and at most 600 s")


class GcodeBoard(ABC):
    """What Marlin and GRBL have in common; positions in mm, in the machine's own coordinates."""

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self.where = connection.port
        self._line = TextLine(connection.port, connection.baud_bps, "a machine with G-code")
        self._lock = threading.RLock()
        self._users = 0
        self._in_step = self._prepared = self._stopped = False
        self._lost: SafetyStopError | None = None

    @abstractmethod
    def position_mm(self) -> Millimetres:
        """Where the machine stands.

        Raises
        ------
        SafetyStopError : it moves, or is in a state in which it cannot be moved.
        DeviceError : it does not answer.
        """

    @abstractmethod
    def go(self, target_mm: Millimetres, feed_mm_min: float, limit_s: float) -> None:
        """Drive there on a straight line; returns at the end of the motion, wherever that is.

        Raises
        ------
        SafetyStopError : the machine was stopped. DeviceError : it refuses, is silent, or takes longer than that.
        """

    @abstractmethod
    def probe(self, target_mm: Millimetres, feed_mm_min: float, limit_s: float) -> Millimetres | None:
        """Drive towards a target until the probe touches: where that was, None without a contact; as `go`."""

    @abstractmethod
    def home(self, limit_s: float) -> None:
        """Find the switches; the machine moves."""

    @abstractmethod
    def failure(self, line: str) -> SurfuseError | None:
        """What a line of the board means when it is a complaint; None when it is none."""

    @abstractmethod
    def is_banner(self, line: str) -> bool:
        """Whether a board says so when it starts."""

    @abstractmethod
    def _first_answer(self) -> None:
        """Talk to a board that may still be starting, until question and answer belong together."""

    @abstractmethod
    def _prepare(self) -> None:
        """Set units and the like."""

    @abstractmethod
    def _halt(self) -> None:
        """Come to rest after `stop`, and forget all that was to be done."""

    @property
    @abstractmethod
    def _stop_bytes(self) -> bytes:
        """What stops the machine."""

    def take(self) -> None:
        """One more user; the first one opens the port and waits for the board."""
        with self._lock:
            if self._users == 0:
                self._line.open()
                self._lost, self._prepared, self._stopped = None, False, False
                try:
                    self._first_answer()
                except BaseException:
                    self._line.close()
                    raise
                self._in_step = True
            self._users += 1

    def release(self) -> bool:
        """One user less; the last one closes the port: then True."""
        with self._lock:
            self._users -= 1
            if self._users == 0:
                self._line.close()
            return self._users == 0

    def stop(self) -> None:
        """Stop the machine at once; a move under way in another thread ends with a `SafetyStopError`.

        Raises
        ------
        DeviceError : the port has vanished, or the machine does not come to rest.
        """
        self._stopped = True
        self._line.write(self._stop_bytes)
        with self._lock:
            self._halt()
            self._in_step = False

    def command(self, text: str, limit_s: float | None = None) -> list[str]:
        """Send one command and wait for its ok: all lines up to that one.

        Raises
        ------
        SafetyStopError : the board is in alarm, was stopped, or has started anew.
        DeviceError : it refuses or is silent.
        """
        with self._lock:
            self._get_in_step()
            self._line.write(text.encode("ascii") + b"\n")
            return self._until(_is_ok, self.connection.answer_timeout_s if limit_s is None else limit_s, f"'{text}'")

    def _until(self, done: Callable[[str], bool], limit_s: float, asked: str) -> list[str]:
        """All lines until one is the end of the answer."""
        give_up_s, heard = time.monotonic() + limit_s, list[str]()
        while time.monotonic() < give_up_s:
            self._check_stopped()
            line = self._line.read(_POLL_S)
            if line is None:
                continue
            self._check(line)
            heard.append(line)
            if done(line):
                self._check_stopped()
                return heard
        self._in_step = False
        last = f"it last said '{heard[-1][:60]}'" if heard else "it said nothing"
        raise DeviceError(
            f"no answer to {asked} within {limit_s:g} s ({last})",
            cure="check supply, cable and baud_bps, or allow more time; surfuse asks again from the beginning",
            where=self.where,
        )

    def _check(self, line: str) -> None:
        """Raises what a line complains of."""
        if self.is_banner(line):
            self._lost = SafetyStopError(
                f"the board has started anew in the middle of the work ('{line[:60]}')",
                cure="its position is no longer sure: check its supply, home the machine, then resume the run",
                where=self.where,
            )
            raise self._lost
        failure = self.failure(line)
        if failure is not None:
            self._in_step = False
            raise failure

    def _check_stopped(self) -> None:
        if self._stopped:
            self._in_step = False
            raise SafetyStopError(
                "the machine was stopped on its way", cure="find out why, then resume the run", where=self.where
            )

    def _get_in_step(self) -> None:
        """After silence or a complaint answers may still be under way: begin anew, so that none is taken for another's.

        Raises
        ------
        SafetyStopError : the board has started anew since it was opened, or is in alarm.
        """
        if self._lost is not None:
            raise self._lost
        if not self._in_step:
            self._stopped, self._prepared = False, False
            self._drain_watching()
            self._first_answer()
            self._in_step = True
        if not self._prepared:
            self._prepared = True
            try:
                self._prepare()
            except BaseException:
                self._prepared = False
                raise

    def _drain_watching(self) -> None:
        """Throw away old answers, but not the news that the board has started anew."""
        give_up_s = time.monotonic() + self.connection.answer_timeout_s
        while time.monotonic() < give_up_s and (line := self._line.read(_QUIET_S)) is not None:
            if self.is_banner(line):
                self._check(line)

    def _ask_until(self, question: bytes, done: Callable[[str], bool], again_s: float) -> str:
        """Ask again and again until a board that starts has an answer; returns that line."""
        give_up_s = time.monotonic() + self.connection.start_timeout_s
        while time.monotonic() < give_up_s:
            self._line.write(question)
            ask_again_s = time.monotonic() + again_s
            while (left_s := ask_again_s - time.monotonic()) > 0.0:
                line = self._line.read(left_s)
                if line is not None and done(line):
                    self._line.drain(_QUIET_S, self.connection.answer_timeout_s)
                    return line
        raise DeviceError(
            f"no machine answers within {self.connection.start_timeout_s:g} s",
            cure="check port, baud_bps, dialect and supply; `surfuse devices` lists the ports",
            where=self.where,
        )

    def _too_slow(self, limit_s: float, where_mm: Millimetres | None = None) -> NoReturn:
        place = "" if where_mm is None else f", it is at {shown(where_mm)}"
        self.stop()
        raise DeviceError(
            f"the move has not ended after {limit_s:g} s{place}",
            cure="allow more (arm.move_timeout_s), or check that nothing blocks the machine",
            where=self.where,
        )


def _is_ok(line: str) -> bool:
    return line == "ok" or line.startswith("ok ")
