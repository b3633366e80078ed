"""A scan with its progress on the terminal and, if wanted, a page that shows it."""

from __future__ import annotations

import sys
from collections.abc import Callable

from surfuse.cli import _options as options
from surfuse.cli._progress import TerminalWatcher
from surfuse.commands.outcome import Outcome
from surfuse.commands.show.observer import UNOBSERVED, ScanObserver

Job = Callable[[TerminalWatcher, ScanObserver], Outcome]


def watched_command(job: Job, as_json: bool, quiet: bool, view_port: int | None, checkpoints: bool = True) -> int:
    """Run the job, print its outcome and give the exit status; with a port its scan is shown on a page.

    The page outlives the job for as long as somebody looks at it. With `--json` it does not: the reader of the
    document waits for the end of the program. A job without `checkpoints` is ended by the first Ctrl-C.

    Raises
    ------
    UsageError : the port cannot be had; nothing was begun.
    """
    if view_port is None:
        return _run(job, UNOBSERVED, (as_json, quiet), checkpoints)
    # The viewer is loaded only by those who want it.
    from surfuse.commands.show.live_view import live_view

    with live_view(view_port, options.note, _announce) as view:
        status = _run(job, view, (as_json, quiet), checkpoints)
        if not as_json:
            sys.stdout.flush()
            view.stay(lambda text: _say(quiet, text))
        return status


def _run(job: Job, observer: ScanObserver, shown: tuple[bool, bool], checkpoints: bool) -> int:
    as_json, quiet = shown
    with TerminalWatcher(quiet or as_json, checkpoints) as watcher:
        outcome = job(watcher, observer)
    return options.show(outcome.summary, outcome.table, as_json, quiet, outcome.complete)


def _announce(address: str) -> None:
    print(f"surfuse: live view: {address}", file=sys.stderr, flush=True)


def _say(quiet: bool, text: str) -> None:
    if not quiet:
        print(f"surfuse: {text}", file=sys.stderr, flush=True)
