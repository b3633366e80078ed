"""Progress on a terminal, signals that ask for a stop at the next checkpoint, and the closing table."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

Handler = Callable[[int, FrameType | None], object] | int | None


class TerminalWatcher:
    """Shows stage, stops done and time left on stderr when it is a terminal; nothing at all elsewhere or if quiet.

    Inside `with`, the first Ctrl-C (or SIGTERM) asks for a stop after the current sweep, the second stops now. Work
    without `checkpoints` at which it could stop is ended by the first.
    """

    def __init__(self, quiet: bool = False, checkpoints: bool = True) -> None:
        console = Console(stderr=True)
        self._progress = Progress(
            TextColumn("{task.description:<22}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=quiet or not console.is_terminal,
            transient=True,
        )
        self._quiet = quiet
        self._task = self._progress.add_task("", total=1)
        self._signals = (signal.SIGINT, signal.SIGTERM) if checkpoints else ()
        self._stop = False
        self._previous: list[tuple[signal.Signals, Handler]] = []

    def __enter__(self) -> Self:
        for number in self._signals:
            self._previous.append((number, signal.signal(number, self._on_signal)))
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()
        for number, handler in self._previous:
            signal.signal(number, handler)

    def stage(self, name: str, total: int = 1) -> None:
        """A new stage begins, of so many steps."""
        self._progress.reset(self._task, description=name, total=total)

    def advance(self, steps: int = 1) -> None:
        """So many steps of the stage are done."""
        self._progress.advance(self._task, steps)

    def warn(self, text: str) -> None:
        """Something that the user should know, not an error."""
        if not self._quiet:
            print(f"surfuse: note: {text}", file=sys.stderr)

    def stop_requested(self) -> bool:
        """Whether the user asked for a stop at the next checkpoint."""
        return self._stop

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self._stop:
            raise KeyboardInterrupt
        self._stop = True
        print("surfuse: stopping after this sweep (Ctrl-C again: now)", file=sys.stderr)
