"""Bytes that come in any portions to lines, with bounded memory: what is too long is passed over, not kept."""

from __future__ import annotations

from collections import deque

from surfuse.bridge.strict_json import shown
from surfuse.errors import DataError


class LineBuffer:
    """Lines without their ends (LF or CR LF); empty ones are passed over.

    A line beyond the limit is dropped up to its end, and stands in the order as an error.
    """

    def __init__(self, limit_bytes: int) -> None:
        self.limit_bytes = limit_bytes
        self._partial = bytearray()
        self._dropping = False
        self._ready: deque[bytes | DataError] = deque()

    def feed(self, data: bytes) -> None:
        """Take in the bytes that came."""
        *ended, rest = data.split(b"\n")
        for piece in ended:
            self._extend(piece)
            if not self._dropping:
                line = bytes(self._partial).rstrip(b"\r")
                if line.strip():
                    self._ready.append(line)
            self._partial.clear()
            self._dropping = False
        self._extend(rest)

    def next_line(self) -> bytes | None:
        """The oldest whole line, None while there is none.

        Raises
        ------
        DataError : the line was longer than the limit.
        """
        if not self._ready:
            return None
        line = self._ready.popleft()
        if isinstance(line, DataError):
            raise line
        return line

    @property
    def unfinished(self) -> bytes:
        """What came after the end of the last line."""
        return bytes(self._partial)

    def _extend(self, piece: bytes) -> None:
        if self._dropping:
            return
        if len(self._partial) + len(piece) <= self.limit_bytes:
            self._partial += piece
            return
        beginning = shown(bytes(self._partial[:100]) + piece[:100])
        self._partial.clear()
        self._dropping = True
        self._ready.append(
            DataError(f"a line of more than {self.limit_bytes} bytes: {beginning}", cure="send less at a time")
        )
