"""Progress on a terminal, signals that ask for a stop at the next checkpoint, and the closing table."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from surfuse.geometry.compiling import COMPILING

LINE_EVERY_S = 10.0
Handler = Callable[[int, FrameType | None], object] | int | None


def compiling_text() -> str:
    """What the compiler does now; empty when it rests."""
    return f"compiling, once: kernel {COMPILING.kernels + 1}" if COMPILING.depth else ""


class CompilingColumn(ProgressColumn):
    """Says that kernels are being compiled, since a stage then takes longer than it ever will again."""

    def render(self, task: Task) -> Text:
        """See `ProgressColumn`."""
        return Text(compiling_text())


class _Lines:
    """A line every so many seconds from a thread of its own, for those who do not look at a terminal."""

    def __init__(self, line: Callable[[], str]) -> None:
        self._line = line
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Begin to count."""
        self._thread.start()

    def stop(self) -> None:
        """No line comes any more."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ended.wait(LINE_EVERY_S):
            print(self._line(), file=sys.stderr, flush=True)


class TerminalWatcher:
    """Shows stage, stops done and time left on stderr; every ten seconds a line where it is no terminal.

    Nothing at all if quiet.

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
            CompilingColumn(),
            console=console,
            disable=quiet or not console.is_terminal,
            transient=True,
        )
        self._quiet = quiet
        self._lines = None if quiet or console.is_terminal else _Lines(self._line)
        self._began_s = time.monotonic()
        self._task = self._progress.add_task("start", total=1)
        self._signals = (signal.SIGINT, signal.SIGTERM) if checkpoints else ()
        self._stop = False
        self._previous: list[tuple[signal.Signals, Handler]] = []

    def __enter__(self) -> Self:
        for number in self._signals:
            self._previous.append((number, signal.signal(number, self._on_signal)))
        self._progress.start()
        if self._lines is not None:
            self._lines.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()
        if self._lines is not None:
            self._lines.stop()
        for number, handler in self._previous:
            signal.signal(number, handler)

    def stage(self, name: str, total: int = 1) -> None:
        """A new stage begins, of so many steps."""
        self._progress.reset(self._task, description=name, total=total)

    def advance(self, steps: int = 1) -> None:
        """So many steps of the stage are done."""
        self._progress.advance(self._task, steps)

    def count(self, name: str, done: int) -> None:
        """So many steps of a stage without a known end are done."""
        self._progress.update(self._task, description=name, completed=done, total=None)

    @property
    def attended(self) -> bool:
        """Whether somebody sits at the terminal."""
        return sys.stdin.isatty() and sys.stderr.isatty()

    def ask(self, question: str) -> str | None:
        """The answer of the user at the terminal; None when nobody is there."""
        if not self.attended:
            return None
        self._progress.stop()
        print(f"{question}\n> ", end="", file=sys.stderr, flush=True)
        try:
            return input()
        except EOFError:
            return None
        finally:
            self._progress.start()

    def warn(self, text: str) -> None:
        """Something that the user should know, not an error."""
        if not self._quiet:
            print(f"surfuse: note: {text}", file=sys.stderr)

    def stop_requested(self) -> bool:
        """Whether the user asked for a stop at the next checkpoint."""
        return self._stop

    def _line(self) -> str:
        task = self._progress.tasks[self._task]
        done = f" {task.completed:.0f} of {task.total:.0f}" if task.total is not None and task.total > 1 else ""
        done = done if task.total is not None else f": {task.completed:.0f}"
        compiling = f" ({compiling_text()})" if COMPILING.depth else ""
        return f"surfuse: {task.description}{done}{compiling}, {time.monotonic() - self._began_s:.0f} s"

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self._stop:
            raise KeyboardInterrupt
        self._stop = True
        print("surfuse: stopping after this sweep (Ctrl-C again: now)", file=sys.stderr)
