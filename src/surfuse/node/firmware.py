"""The node's program: a responder on any python-can bus, in a thread of this process or as a process of its own."""

from __future__ import annotations

import threading
import time
from types import TracebackType
from typing import Self

from surfuse.node.link import Link
from surfuse.node.responder import Responder

_POLL_S = 0.05


class Node:
    """A sensor node in a thread of its own; `with` starts and stops it.

    Parameters
    ----------
    responder : what it answers.
    link : its end of the bus.
    heartbeat_s : seconds between signs of life.
    """

    def __init__(self, responder: Responder, link: Link, *, heartbeat_s: float = 1.0) -> None:
        self._responder, self._link, self._heartbeat_s = responder, link, heartbeat_s
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        self._link.__enter__()
        self._stop.clear()
        self._thread = threading.Thread(target=self._loop, name="surfuse-node", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
        self._link.__exit__(kind, error, trace)

    def _loop(self) -> None:
        serve(self._responder, self._link, self._stop, self._heartbeat_s)


def run(responder: Responder, link: Link, stop: threading.Event, *, heartbeat_s: float = 1.0) -> None:
    """Be a node in the calling thread until `stop` is set: the whole program of a node process.

    Raises
    ------
    DeviceError : the adapter cannot be opened at the start; later it is opened anew without end.
    """
    with link:
        serve(responder, link, stop, heartbeat_s)


def serve(responder: Responder, link: Link, stop: threading.Event, heartbeat_s: float) -> None:
    """Answer the frames of an open bus, and send a heartbeat at once and then every `heartbeat_s`."""
    due_s = time.monotonic()
    while not stop.is_set():
        if time.monotonic() >= due_s:
            due_s = time.monotonic() + heartbeat_s
            link.send(responder.heartbeat())
        arrival = link.receive(_POLL_S)
        if arrival is None:
            continue
        for frame in responder.answer(arrival.frame):
            if not link.send(frame):
                responder.send_errors += 1
