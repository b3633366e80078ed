"""The scan live in a browser of this computer: look only, nothing in it can move an arm or change a run."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import viser

from surfuse.report.content import ReportContent
from surfuse.report.page_guard import LOOPBACK
from surfuse.report.quiet_viewer import loopback_server
from surfuse.report.scan_scene import ScanScene
from surfuse.report.scene_limits import SceneLimits

LIVE_LIMITS = SceneLimits(nodes_max=40000, surfaces_max=12, frames_max=100000)


def _add_surface_boxes(server: viser.ViserServer, scan: ScanScene) -> None:
    def box(label: str, handle: viser.SceneNodeHandle) -> None:
        check = server.gui.add_checkbox(label, initial_value=handle.visible)

        @check.on_update
        def _(_: object) -> None:
            handle.visible = check.value

    with server.gui.add_folder("Surfaces"):
        for label, handle in scan.surfaces.items():
            box(label, handle)


def _add_stop_slider(server: viser.ViserServer, scan: ScanScene) -> None:
    last = int(scan.moments[-1])
    turn = threading.Lock()
    with server.gui.add_folder("Scan"):
        slider = server.gui.add_slider("Stop", min=0, max=max(last, 1), step=1, initial_value=last)

    @slider.on_update
    def _(_: object) -> None:
        # Callbacks run on several threads; the scene remembers what it shows.
        with turn:
            scan.show(min(int(slider.value), last))


@contextmanager
def opened(content: ReportContent, port: int = 8080) -> Iterator[str]:
    """Open the viewer on the loopback address; yields its address.

    Raises
    ------
    UsageError : the port cannot be had.
    """
    with loopback_server(port, content.title[:60]) as server:
        scan = ScanScene(server, content, LIVE_LIMITS)
        if scan.surfaces:
            _add_surface_boxes(server, scan)
        if len(scan.moments):
            scan.show(int(scan.moments[-1]))
            _add_stop_slider(server, scan)
        yield f"http://{LOOPBACK}:{server.get_port()}"


def serve(
    content: ReportContent,
    port: int = 8080,
    announce: Callable[[str], None] = lambda _: None,
    until: threading.Event | None = None,
) -> None:
    """Show the scan until Ctrl-C (or until the event is set); `announce` is told the real address once."""
    stop = until or threading.Event()
    with opened(content, port) as address:
        announce(address)
        try:
            # Short waits keep Ctrl-C alive on every system.
            while not stop.wait(0.2):
                pass
        except KeyboardInterrupt:
            return
