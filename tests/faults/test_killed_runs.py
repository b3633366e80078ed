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

from surfuse.runs.progress import read_progress

SURFUSE = Path(sys.executable).with_name("surfuse")
SCAN = ("flat", "--method", "weighted_average", "--set", "scan.step_m=0.04", "--arm-driver", "kinematic", "--seed", "7")
SCAN += ("--set", "scene.azimuth_deg=-130")  # seen early in the turn of the search
KILLS, BY_CLOCK = 20, 7
BY_SIZE = KILLS - BY_CLOCK


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


def ended(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=500)
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


def killed_after(run: Path, after_s: float) -> None:
    process = started("acquire", *SCAN, "--quiet", "--out", run)
    end = time.perf_counter() + after_s
    when(process, lambda: time.perf_counter() >= end)
    process.kill()
    ended(process)


@pytest.mark.timeout(1800)
def test_twenty_runs_killed_at_random_moments_give_the_map_of_the_uninterrupted_one(
    tmp_path, command, reference, duration_s, map_bits, killed_at, sweep_places
):
    """Some by the clock, over the whole of a run; most at a size of the log, half of these again while they resume."""
    wanted, (first, *_, last) = map_bits(reference), sweep_places(reference)
    dice = random.Random(1998)
    runs = [tmp_path / f"run{number}" for number in range(KILLS)]
    times = [duration_s * (number + dice.random()) / BY_CLOCK for number in range(BY_CLOCK)]
    sizes = [round(first + (last - first) * (number + dice.random()) / BY_SIZE) for number in range(BY_SIZE)]
    again = [dice.randrange(10_000) if number % 2 else None for number in range(BY_SIZE)]

    def killed_at_sizes(run: Path, size: int, size_again: int | None) -> None:
        killed_at(size, "acquire", *SCAN, "--quiet", "--out", run)
        if size_again is not None:
            killed_at(size_again, "resume", run, "--quiet")

    with ThreadPoolExecutor(2) as pair:
        list(pair.map(killed_after, runs[:BY_CLOCK], times))
        list(pair.map(killed_at_sizes, runs[BY_CLOCK:], sizes, again))
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
    assert partial >= BY_SIZE // 2


def test_a_run_killed_while_it_searches_begins_its_search_afresh(tmp_path, command, reference, map_bits, killed_at):
    run = tmp_path / "run"
    killed_at(1, "acquire", *SCAN, "--quiet", "--out", run)
    assert (run / "run.toml").exists()
    assert size_of_log(run) == 1
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
def test_a_signal_stops_after_the_sweep_and_says_how_to_go_on(
    tmp_path, command, reference, map_bits, number, held_at, sweep_places
):
    run = tmp_path / "run"
    process = held_at(sweep_places(reference)[1] + 1000, "acquire", *SCAN, "--out", run)
    process.send_signal(number)
    process.send_signal(signal.SIGCONT)
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


def test_json_of_an_interrupted_run_says_that_it_is_not_complete(tmp_path, reference, held_at, sweep_places):
    process = held_at(sweep_places(reference)[1] + 1000, "acquire", *SCAN, "--json", "--out", tmp_path / "run")
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGCONT)
    status, out, err = ended(process)
    assert status == 130, err
    data = json.loads(out)
    assert data["complete"] is False
    assert 0 < data["stops"] < data["stops_planned"]


def test_ctrl_c_twice_stops_at_once_and_says_how_to_go_on(tmp_path, reference, held_at, sweep_places):
    run = tmp_path / "run"
    process = held_at(sweep_places(reference)[1], "acquire", "relief", "--out", run)
    process.send_signal(signal.SIGCONT)
    for _ in range(2):
        process.send_signal(signal.SIGINT)
        time.sleep(0.001)
    status, out, err = ended(process)
    assert status == 130
    assert "Traceback" not in err
    assert f"surfuse resume {run}" in out + err


@pytest.mark.usefixtures("ctrl_c_interrupts")
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


def test_two_writers_of_one_run_exclude_each_other(tmp_path, command, held_at):
    run = tmp_path / "run"
    process = held_at(1, "acquire", *SCAN, "--quiet", "--out", run)
    command("resume", run).error(6, f"pid {process.pid}", "another process")
    command("acquire", *SCAN, "--out", run).error(6, "not empty")
    process.kill()
    ended(process)
