"""The way to a bridge: a TCP connection; `child.py` has the other one. Every wait has a deadline."""

from __future__ import annotations

import socket
import time
from dataclasses import dataclass
from typing import Protocol
from urllib.parse import urlsplit

from surfuse.bridge.lines import LineBuffer
from surfuse.bridge.strict_json import LINE_LIMIT_BYTES
from surfuse.errors import ConfigError, DeviceError

LOOPBACK = ("127.0.0.1", "localhost", "::1")
_PORTION_BYTES = 2**16


class SilenceError(DeviceError):
    """Nothing came in time; the line itself may be whole."""


class ClosedError(DeviceError):
    """The other side has closed the line."""


class Transport(Protocol):
    """Lines to and from a bridge. `can_reopen`: after `close`, `open` may find the same bridge again."""

    @property
    def name(self) -> str:
        """What stands in front of messages."""

    @property
    def can_reopen(self) -> bool: ...
    def open(self, timeout_s: float) -> None: ...
    def send(self, line: bytes, deadline_s: float) -> None:
        """Write one line, its end included, before a moment of `time.monotonic`."""

    def receive(self, deadline_s: float, limit_bytes: int) -> bytes:
        """The next line without its end.

        Raises
        ------
        SilenceError : no whole line until the deadline.
        ClosedError : the bridge is gone.
        DataError : the line is longer than the limit; the next call gives the next line.
        """

    def close(self) -> None: ...


@dataclass(frozen=True)
class TcpAddress:
    """Where a bridge listens."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"tcp://{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"


def parse_address(address: str, *, allow_remote: bool = False) -> TcpAddress:
    """`tcp://host:port` in its parts.

    Raises
    ------
    ConfigError : no such address, or one outside this machine without `allow_remote`.
    """
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise ConfigError(f"address = '{address}': {error}", cure="write tcp://127.0.0.1:5005") from error
    if parts.scheme != "tcp" or not host or port is None or parts.path or parts.query or parts.username:
        raise ConfigError(f"address = '{address}'", cure="write tcp://127.0.0.1:5005")
    if host not in LOOPBACK and not allow_remote:
        raise ConfigError(
            f"address = '{address}' is another machine, and the bridge has no password",
            cure="use 127.0.0.1 through a tunnel (ssh -L), or set allow_remote = true on a network that you trust",
        )
    return TcpAddress(host, port)


class TcpTransport:
    """A TCP connection to a bridge that listens."""

    can_reopen = True

    def __init__(self, address: str, *, allow_remote: bool = False) -> None:
        self._address = parse_address(address, allow_remote=allow_remote)
        self._line: socket.socket | None = None
        self._buffer = LineBuffer(LINE_LIMIT_BYTES)

    @property
    def name(self) -> str:
        """The address."""
        return str(self._address)

    def open(self, timeout_s: float) -> None:
        """Connect.

        Raises
        ------
        ClosedError : nobody listens there.
        """
        self.close()
        self._buffer = LineBuffer(LINE_LIMIT_BYTES)
        try:
            self._line = socket.create_connection((self._address.host, self._address.port), max(timeout_s, 0.01))
        except OSError as error:
            raise ClosedError(
                f"no bridge answers: {error}", where=self.name, cure="start the bridge, and check the port"
            ) from error
        self._line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, line: bytes, deadline_s: float) -> None:
        """See `Transport`."""
        connection = self._connected()
        connection.settimeout(_left_s(deadline_s))
        try:
            connection.sendall(line)
        except TimeoutError as error:
            # Part of the line may be out: whatever followed would be glued to it.
            self.close()
            raise ClosedError("the bridge takes no question in time", where=self.name) from error
        except OSError as error:
            raise ClosedError(f"the connection is broken: {error}", where=self.name) from error

    def receive(self, deadline_s: float, limit_bytes: int) -> bytes:
        """See `Transport`."""
        self._buffer.limit_bytes = limit_bytes
        while (line := self._buffer.next_line()) is None:
            if time.monotonic() >= deadline_s:
                raise SilenceError("the bridge is silent", where=self.name)
            self._buffer.feed(self._portion(deadline_s))
        return line

    def close(self) -> None:
        """Close the connection."""
        if self._line is not None:
            self._line.close()
            self._line = None

    def _portion(self, deadline_s: float) -> bytes:
        connection = self._connected()
        connection.settimeout(_left_s(deadline_s))
        try:
            data = connection.recv(_PORTION_BYTES)
        except TimeoutError as error:
            raise SilenceError("the bridge is silent", where=self.name) from error
        except OSError as error:
            raise ClosedError(f"the connection is broken: {error}", where=self.name) from error
        if not data:
            raise closed_by_bridge(self._buffer, self.name)
        return data

    def _connected(self) -> socket.socket:
        if self._line is None:
            raise ClosedError("the connection is closed", where=self.name)
        return self._line


def closed_by_bridge(buffer: LineBuffer, name: str) -> ClosedError:
    """The end of the line, perhaps in the middle of an answer."""
    rest = len(buffer.unfinished)
    middle = f" in the middle of an answer, after {rest} bytes" if rest else ""
    return ClosedError(f"the bridge has closed the line{middle}", where=name, cure="start it again")


def _left_s(deadline_s: float) -> float:
    return max(deadline_s - time.monotonic(), 1e-4)
