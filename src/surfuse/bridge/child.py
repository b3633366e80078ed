"""A bridge as a child process that talks on its standard input and output; threads, so that pipes of any system do."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import IO

from surfuse.bridge.lines import LineBuffer
from surfuse.bridge.strict_json import LINE_LIMIT_BYTES, cleaned, in_a_sentence
from surfuse.bridge.transport import ClosedError, SilenceError, closed_by_bridge
from surfuse.errors import ConfigError

_PORTION_BYTES = 2**16
_WAITING_PORTIONS = 8  # then the child has to wait: its flood stays in its pipe
_LAST_WORDS = 5
_SHOWN_LINES = 1000
_GOODBYE_S = 2.0


def to_stderr(line: str) -> None:
    """Pass one line of the bridge on to the user."""
    print(line, file=sys.stderr, flush=True)


class ChildTransport:
    """A child process, started by `open` and ended by `close`.

    Parameters
    ----------
    command : the program and its words.
    on_error_line : gets each line of its standard error, cleaned, cut, and marked as the bridge's; at most 1000 lines.
    """

    can_reopen = False

    def __init__(self, command: Sequence[str], on_error_line: Callable[[str], None] = to_stderr) -> None:
        if not command or not all(isinstance(word, str) and word and "\0" not in word for word in command):
            raise ConfigError(f"command = {list(command)}", cure='write command = ["python3", "my_robot.py"]')
        self._command, self._on_error_line = list(command), on_error_line
        self._child: subprocess.Popen[bytes] | None = None
        self._buffer = LineBuffer(LINE_LIMIT_BYTES)
        self._portions: queue.Queue[bytes] = queue.Queue(_WAITING_PORTIONS)
        self._to_write: queue.Queue[bytes | None] = queue.Queue()
        self._written: queue.Queue[bool] = queue.Queue()
        self._last_words: deque[str] = deque(maxlen=_LAST_WORDS)
        self._threads: list[threading.Thread] = []

    @property
    def name(self) -> str:
        """The program."""
        return cleaned(os.path.basename(self._command[0]) + " " + " ".join(self._command[1:]), 60).strip()

    def open(self, timeout_s: float) -> None:
        """Start the program.

        Raises
        ------
        ClosedError : it cannot be started, or has been before.
        """
        if self._child is not None:
            raise self._gone()
        try:
            # A group of its own: Ctrl-C in the terminal must leave it alive, so that the arm can be told to stop.
            self._child = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                bufsize=0,
                start_new_session=os.name == "posix",
                creationflags=0 if os.name == "posix" else _new_process_group(),
            )
        except OSError as error:
            raise ClosedError(
                f"the bridge cannot be started: {error}", where=self.name, cure="check 'command'"
            ) from error
        self._start(self._read_answers, self._write_questions, self._read_errors)

    def send(self, line: bytes, deadline_s: float) -> None:
        """See `Transport`."""
        if self._child is None:
            raise ClosedError("the bridge is not running", where=self.name)
        self._to_write.put(line)
        try:
            written = self._written.get(timeout=max(deadline_s - time.monotonic(), 1e-3))
        except queue.Empty:
            self.close()
            raise ClosedError("the bridge takes no question in time", where=self.name) from None
        if not written:
            raise self._gone()

    def receive(self, deadline_s: float, limit_bytes: int) -> bytes:
        """See `Transport`."""
        self._buffer.limit_bytes = limit_bytes
        while (line := self._buffer.next_line()) is None:
            left_s = deadline_s - time.monotonic()
            try:
                portion = self._portions.get(timeout=left_s) if left_s > 0.0 else None
            except queue.Empty:
                portion = None
            if portion is None:
                raise SilenceError("the bridge is silent", where=self.name)
            if not portion:
                self._portions.put(b"")
                raise self._gone()
            self._buffer.feed(portion)
        return line

    def close(self) -> None:
        """Close its input, and end it if that does not."""
        child = self._child
        if child is None:
            return
        self._to_write.put(None)
        self._threads[1].join(0.2)
        if self._threads[1].is_alive():
            self._end(child, "SIGTERM")  # it does not read, and closing its input would wait for it
        else:
            _close_quietly(child.stdin)
        for signal_name in ("SIGTERM", "SIGKILL", "SIGKILL"):
            try:
                child.wait(_GOODBYE_S)
                break
            except subprocess.TimeoutExpired:
                self._end(child, signal_name)
        self._free_reader()
        for stream in (child.stdin, child.stdout, child.stderr):
            _close_quietly(stream)

    @staticmethod
    def _end(child: subprocess.Popen[bytes], signal_name: str) -> None:
        """End the child and whatever it has started (a shell's program, for one)."""
        if os.name == "posix":
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child.pid, getattr(signal, signal_name))
        else:
            child.kill()

    def _start(self, *bodies: Callable[[], None]) -> None:
        self._threads = [threading.Thread(target=body, daemon=True) for body in bodies]
        for thread in self._threads:
            thread.start()

    def _read_answers(self) -> None:
        stream = self._stream("stdout")
        with contextlib.suppress(OSError, ValueError):  # closed under us
            while portion := stream.read(_PORTION_BYTES):
                self._portions.put(portion)
        self._portions.put(b"")

    def _write_questions(self) -> None:
        stream = self._stream("stdin")
        while (line := self._to_write.get()) is not None:
            try:
                rest = memoryview(line)
                while rest:
                    rest = rest[stream.write(rest) or 0 :]
                self._written.put(True)
            except (OSError, ValueError):
                self._written.put(False)

    def _read_errors(self) -> None:
        """Bounded in the length of a line, in their number, and in memory."""
        stream, buffer, shown = self._stream("stderr"), b"", 0
        with contextlib.suppress(OSError, ValueError):  # closed under us
            while portion := stream.read(4096):
                *lines, buffer = (buffer + portion).replace(b"\r", b"\n").split(b"\n")
                if len(buffer) > _PORTION_BYTES:
                    lines, buffer = [*lines, buffer], b""
                shown = self._pass_on(lines, shown)
        self._pass_on([buffer], shown)

    def _pass_on(self, lines: Sequence[bytes], shown: int) -> int:
        for line in lines:
            text = cleaned(line.decode("utf-8", "replace"), 300)
            if text:
                self._last_words.append(text)
                shown += 1
                if shown <= _SHOWN_LINES:
                    self._on_error_line(f"bridge: {text}")
                elif shown == _SHOWN_LINES + 1:
                    self._on_error_line(f"bridge: more than {_SHOWN_LINES} lines, the others are not shown")
        return shown

    def _gone(self) -> ClosedError:
        """What is known of its end: exit status and last words."""
        child = self._child
        if child is None:
            return ClosedError("the bridge is not running", where=self.name)
        try:
            status = child.wait(0.5)
        except subprocess.TimeoutExpired:
            return closed_by_bridge(self._buffer, self.name)
        self._threads[2].join(0.5)
        words = " | ".join(self._last_words)
        said = f"; it said: {in_a_sentence(words, 400)}" if words else ""
        ended = f"was ended by signal {-status}" if status < 0 else f"has ended with exit status {status}"
        return ClosedError(f"the bridge {ended}{said}", where=self.name, cure="start it by hand to see why")

    def _free_reader(self) -> None:
        """Let the reading threads end, one of which may wait for room."""
        give_up_s = time.monotonic() + _GOODBYE_S
        while self._threads[0].is_alive() and time.monotonic() < give_up_s:
            with contextlib.suppress(queue.Empty):
                self._portions.get(timeout=0.01)
        for thread in self._threads[1:]:
            thread.join(0.5)
        with contextlib.suppress(queue.Full):
            self._portions.put_nowait(b"")

    def _stream(self, which: str) -> IO[bytes]:
        child = self._child
        streams = {} if child is None else {"stdin": child.stdin, "stdout": child.stdout, "stderr": child.stderr}
        stream = streams.get(which)
        if stream is None:
            raise ClosedError("the bridge is not running", where=self.name)
        return stream


def _close_quietly(stream: IO[bytes] | None) -> None:
    if stream is not None:
        with contextlib.suppress(OSError):
            stream.close()


def _new_process_group() -> int:
    return int(getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0))
