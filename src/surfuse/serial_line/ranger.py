"""A ranger that sends frames on a serial port by itself, read so that each reading is younger than its trigger."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Self

from surfuse.errors import DeviceError
from surfuse.extras import needed_by
from surfuse.records import Echo, SensorSpec, Status
from surfuse.serial_line.frames import LineParser, LineReading

if TYPE_CHECKING:
    from serial import Serial

_POLL_S = 0.01


class SerialRanger:
    """One free-running ranger.

    Parameters
    ----------
    spec : what is known of it.
    parser : its frames.
    port : `/dev/ttyUSB0`, `COM3`, or a URL of pyserial.
    baud_bps : speed of the line; 8 data bits, no parity, 1 stop bit.
    timeout_s : how long `fire` waits for whole frames; then the reading is a fault.
    now_s : time of the echoes.
    agreement_m : for lines without a check sum, two readings in a row must agree so closely; None: one is enough.
    """

    def __init__(
        self,
        spec: SensorSpec,
        parser: LineParser,
        port: str,
        baud_bps: int,
        timeout_s: float,
        now_s: Callable[[], float] = time.monotonic,
        agreement_m: float | None = None,
    ) -> None:
        self._spec, self._parser, self._port, self._baud_bps = spec, parser, port, baud_bps
        self._timeout_s, self._now_s, self._agreement_m = timeout_s, now_s, agreement_m
        self._line: Serial | None = None

    def __enter__(self) -> Self:
        with needed_by("a sensor on a serial port", self._port):
            import serial
        try:
            line = serial.serial_for_url(self._port, self._baud_bps, timeout=_POLL_S)
        except (OSError, ValueError) as error:
            cure = "see `surfuse devices` for the ports of this machine"
            raise DeviceError(f"the port cannot be opened: {error}", cure=cure, where=self._port) from error
        self._line = line
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        line, self._line = self._line, None
        if line is not None:
            line.close()

    @property
    def spec(self) -> SensorSpec:
        """What is known of the sensor."""
        return self._spec

    @property
    def rejected(self) -> int:
        """Pieces of the stream that were no frame."""
        return self._parser.rejected

    def fire(self) -> Echo:
        """The first reading that was measured wholly after the call; a fault when none comes in time.

        The frame under way when the call begins may be older than the call, so it is passed over; the next one was
        measured after it, and its arrival is the earliest moment of the emission.

        Raises
        ------
        DeviceError : the port is closed or has vanished.
        """
        if self._line is None:
            raise DeviceError("the port is not open", cure="use the sensor in a `with` block", where=self._port)
        start_s = self._now_s()
        give_up_s = time.monotonic() + self._timeout_s
        previous_s: float | None = None
        candidate: LineReading | None = None
        self._read(self._line, fresh=True)
        self._parser.reset()
        while time.monotonic() < give_up_s:
            readings = self._parser.feed(self._read(self._line, fresh=False))
            # Readings that come together cannot be told apart in age: the last one stands for them.
            for reading in readings[-1:]:
                if previous_s is not None and (self._agreement_m is None or self._agrees(candidate, reading)):
                    count = 1 if reading.status is Status.OK else 0
                    return Echo(reading.range_m, reading.status, previous_s, reading.amplitude, count=count)
                candidate = None if previous_s is None else reading
                previous_s = self._now_s()
        return Echo(math.nan, Status.FAULT, start_s, count=0)

    def _agrees(self, one: LineReading | None, two: LineReading) -> bool:
        if one is None or self._agreement_m is None or one.status is not two.status:
            return False
        return two.status is not Status.OK or abs(one.range_m - two.range_m) <= self._agreement_m

    def _read(self, line: Serial, *, fresh: bool) -> bytes:
        """What has come, waiting a little; `fresh`: throw away what has come."""
        try:
            if fresh:
                line.reset_input_buffer()
                return b""
            return line.read(max(1, line.in_waiting))
        except Exception as error:  # a vanished port raises SerialException, OSError, TypeError or termios.error
            cure = "check the cable and the supply of the sensor"
            raise DeviceError(f"the port has vanished: {error}", cure=cure, where=self._port) from error
