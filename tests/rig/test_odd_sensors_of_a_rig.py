"""Sensors behind a bridge that are dead or stuck: commands that end with a map name them; so does the doctor."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from surfuse.bridge.messages import BridgeReading, SweepAnswer
from surfuse.commands.acquire.acquisition import acquire, resume
from surfuse.commands.acquire.recording import record_run
from surfuse.commands.fuse.fuse_log import fuse
from surfuse.commands.machine.doctor import doctor
from surfuse.records import Status
from surfuse.runs.log_reader import read_log
from surfuse.runs.log_records import Level
from surfuse.settings import load

HERE = Path(__file__).parent


def module_of(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


real = module_of(HERE / "test_real_rig.py")
GOOD, STUCK_M = ("good", "fine"), 0.4123
WORDS = {
    "deaf": "'deaf' gave no echo in {n} of {n} readings (status: no echo {n})",
    "ill": "'ill' gave no echo in {n} of {n} readings (status: fault or no answer {n})",
    "gone": "'gone' gave no echo in {n} of {n} readings (status: fault or no answer {n})",
    "stuck": "'stuck' answered 412.3 mm in {n} of {n} echoes",
}


class OddRig(real.pretended.PretendedRig):
    """Two sensors that work, and one of each kind that does not, by name."""

    def __init__(self, names=(*GOOD, *WORDS)):
        super().__init__(names, [(0.005 * k, 0.0, 0.0) for k in range(len(names))])

    def sweep(self, sensors):
        answer = super().sweep(sensors)
        return SweepAnswer(tuple(self._odd(one) for one in answer.readings if one.sensor != "gone"))

    def _odd(self, reading):
        says = {"deaf": (np.inf, Status.NO_ECHO), "ill": (np.nan, Status.FAULT), "stuck": (STUCK_M, Status.OK)}
        if reading.sensor not in says:
            return reading
        return BridgeReading(reading.sensor, reading.t_s, *says[reading.sensor])


class Until(real.Notes):
    """Notes what it is told, and wants a stop after so many sweeps."""

    def __init__(self, sweeps):
        super().__init__()
        self.left = sweeps

    def advance(self, steps=1):
        self.left -= steps

    def stop_requested(self):
        return self.left <= 0


def tables(names):
    return "\n".join(
        f'[[sensor]]\nname = "{name}"\nposition_m = [{0.005 * k}, 0.0, 0.0]\n{real.LASER}'
        for k, name in enumerate(names)
    )


@pytest.fixture
def odd(tmp_path):
    rig = OddRig()
    with real.pretended.Served(rig) as served:
        yield rig, real.cell(tmp_path, served.address, tables(rig.sensors))


def assert_all_named(count, notes, run, summary):
    for words in WORDS.values():
        wanted = words.format(n=count)
        told = [note for note in notes if wanted in note]
        assert len(told) == 1, notes
        assert told[0] in json.loads((run / "summary.json").read_text("utf-8"))["warnings"]
        assert told[0] in summary["warnings"]
        assert wanted.split(" ", 1)[1] in (run / "report.html").read_text("utf-8")
    assert not any(f"sensor '{name}'" in note for note in notes for name in GOOD)


def warned(run):
    return [event.text for event in read_log(run).events if event.level is Level.WARN]


def test_acquire_and_fuse_name_them(odd, tmp_path):
    watcher, run = real.Notes(), tmp_path / "run"
    outcome = acquire(load(odd[1]), run, watcher, yes=True)
    assert outcome.complete
    assert_all_named(35, watcher.notes, run, outcome.summary)
    assert set(warned(run)) >= {note for note in watcher.notes if "sensor '" in note}
    again = real.Notes()
    assert_all_named(35, again.notes, tmp_path / "fused", fuse(run, tmp_path / "fused", again).summary)


def test_a_resumed_scan_names_them_for_the_whole_scan(odd, tmp_path):
    first, run = Until(20), tmp_path / "run"
    assert not acquire(load(odd[1]), run, first, yes=True).complete
    assert not any("sensor '" in note for note in first.notes)
    watcher = real.Notes()
    assert_all_named(35, watcher.notes, run, resume(run, watcher, yes=True).summary)
    assert len([text for text in warned(run) if "'deaf'" in text]) == 1


def test_a_rig_whose_sensors_work_is_not_blamed(tmp_path):
    rig = OddRig(GOOD)
    with real.pretended.Served(rig) as served:
        path, watcher = real.cell(tmp_path, served.address, tables(GOOD)), real.Notes()
        outcome = acquire(load(path), tmp_path / "run", watcher, yes=True)
        result = dict(doctor(path, []).table)["result"]
    assert outcome.summary["warnings"] == []
    assert not any("sensor" in note for note in watcher.notes)
    assert "heard nothing" not in result


def test_the_doctor_counts_those_that_hear_nothing(tmp_path):
    rig = OddRig((*GOOD, "deaf"))
    with real.pretended.Served(rig) as served:
        found = doctor(real.cell(tmp_path, served.address, tables(rig.sensors)), [])
    assert found.summary["problems"] == []
    result = dict(found.table)["result"]
    assert result.startswith("all is well")
    assert "1 sensor heard nothing (deaf)" in result


def test_a_recording_names_them(tmp_path):
    recording = module_of(HERE.parent / "commands" / "test_recording.py")
    watcher, run = recording.Until(40), tmp_path / "run"
    path = recording.cell(tmp_path, "deaf")
    outcome = record_run(load(path), run, watcher)
    (told,) = (note for note in watcher.notes if "sensor 'us1' gave no echo in 40 of 40 readings" in note)
    assert told in outcome.summary["warnings"]
    assert told in warned(run)
    assert "gave no echo in 40 of 40" in (run / "report.html").read_text("utf-8")
