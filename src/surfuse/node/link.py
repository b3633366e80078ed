"""One end of the bus: any python-can interface, its own reader thread, reopened when the adapter goes away.

python-can's `Notifier` ends silently when a receive raises, and a truncated line of a serial adapter raises IndexError
or ValueError, so frames are read here, and whatever a receive raises is counted. Frames are stamped on arrival with the
clock of this end: adapters stamp with wall time, which jumps.
"""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, NamedTuple, Protocol, Self

import can

from surfuse.errors import ConfigError, DeviceError
from surfuse.interfaces import Clock
from surfuse.node.counters import BusEvent, Tally
from surfuse.node.messages import CanFrame

_POLL_S = 0.05
_SEND_TIMEOUT_S = 0.5
_BACKOFF_FIRST_S = 0.05
_BACKOFF_LAST_S = 2.0
_GARBAGE_LIMIT = 100
_QUEUE_FRAMES = 8192
_CAN_ERR_BUSOFF = 0x40

OpenBus = Callable[[], can.BusABC]


@dataclass(frozen=True)
class BusParameters:
    """Which CAN adapter, in python-can's words.

    interface : `virtual` inside one process, `udp_multicast` between processes, else slcan, gs_usb, socketcan, pcan...
    channel : name, port or group of the adapter (`vcan0`, `/dev/ttyACM0`, `239.74.163.2`).
    bitrate_bps : bits per second on the wire.
    options : further arguments of the adapter, as (name, value) pairs.
    """

    interface: str = "virtual"
    channel: str = "surfuse"
    bitrate_bps: int = 1_000_000
    options: tuple[tuple[str, str | int | float | bool], ...] = ()

    def __post_init__(self) -> None:
        if self.interface not in can.VALID_INTERFACES:
            valid = ", ".join(sorted(can.VALID_INTERFACES))
            raise ConfigError(f"interface = '{self.interface}'", cure=f"python-can knows {valid}")
        if not 10_000 <= self.bitrate_bps <= 1_000_000:
            raise ConfigError(f"bitrate_bps = {self.bitrate_bps}", cure="give 10000 to 1000000, as classic CAN")


def open_bus(parameters: BusParameters) -> can.BusABC:
    """Open the adapter.

    Raises
    ------
    DeviceError : it is not there, or refuses; the text of the adapter is passed on.
    """
    extra: dict[str, Any] = dict(parameters.options)
    if parameters.interface == "udp_multicast":
        extra = {"fd": False} | extra
    elif parameters.interface != "virtual":
        extra = {"bitrate": parameters.bitrate_bps} | extra
    where = f"{parameters.interface} {parameters.channel}"
    try:
        return can.Bus(channel=parameters.channel, interface=parameters.interface, ignore_config=True, **extra)
    except Exception as error:  # vendor backends raise whatever their libraries raise
        cure = "check the adapter and its name with `surfuse devices`"
        raise DeviceError(f"the CAN adapter cannot be opened: {error}", cure=cure, where=where) from error


class Arrival(NamedTuple):
    """A frame and when it came: host clock, s."""

    frame: CanFrame
    t_s: float


class Link(Protocol):
    """Frames out and in; what the array needs of a bus."""

    def __enter__(self) -> Self: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...
    def send(self, frame: CanFrame) -> bool:
        """Put a frame on the bus; False when the adapter refuses."""

    def receive(self, timeout_s: float) -> Arrival | None:
        """The next frame, or None when none came in time."""


class BusLink:
    """A python-can bus with a reader thread.

    Parameters
    ----------
    opener : opens the bus; called again with growing pauses (0.05 to 2 s) when the adapter fails.
    clock : stamps the arrivals.
    tally : where trouble is counted.
    """

    def __init__(self, opener: OpenBus, clock: Clock, tally: Tally) -> None:
        self._opener, self._clock, self._tally = opener, clock, tally
        self._arrivals: queue.Queue[Arrival] = queue.Queue(_QUEUE_FRAMES)
        self._stop = threading.Event()
        self._broken = threading.Event()
        self._bus: can.BusABC | None = None
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        self._bus = self._opener()
        self._stop.clear()
        self._broken.clear()
        self._thread = threading.Thread(target=self._read, name="surfuse-bus-reader", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        if self._thread is not None:
            # A wall clock that steps back can keep python-can's receive waiting; the thread is a daemon, so go on.
            self._thread.join(timeout=1.0)
        self._close()

    def send(self, frame: CanFrame) -> bool:
        """Put a frame on the bus; False when the adapter refuses, which also makes the reader open it anew."""
        bus = self._bus
        if bus is None:
            self._tally.add(BusEvent.SEND_ERRORS)
            return False
        try:
            bus.send(_message(frame), timeout=_SEND_TIMEOUT_S)
        except Exception:  # vendor backends raise whatever their libraries raise
            self._tally.add(BusEvent.SEND_ERRORS)
            self._broken.set()
            return False
        return True

    def receive(self, timeout_s: float) -> Arrival | None:
        """The next frame, or None when none came in time."""
        try:
            return self._arrivals.get(timeout=max(timeout_s, 0.0))
        except queue.Empty:
            return None

    def _read(self) -> None:
        garbage = 0
        while not self._stop.is_set():
            bus = self._bus
            if bus is None or self._broken.is_set():
                self._reopen()
                garbage = 0
                continue
            try:
                message = bus.recv(_POLL_S)
            except (IndexError, ValueError) as error:
                # A damaged line of a serial adapter: the next one may be whole. But python-can's slcan keeps bytes
                # that are no ASCII in its buffer, where they spoil every line that follows.
                self._tally.add(BusEvent.RECEIVE_ERRORS)
                garbage += 1
                if garbage > _GARBAGE_LIMIT or isinstance(error, UnicodeDecodeError):
                    self._broken.set()
            except Exception:  # vendor backends raise whatever their libraries raise
                self._tally.add(BusEvent.RECEIVE_ERRORS)
                self._broken.set()
            else:
                if message is not None:
                    garbage = 0
                    self._take(message)
                elif _is_bus_off(bus):
                    self._tally.add(BusEvent.BUS_OFF)
                    self._broken.set()

    def _take(self, message: can.Message) -> None:
        self._tally.add(BusEvent.FRAMES)
        if message.is_error_frame:
            self._tally.add(BusEvent.ERROR_FRAMES)
            if message.arbitration_id & _CAN_ERR_BUSOFF:
                self._tally.add(BusEvent.BUS_OFF)
                self._broken.set()
            return
        if message.is_remote_frame or message.is_extended_id or message.is_fd:
            self._tally.add(BusEvent.FOREIGN)
            return
        # A length that the data does not have is a wrong length whatever the data is.
        data = bytes(message.data) if message.dlc == len(message.data) else b""
        arrival = Arrival(CanFrame(message.arbitration_id, data), self._clock.now_s())
        while True:
            try:
                self._arrivals.put_nowait(arrival)
                return
            except queue.Full:
                with contextlib.suppress(queue.Empty):
                    self._arrivals.get_nowait()
                self._tally.add(BusEvent.OVERFLOWED)

    def _reopen(self) -> None:
        self._close()
        pause_s = _BACKOFF_FIRST_S
        while not self._stop.wait(pause_s):
            try:
                self._bus = self._opener()
            except DeviceError:
                pause_s = min(2.0 * pause_s, _BACKOFF_LAST_S)
                continue
            self._tally.add(BusEvent.REOPENED)
            self._broken.clear()
            return

    def _close(self) -> None:
        bus, self._bus = self._bus, None
        if bus is not None:
            with contextlib.suppress(Exception):
                bus.shutdown()


def _is_bus_off(bus: can.BusABC) -> bool:
    try:
        return bus.state is can.BusState.ERROR
    except Exception:  # many adapters do not know their state
        return False


def _message(frame: CanFrame) -> can.Message:
    return can.Message(arbitration_id=frame.identifier, data=frame.data, is_extended_id=False, check=True)
