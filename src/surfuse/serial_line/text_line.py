"""A device that is spoken to in lines of text on a serial port: whole lines out, whole lines in."""

from __future__ import annotations

import errno
import time
from typing import TYPE_CHECKING

from surfuse.errors import DeviceError
from surfuse.extras import needed_by

if TYPE_CHECKING:
    from serial import Serial

_POLL_S = 0.01
_WRITE_TIMEOUT_S = 2.0
_LONGEST_BYTES = 512
_CURES = {
    errno.EACCES: "you may not use it: join the group that owns it (often dialout or uucp) and log in again",
    errno.EAGAIN: "another program has it: close that one",
    errno.EBUSY: "another program has it: close that one",
}


class TextLine:
    """One port with 8 data bits, no parity, 1 stop bit; closed until `open`.

    Bytes that are no ASCII become `?`, and a line that does not end within 512 bytes is cut off: both are noise, and
    whoever reads the lines takes them for none of its answers.

    Parameters
    ----------
    port : `/dev/ttyUSB0`, `COM3`, or a URL of pyserial.
    baud_bps : speed of the line.
    what : what is on the line, for messages.
    """

    def __init__(self, port: str, baud_bps: int, what: str) -> None:
        self.port, self._baud_bps, self._what = port, baud_bps, what
        self._serial: Serial | None = None
        self._begun = bytearray()

    def open(self) -> None:
        """Open the port, for this program alone.

        Raises
        ------
        DeviceError : it is not there, or somebody else has it.
        ConfigError : the package pyserial is missing.
        """
        with needed_by(f"{self._what} on a serial port", self.port):
            import serial
        try:
            port = serial.serial_for_url(
                self.port, self._baud_bps, timeout=_POLL_S, write_timeout=_WRITE_TIMEOUT_S, exclusive=True
            )
        except (OSError, ValueError) as error:
            number = error.errno if isinstance(error, OSError) else None
            cure = _CURES.get(number or 0, "see `surfuse devices` for the ports of this machine")
            raise DeviceError(f"the port cannot be opened: {error}", cure=cure, where=self.port) from error
        self._serial = port
        self._begun.clear()

    def close(self) -> None:
        """Close the port; a closed one may be closed again."""
        port, self._serial = self._serial, None
        if port is not None:
            port.close()

    def write(self, data: bytes) -> None:
        """Send bytes; may be called while another thread waits for a line.

        Raises
        ------
        DeviceError : the port is closed or has vanished.
        """
        port = self._opened()
        try:
            port.write(data)
        except Exception as error:  # a vanished port raises SerialException, OSError, TypeError or termios.error
            raise self._vanished(error) from error

    def read(self, wait_s: float) -> str | None:
        """The next whole line without its end, None when none came in time; empty lines are passed over.

        Raises
        ------
        DeviceError : the port is closed or has vanished.
        """
        give_up_s = time.monotonic() + wait_s
        while True:
            while (end := _line_end(self._begun)) >= 0:
                line = bytes(self._begun[:end]).decode("ascii", "replace").replace("\ufffd", "?").strip()
                del self._begun[: end + 1]
                if line:
                    return line
            if len(self._begun) > _LONGEST_BYTES:
                self._begun.clear()
            if time.monotonic() >= give_up_s:
                return None
            self._receive()

    def drain(self, quiet_s: float, limit_s: float) -> None:
        """Throw away what comes until nothing has come for a while, at most so long."""
        give_up_s = time.monotonic() + limit_s
        while time.monotonic() < give_up_s and self.read(quiet_s) is not None:
            pass
        self._begun.clear()

    def _receive(self) -> None:
        port = self._opened()
        try:
            self._begun += port.read(max(1, port.in_waiting))
        except Exception as error:  # as in `write`
            raise self._vanished(error) from error

    def _opened(self) -> Serial:
        if self._serial is None:
            raise DeviceError("the port is not open", cure=f"use {self._what} in a `with` block", where=self.port)
        return self._serial

    def _vanished(self, error: Exception) -> DeviceError:
        return DeviceError(
            f"the port has vanished: {error}", cure=f"check the cable and the supply of {self._what}", where=self.port
        )


def _line_end(data: bytearray) -> int:
    ends = [end for end in (data.find(b"\n"), data.find(b"\r")) if end >= 0]
    return min(ends, default=-1)
