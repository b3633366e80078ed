"""A viewer server that stays on this computer and prints nothing.

It is bound to the loopback address and to the port that was asked for, opens no tunnel, and answers no request of a
foreign page.
"""

from __future__ import annotations

import logging
import os
import socket
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rich
import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection, serve
from websockets.http11 import Request, Response

from surfuse.errors import ConfigError, UsageError
from surfuse.report.page_guard import LOOPBACK, guard_answer, refused

Handler = Callable[[ServerConnection], Awaitable[None]]
Shown = Callable[[ServerConnection, Request], Response | None]

_STARTING = threading.Lock()
_SILENT = logging.getLogger("surfuse.viewer")
"""Of a server that is asked nonsense: not a word on the terminal of a scan."""
_SILENT.addHandler(logging.NullHandler())
_SILENT.propagate = False


@contextmanager
def silent_console() -> Iterator[None]:
    """Keep the viewer's banners off stdout: it prints through rich's shared console."""
    console = rich.get_console()
    before = console.quiet
    console.quiet = True
    try:
        yield
    finally:
        console.quiet = before


def _refuse_share_url(verbose: bool = True) -> str | None:
    """In place of the viewer's tunnel to an outside server, which any connected page could ask for."""
    return None


def bound_socket(port: int) -> socket.socket:
    """A socket on that port of the loopback address, 0: any free one.

    Raises
    ------
    UsageError : there is no such port, somebody else has it, or it is not for this user.
    """
    if not 0 <= port <= 65535:
        raise UsageError(f"port {port} does not exist", cure="give 0 to 65535; 0 takes any free one")
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        if os.name == "posix":
            # A port whose last connections still time out is free; one that somebody listens on stays taken.
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind((LOOPBACK, port))
        # Taken from now on: without this another program could still bind the same port.
        found.listen()
    except OSError as error:
        found.close()
        raise UsageError(
            f"port {port} of {LOOPBACK} cannot be used ({error.strerror or error})",
            cure="give another one; 0 takes any free one",
        ) from error
    return found


class _GuardedServe:
    """In place of the `serve` of the library that the viewer stands on, while one viewer starts.

    It serves on a socket that is bound already, and asks the guard before the viewer sees a request.
    """

    def __init__(self, listening: socket.socket) -> None:
        self._listening = listening
        self.used = False

    def __call__(self, handler: Handler, host: str, port: int, **settings: Any) -> serve:
        """Serve. The settings are the viewer's, which other versions of it may choose in other ways."""
        show: Shown | None = settings.pop("process_request", None)

        def guarded(connection: ServerConnection, request: Request) -> Response | None:
            return refused(request) or (None if show is None else show(connection, request))

        def answered(connection: ServerConnection, request: Request, response: Response) -> None:
            guard_answer(response)

        self.used = True
        settings |= {"process_request": guarded, "process_response": answered, "logger": _SILENT}
        return serve(handler, sock=self._listening, **settings)


@contextmanager
def _guarded_start(listening: socket.socket) -> Iterator[_GuardedServe]:
    """What a viewer that starts inside the block serves by."""
    guard = _GuardedServe(listening)
    library = websockets.asyncio.server
    with _STARTING:
        before = library.serve
        setattr(library, "serve", guard)  # noqa: B010 - a type checker knows better than to allow it
        # The viewer lets this variable override the port; a stray one must not.
        override = os.environ.pop("_VISER_PORT_OVERRIDE", None)
        try:
            yield guard
        finally:
            setattr(library, "serve", before)  # noqa: B010
            if override is not None:
                os.environ["_VISER_PORT_OVERRIDE"] = override


def _started(listening: socket.socket, label: str) -> viser.ViserServer:
    """A running viewer behind the guard.

    Raises
    ------
    ConfigError : the installed viewer goes round the guard; nothing is served.
    """
    with _guarded_start(listening) as guard:
        server = viser.ViserServer(host=LOOPBACK, port=listening.getsockname()[1], label=label, verbose=False)
    if not guard.used:
        server.stop()
        raise ConfigError(
            f"viser {viser.__version__} cannot be kept from answering foreign pages", cure="install viser 1.1.1"
        )
    return server


@contextmanager
def loopback_server(port: int, label: str) -> Iterator[viser.ViserServer]:
    """A running server, closed with its threads on the way out. Port 0 lets the system choose a free one.

    Raises
    ------
    UsageError : the port cannot be had.
    """
    with bound_socket(port) as listening, silent_console():
        server = _started(listening, label)
        try:
            server.request_share_url = _refuse_share_url  # type: ignore[method-assign]
            server.gui.configure_theme(show_logo=False, show_share_button=False)
            yield server
        finally:
            server.stop()
