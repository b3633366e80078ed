"""One client served: questions in, answers out, and a `stop` that is heard while the arm moves."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping

from surfuse.bridge import answers, questions
from surfuse.bridge.fields import Fields
from surfuse.bridge.lines import LineBuffer
from surfuse.bridge.messages import PROTOCOL_VERSION, Ability, Bridgeable, Hello, Question, Reach, Refusal, Streamed
from surfuse.bridge.refusals import refusal_of, refused
from surfuse.bridge.strict_json import IMAGE_LIMIT_BYTES, LINE_LIMIT_BYTES, Json, decode_line, encode_line
from surfuse.errors import DataError, SurfuseError

Receive = Callable[[], bytes]
Send = Callable[[bytes], None]


class Answering:
    """The conversation with one client, until it leaves.

    Parameters
    ----------
    rig : what is behind the bridge.
    hello : how it was introduced.
    receive : the next bytes, none at the end.
    send : writes all of its bytes; raises OSError when nobody takes them.
    """

    def __init__(self, rig: Bridgeable, hello: Hello, receive: Receive, send: Send) -> None:
        self._rig, self._hello, self._receive, self._send = rig, hello, receive, send
        self._writing = threading.Lock()
        self._mover: threading.Thread | None = None

    def run(self) -> None:
        """Answer until the client says bye or closes; an arm that still moves then is stopped."""
        buffer = LineBuffer(LINE_LIMIT_BYTES)
        try:
            while data := self._receive():
                buffer.feed(data)
                if not self._answer_all(buffer):
                    return
        except OSError:
            pass  # the client went away
        finally:
            self._settle()

    def _answer_all(self, buffer: LineBuffer) -> bool:
        """Whether the conversation goes on."""
        while True:
            try:
                line = buffer.next_line()
                if line is None:
                    return True
                fields = Fields(decode_line(line))
            except DataError as error:
                self._write(None, refused(Refusal.USAGE, str(error)))
                continue
            if not self._answer(fields):
                return False

    def _answer(self, fields: Fields) -> bool:
        number: int | None = None
        try:
            number = fields.whole("id", least=-(2**53))
            question = questions.decode_kind(fields)
        except DataError as error:
            self._write(number, refused(Refusal.USAGE, str(error)))
            return True
        if question is not Question.STOP:
            self._join()
        if question is Question.MOVE:
            self._mover = threading.Thread(target=self._reply, args=(number, question, fields), daemon=True)
            self._mover.start()
        else:
            self._reply(number, question, fields)
        return question is not Question.BYE

    def _reply(self, number: int, question: Question, fields: Fields) -> None:
        """Do what is asked; whatever fails becomes an answer too."""
        try:
            answer = {"ok": True, **self._done(question, fields)}
        except SurfuseError as error:
            answer = refusal_of(error)
        except Exception as error:  # a bug behind the bridge must not leave the client waiting
            answer = refused(Refusal.DEVICE, f"{type(error).__name__}: {error}")
        with contextlib.suppress(OSError):
            self._write(number, answer)

    def _done(self, question: Question, fields: Fields) -> dict[str, Json]:
        """The fields of the answer."""
        rig = self._rig
        match question:
            case Question.HELLO:
                return answers.encode_hello(_greeted(self._hello, fields))
            case Question.STATE:
                return answers.encode_state(rig.state())
            case Question.REACH:
                return answers.encode_reach(Reach(rig.reach(questions.decode_reach(fields))))
            case Question.MOVE:
                return answers.encode_state(rig.move(questions.decode_move(fields)))
            case Question.SWEEP:
                return answers.encode_sweep(rig.sweep(questions.decode_sweep(fields, self._hello.sensors)))
            case Question.IMAGE:
                return answers.encode_image(rig.image())
            case Question.STOP:
                return answers.encode_state(rig.stop())
            case Question.BEGIN:
                if not isinstance(rig, Streamed):
                    raise DataError("this rig has no random streams", cure="do not ask it to begin")
                rig.begin(fields.text("stage"), fields.whole("index"))
                return {}
            case Question.BYE:
                return {}

    def _write(self, number: int | None, answer: Mapping[str, Json]) -> None:
        limit_bytes = IMAGE_LIMIT_BYTES if "gray8" in answer else LINE_LIMIT_BYTES
        try:
            line = encode_line({"id": number, **answer}, limit_bytes)
        except DataError as error:
            line = encode_line({"id": number, **refused(Refusal.DEVICE, str(error))})
        with self._writing:
            self._send(line)

    def _join(self) -> None:
        if self._mover is not None:
            self._mover.join()
            self._mover = None

    def _settle(self) -> None:
        """Nobody watches the arm any more."""
        if self._mover is not None and self._mover.is_alive() and Ability.STOP in self._hello.can:
            with contextlib.suppress(Exception):  # nobody is there to be told
                self._rig.stop()
        self._join()


def _greeted(hello: Hello, fields: Fields) -> Hello:
    """Our greeting, to a client of the same version.

    Raises
    ------
    DataError : another version.
    """
    version = fields.whole("protocol")
    if version != PROTOCOL_VERSION:
        raise DataError(
            f"the question speaks protocol {version}, this bridge speaks {PROTOCOL_VERSION}",
            cure="bring both to the same version",
        )
    return hello
