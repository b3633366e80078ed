"""Controls of the moment that a scene shows: a slider over the stops, and a button that plays them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import viser

T = TypeVar("T")

TICK_S = 0.1
PLAY_S = 16.0
"""So long a whole scan plays."""


class Playback:
    """Slider and button. All pages share them, as they share the scene; nothing else listens to them."""

    def __init__(self, gui: viser.GuiApi, show: Callable[[int], None], last: int, follow: bool = False) -> None:
        self._show, self._last, self._turn = show, last, threading.Lock()
        self._playing, self._shown, self._at = False, -1, float(last)
        with gui.add_folder("Scan"):
            self._slider = gui.add_slider("Stop", min=0, max=max(last, 1), step=1, initial_value=max(last, 0))
            self._play = gui.add_button("Play")
            self._follow = gui.add_checkbox("Follow the scan", initial_value=True) if follow else None
        self._slider.on_update(lambda _: self._bring(int(self._slider.value)))
        self._play.on_click(lambda _: self._toggle())

    @property
    def following(self) -> bool:
        """Whether the newest stop shall be shown."""
        return self._follow is not None and bool(self._follow.value) and not self._playing

    def extend(self, last: int) -> None:
        """The scan has stops up to this number now; it is shown to those who follow."""
        self._last = last
        if last > self._slider.max:
            self._slider.max = last
        if self.following:
            _put(self._slider, last)
            self._bring(last)

    def end(self) -> None:
        """Nothing more comes: there is nothing to follow."""
        if self._follow is not None:
            _put(self._follow, False)
            self._follow.visible = False

    def tick(self) -> None:
        """Go on by one tick if the scan is played."""
        if not self._playing:
            return
        self._at = min(self._at + max(self._last, 1) * TICK_S / PLAY_S, float(self._last))
        _put(self._slider, int(self._at))
        self._bring(int(self._at))
        if self._at >= self._last:
            self._stand()

    def _toggle(self) -> None:
        if self._playing:
            self._stand()
            return
        at = int(self._slider.value)
        self._at = 0.0 if at >= self._last else float(at)
        if self._follow is not None:
            _put(self._follow, False)
        self._playing, self._play.label = True, "Pause"

    def _stand(self) -> None:
        self._playing, self._play.label = False, "Play"

    def _bring(self, stop: int) -> None:
        # Callbacks run on several threads; the scene remembers what it shows.
        with self._turn:
            stop = min(stop, self._last)
            if stop != self._shown and stop >= 0:
                self._shown = stop
                self._show(stop)


def _put(handle: viser.GuiInputHandle[T], value: T) -> None:
    """Set what a control shows."""
    # The viewer defines this property in a way that the type checker takes for read-only.
    handle.value = value  # type: ignore[misc]


@contextmanager
def ticking(playback: Playback) -> Iterator[None]:
    """A thread that lets the scan play while the block runs."""
    ended = threading.Event()

    def run() -> None:
        while not ended.wait(TICK_S):
            playback.tick()

    thread = threading.Thread(target=run, name="surfuse playback", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
