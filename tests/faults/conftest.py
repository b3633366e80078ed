"""Processes of `surfuse` that are killed or held at an exact place of their log."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.reader import make_reader

Process = subprocess.Popen[str]


def started_at_a_size(number: int, size: int, *words: object) -> Process:
    """`surfuse WORDS...`, which sends itself a signal when its log has a size in bytes."""
    program = Path(__file__).with_name("at_a_size.py")
    command = [sys.executable, str(program), str(number), str(size), *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def killed_at_a_size(size: int, *words: object) -> None:
    """Run it until its log has a size, where it is killed; a run that ends before ends well."""
    process = started_at_a_size(signal.SIGKILL, size, *words)
    _, errors = process.communicate()
    assert process.returncode in (-signal.SIGKILL, 0), errors


def held_at_a_size(size: int, *words: object) -> Process:
    """The process, asleep since its log has a size; SIGCONT wakes it, after what else was sent to it."""
    process = started_at_a_size(signal.SIGSTOP, size, *words)
    state = os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WEXITED | os.WNOWAIT)
    assert state is not None
    assert state.si_status == signal.SIGSTOP, process.communicate()[1]
    return process


@pytest.fixture(scope="session")
def killed_at() -> Callable[..., None]:
    return killed_at_a_size


@pytest.fixture(scope="session")
def held_at() -> Callable[..., Process]:
    return held_at_a_size


def places_of_sweeps(run: Path) -> list[int]:
    """Bytes of a complete log before each of its sweeps, and before its end: each sweep is a chunk, at the end."""
    with (run / "log" / "000.mcap").open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    sweeps = chunks[-json.loads((run / "summary.json").read_text())["stops"] :]
    return [*(chunk.chunk_start_offset for chunk in sweeps), sweeps[-1].chunk_start_offset + sweeps[-1].chunk_length]


@pytest.fixture(scope="session")
def sweep_places() -> Callable[[Path], list[int]]:
    return places_of_sweeps
