"""A running scan on a page of this computer: drawn by a thread of its own, which the scan never waits for."""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import viser

from surfuse.commands.show.map_so_far import MapSoFar, WorkShare
from surfuse.commands.show.observer import PlannedScan
from surfuse.records import SurfaceMap, Sweep
from surfuse.report.live_scene import LiveScene
from surfuse.report.map_layers import add_even_light
from surfuse.report.page_guard import LOOPBACK
from surfuse.report.playback import TICK_S
from surfuse.report.quiet_viewer import loopback_server

PERIOD_S = 0.5
"""The scene is drawn at most so often."""

DRAWING_SHARE, MAP_SHARE = 0.01, 0.02
"""Shares of the time that drawing stops, and making the map, may take of a processor."""

FIRST_PREVIEW_S = 1.0
"""Processor time of the first map of a method's own; it makes tables that the next ones use."""

PATIENCE_S = 5.0
"""A page that is loaded again is away for a moment."""

TOLD_EVERY_S = 0.2


@dataclass(frozen=True)
class Seen:
    """A sweep and when it came."""

    sweep: Sweep
    at_s: float


@dataclass
class LiveView:
    """A `ScanObserver` whose calls only put down what they are told; a thread takes it up and draws.

    A fault of the drawing is one warning: the page stands still and the scan goes on.
    """

    server: viser.ViserServer
    warn: Callable[[str], None]
    _inbox: queue.SimpleQueue[PlannedScan | Seen | SurfaceMap] = field(default_factory=queue.SimpleQueue)
    _ended: threading.Event = field(default_factory=threading.Event)

    def planned(self, scan: PlannedScan) -> None:
        """See `ScanObserver`."""
        self._inbox.put(scan)

    def swept(self, sweep: Sweep) -> None:
        """See `ScanObserver`."""
        self._inbox.put(Seen(sweep, time.monotonic()))

    def finished(self, surface: SurfaceMap) -> None:
        """See `ScanObserver`."""
        self._inbox.put(surface)

    def stay(self, tell: Callable[[str], None]) -> None:
        """Go on showing until the last page is closed, or Ctrl-C; return at once when none is open."""
        if not self.server.get_clients():
            return
        tell("the page stays until it is closed, or Ctrl-C")
        seen_s = time.monotonic()
        try:
            while time.monotonic() - seen_s < PATIENCE_S:
                if self.server.get_clients():
                    seen_s = time.monotonic()
                time.sleep(TOLD_EVERY_S)
        except KeyboardInterrupt:
            return

    @contextmanager
    def drawing(self) -> Iterator[None]:
        """The thread that draws, while the block runs."""
        thread = threading.Thread(target=self._run, name="surfuse live view", daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._ended.set()
            # A thread in the middle of a preview ends after it; nobody waits longer for a picture.
            thread.join(PATIENCE_S)

    def _run(self) -> None:
        try:
            waiting = self.server.gui.add_html('<div style="padding:0 0.9em">the scan has not begun yet</div>')
            drawer: _Drawer | None = None
            while not self._ended.wait(TICK_S):
                while not self._inbox.empty():
                    told = self._inbox.get()
                    if isinstance(told, PlannedScan):
                        waiting.remove()
                        drawer = _Drawer(LiveScene(self.server, told.scene, told.plan, told.link_poses), told)
                    elif drawer is not None:
                        drawer.take(told)
                if drawer is not None:
                    drawer.draw()
        except Exception as error:
            self.warn(f"the live view stands still ({type(error).__name__}: {error}); the scan goes on")


class _Drawer:
    """Brings what was told into the scene, within its share of the time."""

    def __init__(self, scene: LiveScene, scan: PlannedScan) -> None:
        self._scene, self._scan = scene, scan
        self._map = MapSoFar(scan)
        self._drawing, self._mapping = WorkShare(DRAWING_SHARE), WorkShare(MAP_SHARE)
        self._drawn_s, self._first_s, self._last_s, self._came = 0.0, math.inf, 0.0, 0
        self._count, self._mapped, self._final = 0, 0, False
        self._preview_s = FIRST_PREVIEW_S
        self._covered = ""
        for sweep in scan.done:
            self._keep(sweep)

    def take(self, told: Seen | SurfaceMap) -> None:
        """A sweep, or the map of all of them."""
        if isinstance(told, Seen):
            self._first_s = min(self._first_s, told.at_s)
            self._last_s, self._came = told.at_s, self._came + 1
            self._keep(told.sweep)
            return
        self._final = True
        self._show(told)
        self._scene.playback.extend(self._count - 1)
        self._scene.playback.end()
        self._scene.tell(self._status())

    def _keep(self, sweep: Sweep) -> None:
        self._map.take(sweep)
        self._scene.add(sweep)
        self._count += 1

    def draw(self) -> None:
        """Bring the page up to now, if it is time again."""
        self._scene.playback.tick()
        now_s = time.monotonic()
        if self._final or self._count == 0 or now_s - self._drawn_s < PERIOD_S or not self._drawing.allows():
            return
        self._drawn_s, began_s = now_s, time.thread_time()
        self._scene.playback.extend(self._count - 1)
        self._scene.tell(self._status())
        self._drawing.spend(time.thread_time() - began_s)
        if self._mapped < self._count and self._mapping.allows():
            began_s = time.thread_time()
            self._mapped = self._count
            preview = self._map.can_preview() and self._mapping.allows(self._preview_s)
            if (surface := self._map.surface(preview)) is not None:
                self._show(surface)
            spent_s = time.thread_time() - began_s
            self._mapping.spend(spent_s)
            if preview:
                self._preview_s = spent_s

    def _show(self, surface: SurfaceMap) -> None:
        self._covered = _covered_in_words(surface)
        self._scene.show_map(surface)

    def _status(self) -> str:
        total = len(self._scan.plan)
        if self._scan.by_hand:
            words = (
                f"<b>{'done' if self._final else 'recording'}</b>: {self._count} sweeps{self._rate()}{self._covered}"
            )
        elif self._final:
            words = f"<b>done</b>: {self._count} of {total} stops"
        else:
            words = f"<b>{self._count} of {total} stops</b>{self._left(total)}"
        return f'<div style="padding:0 0.9em 0.5em 0.9em">{words}<br>look only: nothing here moves the arm</div>'

    def _rate(self) -> str:
        """Sweeps a second so far."""
        if self._came < 3 or self._last_s <= self._first_s:
            return ""
        return f", {(self._came - 1) / (self._last_s - self._first_s):.0f} a second"

    def _left(self, total: int) -> str:
        """The time left, from the pace so far."""
        if self._came < 3:
            return ""
        left_s = (self._last_s - self._first_s) / (self._came - 1) * max(total - self._count, 0)
        minutes, seconds = divmod(round(left_s), 60)
        return f", {minutes} min {seconds:02d} s left" if minutes else f", {seconds} s left"


def _covered_in_words(surface: SurfaceMap) -> str:
    """Cells with a value, their area, their median sigma."""
    cells = int(surface.mask.sum())
    if cells == 0:
        return ""
    grid = surface.grid
    steps_m = [float(np.median(np.diff(axis))) if len(axis) > 1 else 0.0 for axis in (grid.u_m, grid.v_m)]
    sigma_mm = 1e3 * float(np.median(surface.sigma_m[surface.mask]))
    return f", {cells} cells ({1e4 * cells * steps_m[0] * steps_m[1]:.0f} cm2), median sigma {sigma_mm:.2g} mm"


@contextmanager
def live_view(port: int, warn: Callable[[str], None], announce: Callable[[str], None]) -> Iterator[LiveView]:
    """A page on the loopback address while the block runs; `announce` is told its address once.

    Raises
    ------
    UsageError : the port cannot be had.
    """
    with loopback_server(port, "surfuse: live") as server:
        # Before the first page comes: one that is open already does not notice a new light.
        add_even_light(server.scene)
        view = LiveView(server, warn)
        announce(f"http://{LOOPBACK}:{server.get_port()}")
        with view.drawing():
            yield view
