"""Acquisitions that are killed, interrupted or run out of disk, and what becomes of them."""

from __future__ import annotations

import json
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from mcap.reader import make_reader

from surfuse.runs.progress import read_progress

SURFUSE = Path(sys.executable).with_name("surfuse")
SCAN = ("flat", "--method", "weighted_average", "--set", "scan.step_m=0.03", "--arm-driver", "kinematic", "--seed", "7")
KILLS = 20


def started(*words: object, **how: object) -> subprocess.Popen[str]:
    """`surfuse WORDS...` as a process of its own."""
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([str(SURFUSE), *map(str, words)], **streams, **how)


def when(process: subprocess.Popen[str], happened: Callable[[], bool]) -> None:
    """Wait until something happened, or the process has ended."""
    while process.poll() is None and not happened():
        time.sleep(0.002)


def size_of_log(run: Path) -> int:
    return sum(path.stat().st_size for path in (run / "log").glob("*.mcap"))


def where_the_sweeps_begin(run: Path) -> int:
    """Bytes of a complete log before its first sweep; each sweep is a chunk, at the end."""
    with (run / "log" / "000.mcap").open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    return chunks[-json.loads((run / "summary.json").read_text())["stops"]].chunk_start_offset


def ended(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=60)
    return process.returncode, out, err


@pytest.fixture(scope="module")
def reference(tmp_path_factory, command) -> Path:
    """The run that nobody interrupts."""
    run = tmp_path_factory.mktemp("reference") / "run"
    assert command("acquire", *SCAN, "--out", run, "--json").status == 0
    return run


@pytest.fixture(scope="module")
def duration_s(tmp_path_factory, reference) -> float:
    """How long the same takes as a process of its own, from its start to its end."""
    began = time.perf_counter()
    status, _, err = ended(started("acquire", *SCAN, "--quiet", "--out", tmp_path_factory.mktemp("timed") / "run"))
    assert status == 0, err
    return time.perf_counter() - began


def killed(run: Path, dice: random.Random, after_s: float | None, after_bytes: int) -> None:
    """Kill an acquisition after a time, or when its log has a size; some of the latter once more while they resume."""
    process = started("acquire", *SCAN, "--quiet", "--out", run)
    end = None if after_s is None else time.perf_counter() + after_s
    when(process, lambda: size_of_log(run) >= after_bytes if end is None else time.perf_counter() >= end)
    process.kill()
    ended(process)
    if end is None and dice.random() < 0.4:
        process = started("resume", run, "--quiet")
        more = size_of_log(run) + dice.randrange(10_000)
        when(process, lambda: size_of_log(run) >= more)
        process.kill()
        ended(process)


@pytest.mark.timeout(300)
def test_twenty_runs_killed_at_random_moments_give_the_map_of_the_uninterrupted_one(
    tmp_path, command, reference, duration_s, map_bits
):
    wanted, first, whole = map_bits(reference), where_the_sweeps_begin(reference), size_of_log(reference)
    dice = random.Random(1998)
    runs = [tmp_path / f"run{number}" for number in range(KILLS)]
    # A third by the clock, over the whole of a run with its start and its end; the others by what is on disk.
    times = [duration_s * (number + dice.random()) / 7 if number < 7 else None for number in range(KILLS)]
    sizes = [round(first + (whole - first) * (number - 7 + dice.random()) / 13) for number in range(KILLS)]
    with ThreadPoolExecutor(2) as pair:
        for _ in pair.map(killed, runs, [random.Random(number) for number in range(KILLS)], times, sizes):
            pass
    partial = 0
    for run in runs:
        if not (run / "run.toml").exists():
            answer = command("acquire", *SCAN, "--out", run, "--json")
        else:
            progress = read_progress(run)
            partial += progress is not None and 0 < len(progress.done) < len(progress.plan)
            answer = command("resume", run, "--json")
        assert (answer.status, answer.err) == (0, "")
        assert answer.json["complete"] is True
        assert map_bits(run) == wanted
        shutil.rmtree(run)
    assert partial >= 8


def test_a_run_killed_while_it_searches_begins_its_search_afresh(tmp_path, command, reference, map_bits):
    run = tmp_path / "run"
    process = started("acquire", *SCAN, "--quiet", "--out", run)
    when(process, (run / "run.toml").exists)
    process.kill()
    ended(process)
    assert size_of_log(run) < size_of_log(reference) / 2
    assert command("resume", run, "--json").status == 0
    assert map_bits(run) == map_bits(reference)


def test_a_run_killed_before_its_configuration_was_written_is_begun_again(tmp_path, command, reference, map_bits):
    run = tmp_path / "run"
    (run / "log").mkdir(parents=True)
    (run / ".lock").write_text("4711\n")
    command("resume", run).error(3, "killed before it began", "acquire into it again")
    assert command("acquire", *SCAN, "--out", run, "--json").status == 0
    assert map_bits(run) == map_bits(reference)


@pytest.mark.parametrize("lost", ["surface.nc", "summary.json", "report.html", "log/metadata.yaml"])
def test_a_run_killed_while_it_finishes_is_finished(tmp_path, command, reference, map_bits, lost):
    """The files of the end appear one after the other, the report last; a killed run has some of them."""
    run = Path(shutil.copytree(reference, tmp_path / "run"))
    for name in (lost, "report.html"):
        (run / name).unlink(missing_ok=True)
    assert command("resume", run, "--json").status == 0
    assert map_bits(run) == map_bits(reference)
    assert (run / "report.html").is_file()
    assert json.loads((run / "summary.json").read_text())["complete"] is True


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["ctrl_c", "sigterm"])
def test_a_signal_stops_after_the_sweep_and_says_how_to_go_on(tmp_path, command, reference, map_bits, number):
    run = tmp_path / "run"
    process = started("acquire", *SCAN, "--out", run)
    when(process, lambda: size_of_log(run) > where_the_sweeps_begin(reference) + 1000)
    process.send_signal(number)
    status, out, err = ended(process)
    assert status == 130, err
    assert err.splitlines() == ["surfuse: stopping after this sweep (Ctrl-C again: now)"]
    assert f"surfuse resume {run}" in out
    assert "Traceback" not in err
    assert not (run / "report.html").exists()
    before = size_of_log(run)
    answer = command("resume", run, "--json")
    assert (answer.status, answer.json["complete"]) == (0, True)
    assert size_of_log(run) > before
    assert map_bits(run) == map_bits(reference)


def test_json_of_an_interrupted_run_says_that_it_is_not_complete(tmp_path, reference):
    run = tmp_path / "run"
    process = started("acquire", *SCAN, "--json", "--out", run)
    when(process, lambda: size_of_log(run) > where_the_sweeps_begin(reference) + 1000)
    process.send_signal(signal.SIGINT)
    status, out, err = ended(process)
    assert status == 130, err
    data = json.loads(out)
    assert data["complete"] is False
    assert 0 < data["stops"] < data["stops_planned"]


def test_ctrl_c_twice_stops_at_once_and_says_how_to_go_on(tmp_path, command, reference, map_bits):
    run = tmp_path / "run"
    process = started("acquire", "relief", "--out", run)
    when(process, lambda: size_of_log(run) > size_of_log(reference) / 2)
    for _ in range(2):
        process.send_signal(signal.SIGINT)
        time.sleep(0.001)
    status, out, err = ended(process)
    assert status == 130
    assert "Traceback" not in err
    assert f"surfuse resume {run}" in out + err


def test_ctrl_c_ends_a_fusion_at_once(tmp_path, command, reference, monkeypatch):
    def interrupted(*_: object) -> None:
        signal.raise_signal(signal.SIGINT)
        pytest.fail("Ctrl-C was kept for a checkpoint that never comes")

    monkeypatch.setattr("surfuse.commands.fuse.fuse_log.fused", interrupted)
    command("fuse", reference, "--out", tmp_path / "fused").error(130, "interrupted")
    assert not (tmp_path / "fused").exists()


def test_a_full_disk_stops_the_run_with_all_sweeps_kept(tmp_path, command, reference, map_bits):
    run = tmp_path / "run"
    limit = round(0.95 * size_of_log(reference))
    process = started(
        *("acquire", *SCAN, "--quiet", "--out", run),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY)),
    )
    status, out, err = ended(process)
    assert (status, out) == (6, "")
    (line,) = err.splitlines()
    assert "file size limit" in line
    assert command("resume", run, "--json").status == 0
    assert map_bits(run) == map_bits(reference)


def test_two_writers_of_one_run_exclude_each_other(tmp_path, command, reference):
    run = tmp_path / "run"
    process = started("acquire", "relief", "--quiet", "--out", run)
    when(process, lambda: size_of_log(run) > 0)
    command("resume", run).error(6, f"pid {process.pid}", "another process")
    command("acquire", *SCAN, "--out", run).error(6, "not empty")
    process.kill()
    ended(process)
