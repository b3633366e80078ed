"""The host's side of the conversation with the ranging kit: numbered questions, checked answers, retries."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass

from surfuse.errors import DeviceError
from surfuse.node.messages import KitMessage
from surfuse.serial_line.kit_words import (
    EARLY,
    ERROR_WORDS,
    MAX_NUMBER,
    NOTHING,
    PROTOCOL,
    as_fields,
    changed_by,
    framed,
    unframed,
)
from surfuse.serial_line.text_line import TextLine

_TRIES = 3
_POLL_S = 0.05
_TIME_US = re.compile(r"[0-9]{1,6}\.[0-9]{3}")
_AMPLITUDE = re.compile(r"[0-9]{1,3}\.[0-9]{4}")
_DAMAGED = "SUM"  # said of a line whose number the kit could not read, too


@dataclass(frozen=True)
class Ping:
    """One emission: time of flight in s (+inf: nothing heard, -inf: the level was already reached), and amplitude."""

    time_s: float
    amplitude: float


class KitLine:
    """One kit; `open` and `close` it.

    Parameters
    ----------
    line : its serial line.
    timeout_s : longest wait for a whole answer.
    """

    def __init__(self, line: TextLine, timeout_s: float) -> None:
        self._line, self._timeout_s = line, timeout_s
        self._number, self._sets = 0, -1
        self.rejected = 0

    def open(self, wanted: KitMessage) -> None:
        """Open the line, and set the kit.

        Raises
        ------
        DeviceError : nobody answers, it is another device, or it does not take the parameters.
        """
        self._line.open()
        try:
            self._line.write(b"\r\n")  # ends what noise may have begun
            version = self._ask("ID", 2, ())[0]
            if version != str(PROTOCOL):
                raise DeviceError(
                    f"the kit speaks version {version[:10]} of the protocol, this program version {PROTOCOL}",
                    cure="use a kit, or a surfuse, of the same version",
                    where=self._line.port,
                )
            self.set(wanted)
        except BaseException:
            self._line.close()
            raise

    def close(self) -> None:
        """Close the line."""
        self._line.close()

    def set(self, wanted: KitMessage) -> None:
        """Set the six parameters, and read them back.

        Raises
        ------
        DeviceError : the kit refuses them, or has others afterwards.
        """
        (sets,) = self._ask("SET", 1, as_fields(wanted))
        told = self._ask("GET", len(as_fields(wanted)), ())
        found = changed_by(KitMessage(), told)
        if found != changed_by(KitMessage(), as_fields(wanted)):
            raise DeviceError(
                f"the kit says {', '.join(told)} after it was set to {', '.join(as_fields(wanted))}",
                cure="take parameters that the kit can have",
                where=self._line.port,
            )
        self._sets = int(sets) if sets.isdecimal() else -1

    def fire(self, pings: int, wanted: KitMessage) -> tuple[Ping, ...]:
        """The answers to one trigger; none at all when they were damaged on every try.

        A kit that has been switched off and on has lost its parameters, which its answer tells: it is set again.

        Raises
        ------
        DeviceError : the kit is silent or refuses, or the line has vanished.
        """
        for _ in range(_TRIES):
            heard = self._fire_once(pings)
            if heard is None:
                continue
            sets, answers = heard
            if sets == self._sets:
                return answers
            self.set(wanted)
        return ()

    def _fire_once(self, pings: int) -> tuple[int, tuple[Ping, ...]] | None:
        """How often the kit has been set, and its pings; None when something is missing or damaged."""
        number, answers = self._send("FIRE", str(pings)), dict[int, Ping]()
        silent, give_up_s = True, time.monotonic() + self._timeout_s
        while time.monotonic() < give_up_s:
            line = self._line.read(_POLL_S)
            if line is None:
                continue
            silent = False
            word, its_number, fields = unframed(line) or ("", -1, ())
            if (word, fields) == ("ER", (_DAMAGED,)) and its_number in (0, number):
                self.rejected += 1
                return None
            if its_number != number:
                self.rejected += 1
            elif word == "PING" and (ping := _ping(fields, pings)) is not None:
                answers[int(fields[0])] = ping
            elif word == "DONE" and len(fields) == 2 and fields[1].isdecimal():
                whole = sorted(answers) == list(range(1, pings + 1)) and fields[0] == str(pings)
                return (int(fields[1]), tuple(answers[k] for k in sorted(answers))) if whole else None
            elif word == "ER" and len(fields) == 1:
                self._refused(fields[0], "FIRE")
        if silent:
            raise self._silent("FIRE")
        return None

    def _ask(self, word: str, count: int, fields: tuple[str, ...]) -> tuple[str, ...]:
        """The fields of the answer to one question, asked again when it was lost."""
        answer_word = {"ID": "KIT", "SET": "OK", "GET": "PAR"}[word]
        for _ in range(_TRIES):
            number, give_up_s = self._send(word, *fields), time.monotonic() + self._timeout_s
            while time.monotonic() < give_up_s:
                line = self._line.read(_POLL_S)
                if line is None:
                    continue
                found, its_number, told = unframed(line) or ("", -1, ())
                if its_number == number and found == answer_word and len(told) == count:
                    return told
                if found == "ER" and len(told) == 1 and its_number in (number, 0 if told[0] == _DAMAGED else number):
                    self._refused(told[0], f"{word} {', '.join(fields)}")
                    break
                self.rejected += 1
        raise self._silent(word)

    def _send(self, word: str, *fields: str) -> int:
        self._number = self._number % MAX_NUMBER + 1
        self._line.write(framed(word, self._number, *fields))
        return self._number

    def _refused(self, error: str, asked: str) -> None:
        """Raises what the kit refuses; a line that was damaged on its way is only to be said again."""
        if error != _DAMAGED:
            meaning = ERROR_WORDS.get(error, "a word that the protocol does not have")
            raise DeviceError(
                f"the kit refuses '{asked}': {error}, {meaning}",
                cure="take parameters that the kit can have; check transducer and amplifier when it says HARD",
                where=self._line.port,
            )
        self.rejected += 1

    def _silent(self, word: str) -> DeviceError:
        return DeviceError(
            f"no answer of the kit to {word} within {self._timeout_s:g} s",
            cure="check cable, supply, port and baud_bps",
            where=self._line.port,
        )


def _ping(fields: tuple[str, ...], pings: int) -> Ping | None:
    """One ping `k, n, time of flight in us, amplitude`; None when it is not in the form."""
    if len(fields) != 4 or fields[1] != str(pings) or not re.fullmatch("[1-9][0-9]?", fields[0]):
        return None
    if fields[2] in (NOTHING, EARLY) and fields[3] == "":
        return Ping(float("inf") if fields[2] == NOTHING else float("-inf"), float("nan"))
    if _TIME_US.fullmatch(fields[2]) and _AMPLITUDE.fullmatch(fields[3]):
        return Ping(1e-6 * float(fields[2]), float(fields[3]))
    return None
