"""Questions asked until they are answered: ids that come back, deadlines, asking again, connections that go away."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from surfuse.bridge.answers import decode_hello
from surfuse.bridge.fields import Fields
from surfuse.bridge.messages import PROTOCOL_VERSION, Hello, Question
from surfuse.bridge.patience import ASKED_AGAIN, Patience
from surfuse.bridge.questions import encode_question
from surfuse.bridge.refusals import GarbledError, RefusedError, error_of, no_bridge
from surfuse.bridge.strict_json import (
    IMAGE_LIMIT_BYTES,
    LINE_LIMIT_BYTES,
    Json,
    decode_line,
    encode_line,
    in_a_sentence,
)
from surfuse.bridge.transport import ClosedError, SilenceError, Transport
from surfuse.errors import DataError, DeviceError

T = TypeVar("T")
_NO_FIELDS: Mapping[str, Json] = {}
_PAUSE_S = 0.05
_PARTING_S = 0.5
_CURE = "check that the bridge still runs"
_CURES = {
    Question.SWEEP: "check that the bridge still runs; where its sensors are slow, give their "
    "firing_time_s, or a longer arm.sweep_timeout_s"
}


@dataclass
class Tally:
    """What went wrong and was put right."""

    stale_answers: int = 0
    garbled_answers: int = 0
    silences: int = 0
    reconnections: int = 0


class Conversation:
    """Questions and answers over one transport, one question at a time.

    Parameters
    ----------
    transport : the way to the bridge; it is opened by `open`.
    patience : how long answers may take.
    on_connection : called after each greeting but the first; it may ask.

    `sent_s` is when the question was sent that was asked last, by `time.monotonic`.
    """

    def __init__(self, transport: Transport, patience: Patience, on_connection: Callable[[], None]) -> None:
        self._transport, self._patience, self._on_connection = transport, patience, on_connection
        self._number = 0
        self._connected = False
        self._lost: DeviceError | None = None
        self._no_bridge: DeviceError | None = None
        self._hello: Hello | None = None
        self.sent_s = -math.inf
        self.tally = Tally()

    @property
    def where(self) -> str:
        """What stands in front of messages."""
        return self._transport.name

    def open(self) -> Hello:
        """Connect and say hello.

        Raises
        ------
        DeviceError : nobody answers, or the answers make no sense.
        """
        self._lost = None
        self._connect(time.monotonic() + self._patience.give_up_s)
        if self._hello is None:
            raise DeviceError("the bridge did not say hello", where=self.where)
        return self._hello

    def close(self) -> None:
        """Say good-bye if somebody is there, and close."""
        if self._connected:
            deadline_s = time.monotonic() + _PARTING_S
            try:
                number, line = self._next(Question.BYE, _NO_FIELDS)
                self._transport.send(line, deadline_s)
                self._answer_to(number, Question.BYE, deadline_s)
            except (DeviceError, DataError):
                pass  # it may close without a word
        self._transport.close()
        self._connected = False

    def ask(self, question: Question, fields: Mapping[str, Json], decode: Callable[[Fields], T]) -> T:
        """The answer to a question that may be asked again.

        Raises
        ------
        DeviceError : no answer, none that makes sense, or a failure behind the bridge. Once the bridge is given up,
            every further question ends so at once.
        SafetyStopError, UnreachableError : the bridge refuses.
        """
        give_up_s = time.monotonic() + self._patience.give_up_s
        attempts = self._patience.attempts if question in ASKED_AGAIN else 1
        while True:
            if self._lost is not None:
                raise self._lost
            try:
                self._connect_if_needed(give_up_s)
                return self.ask_once(question, fields, decode)
            except GarbledError:
                attempts -= 1
                if attempts <= 0 or time.monotonic() >= give_up_s:
                    raise
            except SilenceError as error:
                if time.monotonic() + self._patience.timeout_s(question) > give_up_s or attempts <= 1:
                    raise self._given_up(error) from None
            except ClosedError as error:
                if not self._transport.can_reopen or time.monotonic() >= give_up_s or attempts <= 1:
                    raise self._given_up(error) from None

    def ask_once(self, question: Question, fields: Mapping[str, Json], decode: Callable[[Fields], T]) -> T:
        """The answer to a question that is sent once, on the connection that there is."""
        if self._lost is not None:
            raise self._lost
        return self._exchange(question, fields, decode, self._patience.timeout_s(question))

    def _exchange(
        self, question: Question, fields: Mapping[str, Json], decode: Callable[[Fields], T], timeout_s: float
    ) -> T:
        deadline_s = time.monotonic() + timeout_s
        number, line = self._next(question, fields)
        self.sent_s = time.monotonic()
        try:
            self._transport.send(line, deadline_s)
            answer = self._answer_to(number, question, deadline_s)
            if not answer.flag("ok"):
                raise error_of(answer, question, self.where)
            return decode(answer)
        except DataError as error:
            self.tally.garbled_answers += 1
            what = f"the answer to '{question.value}' makes no sense: {error.what}"
            raise GarbledError(what, where=self.where, cure=error.cure) from error
        except SilenceError as error:
            self.tally.silences += 1
            what = f"no answer to '{question.value}' within {timeout_s:g} s"
            raise SilenceError(what, where=self.where, cure=_CURES.get(question, _CURE)) from error
        except ClosedError:
            self._hang_up()
            raise

    def _next(self, question: Question, fields: Mapping[str, Json]) -> tuple[int, bytes]:
        """A fresh id and the line to send; what does not fit on a line is an error of ours, not of the bridge."""
        self._number += 1
        return self._number, encode_line(encode_question(self._number, question, fields))

    def _answer_to(self, number: int, question: Question, deadline_s: float) -> Fields:
        """The answer with this id; those to earlier questions, which came too late, are counted and passed over."""
        limit_bytes = IMAGE_LIMIT_BYTES if question is Question.IMAGE else LINE_LIMIT_BYTES
        while True:
            answer = self._fields_of(self._transport.receive(deadline_s, limit_bytes))
            if not answer.has("id") and answer.has("error"):
                raise DataError(f"the bridge could not read it: {in_a_sentence(answer.text('error'))}")
            got = answer.whole("id")
            if got == number:
                return answer
            if got > number:
                raise DataError(f"it has the id {got}, asked was {number}", cure="send back the id of the question")
            self.tally.stale_answers += 1

    def _fields_of(self, line: bytes) -> Fields:
        """The fields of an answer; a first line that is none may be another program's, which is told at the end."""
        try:
            return Fields(decode_line(line))
        except DataError:
            if self._hello is None and self._no_bridge is None and self._transport.can_reopen:
                self._no_bridge = no_bridge(line, self.where)
            raise

    def ensure_connected(self) -> None:
        """Connect again if the line has broken.

        Raises
        ------
        DeviceError : nobody answers any more.
        """
        self._connect_if_needed(time.monotonic() + self._patience.give_up_s)

    def _connect_if_needed(self, give_up_s: float) -> None:
        if self._lost is None and not self._connected:
            self._connect(give_up_s)

    def _connect(self, give_up_s: float) -> None:
        """Connect and greet, again and again until the moment `give_up_s`: a bridge may be about to come up again."""
        while True:
            try:
                self._transport.open(max(give_up_s - time.monotonic(), 0.0))
                self._greet()
                return
            except (ClosedError, RefusedError, SilenceError) as error:
                self._hang_up()
                if not self._transport.can_reopen or time.monotonic() + _PAUSE_S >= give_up_s:
                    raise self._given_up(self._no_bridge or error) from None
            except GarbledError as error:
                self._hang_up()
                raise (self._no_bridge or error) from None
            except BaseException:
                self._hang_up()
                raise
            time.sleep(_PAUSE_S)

    def _greet(self) -> None:
        """Say hello, more than once if other words come first: some libraries print while they start."""
        patience, known = self._patience, self._hello
        timeout_s = patience.answer_timeout_s if self._transport.can_reopen else patience.start_timeout_s
        for left in reversed(range(patience.attempts)):
            try:
                hello = self._exchange(Question.HELLO, {"protocol": PROTOCOL_VERSION}, decode_hello, timeout_s)
                break
            except GarbledError:
                if not left:
                    raise
        if known is not None and hello != known:
            raise DeviceError(
                f"another rig answers now: '{hello.name}' with {len(hello.sensors)} sensors, "
                f"before it was '{known.name}' with {len(known.sensors)}",
                where=self.where,
                cure="start the bridge that the scan began with",
            )
        self._hello, self._connected, self._no_bridge = hello, True, None
        if known is not None:
            self.tally.reconnections += 1
            self._on_connection()

    def _hang_up(self) -> None:
        self._connected = False
        if self._transport.can_reopen:
            self._transport.close()

    def _given_up(self, error: DeviceError) -> DeviceError:
        """From here on nobody waits for this bridge again."""
        self._hang_up()
        self._lost = error
        return error
