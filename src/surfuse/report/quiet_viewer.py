"""A viewer server that stays on this computer and prints nothing: bound to the loopback address, no share tunnel."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import rich
import viser

LOOPBACK = "127.0.0.1"


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


@contextmanager
def loopback_server(port: int, label: str) -> Iterator[viser.ViserServer]:
    """A running server, closed with its threads on the way out. Port 0 lets the system choose a free one.

    The viewer takes the next free port when the asked one is busy: ask the server for the real one.
    """
    # The viewer lets this variable override the port; a stray one must not.
    override = os.environ.pop("_VISER_PORT_OVERRIDE", None)
    with silent_console():
        try:
            server = viser.ViserServer(host=LOOPBACK, port=port, label=label, verbose=False)
        finally:
            if override is not None:
                os.environ["_VISER_PORT_OVERRIDE"] = override
        try:
            server.request_share_url = _refuse_share_url  # type: ignore[method-assign]
            server.gui.configure_theme(show_logo=False, show_share_button=False)
            yield server
        finally:
            server.stop()
