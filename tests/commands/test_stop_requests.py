"""After a stop was requested nothing moves, whatever the acquisition was doing; what is there can be gone on with."""

from __future__ import annotations

import dataclasses

import pytest

from surfuse.commands.acquire import acquisition, reproduction
from surfuse.commands.acquire.job import Job
from surfuse.commands.acquire.locating import locate
from surfuse.commands.acquire.planning import plan_for, scene_of
from surfuse.commands.acquire.walking import walk
from surfuse.commands.outcome import Outcome, SilentWatcher
from surfuse.errors import InterruptError
from surfuse.fusion import mean
from surfuse.rig.devices import SmoothMotion
from surfuse.rig.simulated.assembly import simulated_rig
from surfuse.runs.log_writer import LogWriter
from surfuse.settings import load

HOW = ["scene.name=flat", "scan.step_m=0.05", "arm.driver=kinematic"]


class Stopping(SilentWatcher):
    """Asks to stop from a certain event on, and for ever: `event` is counted in moves, lines or sweeps."""

    def __init__(self, event: str, after: int) -> None:
        self.event, self.after, self.counts = event, after, {"move": 0, "line": 0, "sweep": 0}
        self.scanning, self.late = False, 0

    def count(self, event: str) -> None:
        """Note an event; motions that begin after the request are counted."""
        self.late += event != "sweep" and self.stop_requested()
        self.counts[event] += 1

    def stage(self, name: str, total: int = 1) -> None:
        self.scanning = name == "scan"

    def advance(self, steps: int = 1) -> None:
        if self.scanning and steps:
            self.count("sweep")

    def stop_requested(self) -> bool:
        return self.counts[self.event] >= self.after


class Watched:
    """An arm whose motions the watcher counts."""

    def __init__(self, arm, watcher: Stopping) -> None:
        self._arm, self._watcher = arm, watcher

    def __getattr__(self, name):
        return getattr(self._arm, name)

    def __enter__(self):
        self._arm.__enter__()
        return self

    def __exit__(self, *reason):
        return self._arm.__exit__(*reason)

    def move_to(self, joints_rad, speed_share=None):
        self._watcher.count("move")
        return self._arm.move_to(joints_rad, speed_share)

    def start(self, motion):
        self._watcher.count("line")
        return self._arm.start(motion)


def watched_rig(settings, watcher: Stopping):
    rig = simulated_rig(settings)
    arm = Watched(rig.motion.arm, watcher)
    motion = dataclasses.replace(rig.motion, arm=arm, smooth=SmoothMotion(arm, rig.motion.smooth.planner))
    return dataclasses.replace(rig, motion=motion, lookout=dataclasses.replace(rig.lookout, arm=arm))


@pytest.fixture(scope="module")
def found():
    """Outline and plan, found once."""
    settings = load(None, HOW)
    rig = simulated_rig(settings)
    with rig.opened():
        outline = locate(rig, settings, SilentWatcher()).outline
        plan = plan_for(rig, settings, outline, SilentWatcher())
        return outline, plan, scene_of(rig, settings, outline, plan)


def walked(found, folder, watcher: Stopping, mode: str = "stops", done=()):
    settings = load(None, [*HOW, f"scan.mode={mode}"])
    _, plan, scene = found
    rig, method = watched_rig(settings, watcher), mean.create(mean.Parameters())
    with rig.opened(), LogWriter(folder / "log") as log:
        log.append_scene(scene)
        walked = walk(Job(settings, rig, method, watcher), plan, scene, tuple(done), log)
        return walked.state, walked.in_order(), walked.complete(plan)


@pytest.mark.parametrize("mode", ["stops", "smooth"])
@pytest.mark.parametrize(("event", "after"), [("move", 0), ("move", 1), ("sweep", 1), ("sweep", 3), ("line", 1)])
def test_nothing_moves_after_the_request(found, tmp_path, mode, event, after):
    watcher = Stopping(event, after)
    if mode == "stops" and event == "line":
        return  # there are no lines
    _, sweeps, finished = walked(found, tmp_path, watcher, mode)
    assert watcher.late == 0
    assert not finished
    assert len(sweeps) == watcher.counts["sweep"] < len(found[1])


@pytest.mark.parametrize("lost", [[2], [0, 3], [6]])
def test_holes_are_not_filled_after_the_request(found, tmp_path, lost):
    whole = walked(found, tmp_path / "a", Stopping("sweep", 10**9))[1]
    watcher = Stopping("move", 1)
    walked(found, tmp_path / "b", watcher, done=[sweep for sweep in whole if sweep.stop not in lost])
    assert (watcher.late, watcher.counts["move"]) == (0, 1)


@pytest.mark.parametrize("pictures", [0, 1, 3])
def test_a_search_ends_where_it_is(pictures):
    settings = load(None, HOW)
    watcher = Stopping("move", pictures)
    rig = watched_rig(settings, watcher)
    with rig.opened(), pytest.raises(InterruptError, match=f"stopped after {pictures} pictures"):
        locate(rig, settings, watcher)
    assert watcher.late == 0
    assert watcher.counts["move"] == pictures


def test_a_run_that_was_stopped_in_the_search_can_be_gone_on_with(tmp_path):
    settings = load(None, [*HOW, 'fusion.method="mean"'])
    with pytest.raises(InterruptError, match=f"surfuse resume {tmp_path / 'run'}"):
        acquisition.acquire(settings, tmp_path / "run", Stopping("move", 0))
    assert acquisition.resume(tmp_path / "run", SilentWatcher()).complete


def test_the_next_scene_of_the_paper_is_not_begun(tmp_path, monkeypatch):
    begun: list[str] = []
    watcher = Stopping("sweep", 1)

    def acquire(settings, out, watching):
        begun.append(settings.scene.name)
        watcher.count("sweep")
        return Outcome({}, [])

    monkeypatch.setattr(reproduction, "acquire", acquire)
    monkeypatch.setattr(reproduction, "_compare", lambda *_: None)
    with pytest.raises(InterruptError, match="scenes that were scanned"):
        reproduction.reproduce(load(None, HOW), tmp_path / "run", watcher)
    assert begun == ["flat"]
