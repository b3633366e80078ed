"""A person who waits is told that something goes on: on a terminal all the time, in a pipe every ten seconds."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")

WAITING = """
import time
from surfuse.cli import _progress
from surfuse.geometry.compiling import COMPILING
_progress.LINE_EVERY_S = 0.05
with _progress.TerminalWatcher({quiet}) as watcher:
    watcher.stage("search", 5)
    watcher.advance(2)
    COMPILING.kernels = 41
    COMPILING.begin()
    time.sleep(1.0)
    COMPILING.end()
    time.sleep(1.0)
"""


def program(quiet: bool = False) -> list[str]:
    return [sys.executable, "-c", WAITING.format(quiet=quiet)]


def test_on_a_terminal_the_seconds_run_while_a_kernel_is_compiled() -> None:
    import pty

    ours, theirs = pty.openpty()
    with subprocess.Popen(program(), stderr=theirs, env={**os.environ, "TERM": "xterm", "COLUMNS": "140"}) as process:
        os.close(theirs)
        written: list[tuple[float, str]] = []
        while select.select([ours], [], [], 60.0)[0]:
            try:
                text = os.read(ours, 65536).decode("utf-8", "replace")
            except OSError:  # the other side is closed
                break
            if not text:
                break
            written.append((time.monotonic(), text))
        assert process.wait(60.0) == 0
    os.close(ours)
    told = "".join(text for _, text in written)
    assert "search" in told
    assert "2/5" in told
    assert "compiling, once: kernel 42" in told
    # The line is drawn again and again though nothing is done.
    assert told.count("search") > 3


def test_in_a_pipe_there_is_a_line_from_time_to_time() -> None:
    done = subprocess.run(program(), capture_output=True, text=True, check=True, timeout=110)
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    assert len(lines) > 2
    assert any(line.startswith("surfuse: search 2 of 5 (compiling, once: kernel 42), ") for line in lines)
    assert lines[-1].startswith("surfuse: search 2 of 5, ")


def test_quiet_is_quiet() -> None:
    done = subprocess.run(program(quiet=True), capture_output=True, text=True, check=True, timeout=110)
    assert done.stdout == done.stderr == ""
