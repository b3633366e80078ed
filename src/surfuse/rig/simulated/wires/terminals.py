"""Pseudo-terminals with a device of the twin at the other end."""

from __future__ import annotations

import contextlib
import os
import threading
from types import TracebackType
from typing import Self

from surfuse.errors import DeviceError
from surfuse.interfaces import Device, RangeSensor
from surfuse.rig.simulated.kit_on_a_line import KitOnALine, ServedKit
from surfuse.rig.simulated.wires.frames import Encode


class Terminal:
    """A pseudo-terminal; `port` is the name by which a program opens it as a serial port."""

    def __init__(self) -> None:
        self.controller, self._device = -1, -1
        self.port = ""

    def __enter__(self) -> Self:
        try:
            import tty
        except ImportError as error:
            raise DeviceError(
                "this system has no pseudo-terminals", cure="serve serial rangers on Linux or macOS"
            ) from error
        self.controller, self._device = os.openpty()
        for end in (self.controller, self._device):
            tty.setraw(end)
        self.port = os.ttyname(self._device)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self.controller)
        os.close(self._device)


class TalkingRanger:
    """A free-running ranger: it says what it measures every `period_s`, whether somebody listens or not."""

    def __init__(self, sensor: RangeSensor, encode: Encode, period_s: float) -> None:
        self._sensor, self._encode, self._period_s = sensor, encode, period_s
        self._terminal, self._end = Terminal(), threading.Event()
        self._thread = threading.Thread(target=self._talk, name="surfuse-ranger", daemon=True)

    @property
    def port(self) -> str:
        """Its serial port, while it is open."""
        return self._terminal.port

    def __enter__(self) -> Self:
        self._terminal.__enter__()
        os.set_blocking(self._terminal.controller, False)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end.set()
        self._thread.join()
        self._terminal.__exit__(kind, error, trace)

    def _talk(self) -> None:
        while not self._end.wait(self._period_s):
            frame = self._encode(self._sensor.fire())
            # When nobody reads, what is said is lost.
            with contextlib.suppress(BlockingIOError):
                os.write(self._terminal.controller, frame)


class TerminalKit:
    """A ranging kit that answers on a pseudo-terminal."""

    def __init__(self, kit: KitOnALine) -> None:
        self._kit, self._terminal = kit, Terminal()
        self._served: Device | None = None

    @property
    def port(self) -> str:
        """Its serial port, while it is open."""
        return self._terminal.port

    def __enter__(self) -> Self:
        self._terminal.__enter__()
        self._served = ServedKit(self._kit, self._terminal.controller)
        self._served.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._served is not None:
            self._served.__exit__(kind, error, trace)
        self._terminal.__exit__(kind, error, trace)
