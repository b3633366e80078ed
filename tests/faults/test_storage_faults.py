"""What the disk and the system do to a log: kills, cuts, flipped bits, no space, a folder that goes away."""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from surfuse.errors import DataError, StorageError
from surfuse.runs import segment as segment_module
from surfuse.runs.log_reader import read_log
from surfuse.runs.log_walk import walk
from surfuse.runs.log_writer import LogWriter

_FACTORY = Path(__file__).parents[1] / "runs" / "scan_factory.py"
_STOPS = 12


def _load_factory():
    spec = importlib.util.spec_from_file_location("scan_factory", _FACTORY)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


scans = _load_factory()
scans.sweep = functools.cache(scans.sweep)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> bytes:
    """One finished segment with scene and sweeps, made once; tests read it and never write to it."""
    folder = tmp_path_factory.mktemp("recorded") / "log"
    with LogWriter(folder) as log:
        log.append_scene(scans.scene())
        log.append_plan(scans.plan())
        for stop in range(_STOPS):
            log.append_sweep(scans.sweep(stop))
    return (folder / "000.mcap").read_bytes()


_WRITER = """
import importlib.util, sys
from pathlib import Path
from surfuse.runs.log_writer import LogWriter
spec = importlib.util.spec_from_file_location("scan_factory", sys.argv[2])
scans = importlib.util.module_from_spec(spec); spec.loader.exec_module(scans)
with LogWriter(Path(sys.argv[1])) as log:
    log.append_scene(scans.scene())
    for stop in range(100000):
        log.append_sweep(scans.sweep(stop))
        print(stop, flush=True)
"""


@pytest.mark.parametrize("round_", range(4))
def test_after_kill_9_every_sweep_that_was_reported_is_there(tmp_path, round_):
    process = subprocess.Popen(
        [sys.executable, "-c", _WRITER, str(tmp_path / "log"), str(_FACTORY)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(random.Random(round_).uniform(0.0, 0.4))
    process.send_signal(signal.SIGKILL)
    reported = 0
    for line in process.stdout:
        # A line cut by the kill is no report.
        reported = int(line) if line.endswith("\n") else reported
    process.stdout.close()
    process.wait()
    log = read_log(tmp_path)
    assert len(log.sweeps) >= reported + 1
    for sweep in log.sweeps[:: max(len(log.sweeps) // 20, 1)]:
        assert scans.same(sweep, scans.sweep(sweep.stop))
    assert [sweep.stop for sweep in log.sweeps] == list(range(len(log.sweeps)))


def _sweep_ends(data: bytes) -> list[int]:
    """File positions at which one more sweep is complete, by reading prefixes at the ends of all records."""
    ends, position = [], 8
    while position < len(data) - 8:
        position += 9 + int.from_bytes(data[position + 1 : position + 9], "little")
        ends.append(position)
    return ends


def _check_cut(tmp_path, data: bytes, cut: int) -> int:
    path = tmp_path / "000.mcap"
    path.write_bytes(data[:cut])
    log = read_log(path)
    assert scans.same(log.sweeps, tuple(scans.sweep(stop) for stop in range(len(log.sweeps))))
    assert log.damage, "a cut file must be told"
    return len(log.sweeps)


def test_a_log_cut_anywhere_gives_all_whole_sweeps(tmp_path, recorded):
    counts = [_check_cut(tmp_path, recorded, len(recorded) * percent // 100) for percent in range(0, 100, 2)]
    assert counts == sorted(counts)
    assert counts[-1] == _STOPS


def test_a_log_cut_at_and_around_record_edges_gives_all_whole_sweeps(tmp_path, recorded):
    whole_so_far = 0
    for end in _sweep_ends(recorded):
        for cut in (end - 1, end + 1, end + 9):
            if cut < len(recorded):
                found = _check_cut(tmp_path, recorded, cut)
                assert found >= whole_so_far
        whole_so_far = _check_cut(tmp_path, recorded, end) if end < len(recorded) else whole_so_far


def test_garbage_after_the_last_sync_is_dropped_and_told(tmp_path, recorded):
    cut = _sweep_ends(recorded)[10]
    whole = _check_cut(tmp_path, recorded, cut)
    for seed in range(10):
        path = tmp_path / "000.mcap"
        path.write_bytes(recorded[:cut] + random.Random(seed).randbytes(3000))
        log = read_log(path)
        assert len(log.sweeps) == whole
        assert log.damage


def test_no_flipped_bit_changes_a_sweep_silently(tmp_path, recorded):
    chance = random.Random(20)
    path = tmp_path / "000.mcap"
    lost = 0
    for _ in range(400):
        data = bytearray(recorded)
        bit = chance.randrange(8 * len(data))
        data[bit // 8] ^= 1 << (bit % 8)
        path.write_bytes(data)
        log = read_log(path)
        for sweep in log.sweeps:
            assert scans.same(sweep, scans.sweep(sweep.stop)), f"bit {bit}: stop {sweep.stop} is wrong, silently"
        if len(log.sweeps) < _STOPS:
            assert log.damage, f"bit {bit}: {_STOPS - len(log.sweeps)} sweeps are missing without a word"
        lost += _STOPS - len(log.sweeps)
        assert len(log.sweeps) >= _STOPS - 1, f"bit {bit} cost more than the sweep that it hit"
        if log.plan is not None:
            assert scans.same(log.plan, scans.plan())
        if log.scene is not None:
            assert scans.same(log.scene, scans.scene())
    assert lost > 100, "flips in the chunks of sweeps must be detected"


def test_flips_in_every_record_head_cost_one_sweep_at_most(tmp_path, recorded):
    """The heads are where a naive walk loses everything behind the flip."""
    path = tmp_path / "000.mcap"
    heads = [8, *_sweep_ends(recorded)[:-1]]
    for head in heads[::2]:
        for bit in range(0, 9 * 8, 7):
            data = bytearray(recorded)
            data[head + bit // 8] ^= 1 << (bit % 8)
            path.write_bytes(data)
            log = read_log(path)
            assert len(log.sweeps) >= _STOPS - 1
            assert all(scans.same(sweep, scans.sweep(sweep.stop)) for sweep in log.sweeps)


def test_without_the_definitions_sweeps_are_still_read(tmp_path, recorded):
    """An unfinished segment whose first chunk (schemas, channels, scene) is damaged keeps all its sweeps."""
    ends = _sweep_ends(recorded)
    first_chunk = next(i for i, end in enumerate(ends) if recorded[([8, *ends])[i]] == 6)
    data = bytearray(recorded[: ends[-12]])
    data[ends[first_chunk] - 20] ^= 4
    path = tmp_path / "000.mcap"
    path.write_bytes(data)
    log = read_log(path)
    assert log.scene is None
    assert len(log.sweeps) >= _STOPS - 1


def test_reading_hostile_bytes_never_takes_unbounded_memory_or_hangs():
    magic = b"\x89MCAP0\r\n"
    chunk = b"\x06" + (45).to_bytes(8, "little") + bytes(16) + (1 << 62).to_bytes(8, "little") + bytes(4)
    chunk += b"\x04\x00\x00\x00zstd" + (1).to_bytes(8, "little") + b"\x28"
    assert walk(magic + chunk).messages == []
    assert walk(magic + b"\x05" + b"\xff" * 8).messages == []
    assert walk(magic * 10000).messages == []


_LIMITED = """
import importlib.util, resource, sys
from pathlib import Path
from surfuse.errors import StorageError
from surfuse.runs.log_writer import LogWriter
spec = importlib.util.spec_from_file_location("scan_factory", sys.argv[2])
scans = importlib.util.module_from_spec(spec); spec.loader.exec_module(scans)
resource.setrlimit(resource.RLIMIT_FSIZE, (40000, 40000))
done = -1
try:
    with LogWriter(Path(sys.argv[1])) as log:
        log.append_scene(scans.scene())
        for stop in range(1000):
            log.append_sweep(scans.sweep(stop))
            done = stop
except StorageError as error:
    print(done, error.exit_status, error)
"""


def test_a_full_disk_stops_cleanly_and_keeps_every_sweep_so_far(tmp_path):
    result = subprocess.run(
        [sys.executable, "-c", _LIMITED, str(tmp_path / "log"), str(_FACTORY)],
        capture_output=True,
        text=True,
        check=True,
    )
    done, status, message = result.stdout.split(maxsplit=2)
    assert status == "6"
    assert "limit" in message
    assert "000.mcap" in message
    log = read_log(tmp_path)
    assert scans.same(log.sweeps, tuple(scans.sweep(stop) for stop in range(int(done) + 1)))
    assert int(done) > 3
    # After space has been made, the run goes on in a new segment.
    with LogWriter(tmp_path / "log") as writer:
        writer.append_scene(scans.scene())
        writer.append_sweep(scans.sweep(int(done) + 1))
    assert len(read_log(tmp_path).sweeps) == int(done) + 2
    assert read_log(tmp_path).damage == ()


def _write_until_it_fails(folder: Path, done: list[int]) -> None:
    with LogWriter(folder) as log:
        log.append_scene(scans.scene())
        for stop in range(9):
            log.append_sweep(scans.sweep(stop))
            done.append(stop)


@pytest.mark.parametrize("call", ["write", "fsync"])
def test_a_failure_at_any_write_or_sync_is_a_storage_error_and_costs_one_sweep_at_most(tmp_path, monkeypatch, call):
    real = getattr(os, call)
    for failing in range(1, 12):
        folder = tmp_path / f"{call}{failing}"
        count = 0

        def broken(*arguments, failing=failing):
            nonlocal count
            count += 1
            if count == failing:
                raise OSError(28, "No space left on device")
            return real(*arguments)

        monkeypatch.setattr(segment_module.os, call, broken)
        done = []
        with contextlib.suppress(StorageError):
            _write_until_it_fails(folder, done)
        monkeypatch.undo()
        assert count >= failing, "the fault was never injected"
        try:
            kept = read_log(folder).sweeps
        except DataError:
            kept = ()
        assert len(kept) >= len(done)
        assert scans.same(kept, tuple(scans.sweep(stop) for stop in range(len(kept))))


def test_a_writer_that_failed_takes_no_more_sweeps(tmp_path, monkeypatch):
    with LogWriter(tmp_path / "log") as log:
        log.append_scene(scans.scene())
        log.append_sweep(scans.sweep(0))
        monkeypatch.setattr(segment_module.os, "fsync", lambda descriptor: (_ for _ in ()).throw(OSError(5, "I/O")))
        with pytest.raises(StorageError):
            log.append_sweep(scans.sweep(1))
        monkeypatch.undo()
        with pytest.raises(StorageError, match="failed before"):
            log.append_sweep(scans.sweep(2))
    assert len(read_log(tmp_path).sweeps) == 1


def test_a_log_folder_that_vanishes_is_noticed_at_the_next_sweep(tmp_path):
    def scan() -> None:
        with LogWriter(tmp_path / "log") as log:
            log.append_scene(scans.scene())
            log.append_sweep(scans.sweep(0))
            shutil.rmtree(tmp_path / "log")
            log.append_sweep(scans.sweep(1))

    with pytest.raises(StorageError, match="deleted"):
        scan()
