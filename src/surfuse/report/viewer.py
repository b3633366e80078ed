"""The scan live in a browser of this computer: look only, nothing in it can move an arm or change a run."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import viser

from surfuse.report.content import ReportContent
from surfuse.report.map_layers import LAYERS, legend_html
from surfuse.report.page_guard import LOOPBACK
from surfuse.report.playback import Playback, ticking
from surfuse.report.quiet_viewer import loopback_server
from surfuse.report.scan_scene import ScanScene, add_scale_of
from surfuse.report.scene_limits import SceneLimits

LIVE_LIMITS = SceneLimits(nodes_max=40000, surfaces_max=12, frames_max=100000)


def _add_surface_boxes(server: viser.ViserServer, scan: ScanScene) -> None:
    def box(label: str) -> None:
        check = server.gui.add_checkbox(label, initial_value=scan.surfaces[label].visible)

        @check.on_update
        def _(_: object) -> None:
            # A map in other colours is another node.
            scan.surfaces[label].visible = check.value

    with server.gui.add_folder("Surfaces"):
        for label in scan.surfaces:
            box(label)


def _add_layer_choice(server: viser.ViserServer, scan: ScanScene, beams: bool) -> None:
    """What the colours stand for, and the choice of it."""
    choice = server.gui.add_dropdown("Map", LAYERS, initial_value=LAYERS[0])
    legend = server.gui.add_html(legend_html(scan.colour_by(LAYERS[0]), beams))
    turn = threading.Lock()

    @choice.on_update
    def _(_: object) -> None:
        with turn:
            legend.content = legend_html(scan.colour_by(choice.value), beams)


@contextmanager
def opened(content: ReportContent, port: int = 8080) -> Iterator[str]:
    """Open the viewer on the loopback address; yields its address.

    Raises
    ------
    UsageError : the port cannot be had.
    """
    with loopback_server(port, content.title[:60]) as server:
        scan = ScanScene(server, content, LIVE_LIMITS)
        if content.maps or len(scan.moments):
            _add_layer_choice(server, scan, beams=len(scan.moments) > 0)
        if scan.surfaces:
            _add_surface_boxes(server, scan)
        add_scale_of(server.scene, content)
        address = f"http://{LOOPBACK}:{server.get_port()}"
        if not len(scan.moments):
            yield address
            return
        last = int(scan.moments[-1])
        scan.show(last)
        with ticking(Playback(server.gui, scan.show, last)):
            yield address


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
