"""The other end of a bridge: any rig of ours put behind the protocol, on a TCP port or on standard input and output."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import threading
from types import TracebackType
from typing import Self

from surfuse.bridge.answering import Answering
from surfuse.bridge.fields import Fields
from surfuse.bridge.lines import LineBuffer
from surfuse.bridge.messages import Bridgeable, Hello, Refusal
from surfuse.bridge.refusals import refused
from surfuse.bridge.strict_json import LINE_LIMIT_BYTES, decode_line, encode_line
from surfuse.bridge.transport import TcpAddress, parse_address
from surfuse.errors import DataError, DeviceError

_PORTION_BYTES = 2**16
_ACCEPT_S = 0.5
_PATIENCE_S = 1.0


class BridgeServer:
    """A rig on a TCP port, for one client at a time.

    Parameters
    ----------
    rig : what is behind the bridge.
    address : `tcp://127.0.0.1:5005`; port 0 takes a free one, see `address`.
    allow_remote : whether other machines may connect; the protocol has no password.
    """

    def __init__(self, rig: Bridgeable, address: str, *, allow_remote: bool = False) -> None:
        self._rig, self._asked = rig, parse_address(address, allow_remote=allow_remote)
        self._hello: Hello | None = None
        self._listener: socket.socket | None = None
        self._closing = threading.Event()
        self._guard = threading.Lock()
        self._client: socket.socket | None = None
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Self:
        self._hello = self._rig.hello()
        family = socket.AF_INET6 if ":" in self._asked.host else socket.AF_INET
        listener = socket.socket(family, socket.SOCK_STREAM)
        try:
            if os.name == "posix":  # elsewhere it would let two programs share the port
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((self._asked.host, self._asked.port))
            listener.listen(8)
        except OSError as error:
            listener.close()
            raise DeviceError(
                f"the port cannot be opened: {error}", where=str(self._asked), cure="choose another port"
            ) from error
        listener.settimeout(_ACCEPT_S)
        self._listener = listener
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def address(self) -> str:
        """Where it listens."""
        if self._listener is None:
            raise DeviceError("the server is not open", where=str(self._asked), cure="use it in a with block")
        return str(TcpAddress(self._asked.host, self._listener.getsockname()[1]))

    def serve_forever(self) -> None:
        """Take clients until `close`; a second one is told that there is a first."""
        while not self._closing.is_set() and self._listener is not None:
            try:
                connection, _ = self._listener.accept()
            except TimeoutError:
                continue
            except OSError:
                return  # closed under us
            self._take(connection)

    def close(self) -> None:
        """Take no more clients, and part from the one that is there."""
        self._closing.set()
        if self._listener is not None:
            with contextlib.suppress(OSError):
                self._listener.shutdown(socket.SHUT_RDWR)  # wakes `accept` where the system can
        with self._guard:
            if self._client is not None:
                with contextlib.suppress(OSError):
                    self._client.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join()
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def _take(self, connection: socket.socket) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        with self._guard:
            busy = self._client is not None
            if not busy:
                connection.settimeout(None)
                self._client = connection
        thread = threading.Thread(target=_send_away if busy else self._serve, args=(connection,), daemon=True)
        self._threads = [running for running in self._threads if running.is_alive()] + [thread]
        thread.start()

    def _serve(self, connection: socket.socket) -> None:
        try:
            if self._hello is not None:
                Answering(self._rig, self._hello, lambda: connection.recv(_PORTION_BYTES), connection.sendall).run()
        finally:
            with self._guard:
                self._client = None
            connection.close()


def serve_stdio(rig: Bridgeable) -> None:
    """Serve the process that started this one; whatever else writes to standard output goes to standard error."""
    hello = rig.hello()
    sys.stdout.flush()
    answers, before = os.dup(1), sys.stdout
    os.dup2(2, 1)
    sys.stdout = sys.stderr
    try:
        Answering(rig, hello, lambda: os.read(0, _PORTION_BYTES), lambda line: _write_all(answers, line)).run()
    finally:
        sys.stdout = before
        os.dup2(answers, 1)
        os.close(answers)


def _send_away(connection: socket.socket) -> None:
    """Answer the first question of a second client."""
    with connection, contextlib.suppress(OSError):
        connection.settimeout(_PATIENCE_S)
        buffer = LineBuffer(LINE_LIMIT_BYTES)
        number: int | None = None
        with contextlib.suppress(DataError):
            while (line := buffer.next_line()) is None and (data := connection.recv(_PORTION_BYTES)):
                buffer.feed(data)
            number = Fields(decode_line(line or b"")).whole("id")
        busy = refused(Refusal.DEVICE, "another client is connected to this bridge; close it first")
        connection.sendall(encode_line({"id": number, **busy}))


def _write_all(descriptor: int, line: bytes) -> None:
    rest = memoryview(line)
    while rest:
        rest = rest[os.write(descriptor, rest) :]
