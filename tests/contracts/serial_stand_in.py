"""A ranger that talks by itself on a pseudo-terminal."""

from __future__ import annotations

import os
import threading
from typing import Self

import pytest


class TalkingLine:
    """Sends the same frame again and again, as a free-running ranger does."""

    def __init__(self, frame: bytes) -> None:
        tty = pytest.importorskip("tty", reason="pseudo-terminals need POSIX")
        pytest.importorskip("serial")
        self._frame, self._stop = frame, threading.Event()
        self._controller, self._device = os.openpty()
        for descriptor in (self._controller, self._device):
            tty.setraw(descriptor)
            os.set_blocking(descriptor, False)
        self._thread = threading.Thread(target=self._talk, daemon=True)
        self._gone = False

    @property
    def port(self) -> str:
        return os.ttyname(self._device)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.vanish()

    def vanish(self) -> None:
        """Pull the plug."""
        if not self._gone:
            self._gone = True
            self._stop.set()
            self._thread.join()
            os.close(self._controller)
            os.close(self._device)

    def _talk(self) -> None:
        while not self._stop.wait(0.005):
            try:
                os.write(self._controller, self._frame)
            except BlockingIOError:
                # Nobody reads yet.
                continue
