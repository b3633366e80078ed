"""The steps of an acquisition in the twin: found, planned, walked, stopped, gone on."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from surfuse.commands.acquire.job import Job
from surfuse.commands.acquire.locating import finder, locate
from surfuse.commands.acquire.planning import _to_outer_edge, plan_for, scene_of
from surfuse.commands.acquire.walking import first_stops, walk
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import DataError
from surfuse.fusion import weighted_average
from surfuse.rig.simulated.assembly import simulated_rig
from surfuse.runs.log_reader import read_log
from surfuse.runs.log_writer import LogWriter
from surfuse.settings import load

SETTINGS = load(None, ["scene.name=relief", "scan.step_m=0.05", "arm.driver=kinematic"])


class Stubborn(SilentWatcher):
    """Stops after so many sweeps, and remembers what it was told."""

    def __init__(self, after: int = 10**9) -> None:
        self.after, self.sweeps, self.stages, self.notes = after, 0, [], []

    def stage(self, name: str, total: int = 1) -> None:
        self.stages.append((name, total))
        self.sweeps = 0

    def advance(self, steps: int = 1) -> None:
        self.sweeps += steps

    def warn(self, text: str) -> None:
        self.notes.append(text)

    def stop_requested(self) -> bool:
        return self.sweeps >= self.after


@pytest.fixture(scope="module")
def located():
    """Part, plan and scene of the relief, found once."""
    cell, watcher = simulated_rig(SETTINGS), Stubborn()
    with cell.opened():
        part = locate(cell, SETTINGS, watcher)
        plan = plan_for(cell, SETTINGS, part.outline, watcher)
        return part, plan, scene_of(cell, SETTINGS, part.outline, plan), watcher


@pytest.fixture
def walked(located, tmp_path):
    """Walk the plan in a fresh cell, from what is done."""
    _, plan, scene, _ = located
    count = 0

    def go(done=(), watcher=None):
        nonlocal count
        count += 1
        cell, method = simulated_rig(SETTINGS), weighted_average.create(weighted_average.Parameters())
        with cell.opened(), LogWriter(tmp_path / f"log{count}") as log:
            log.append_scene(scene)
            job = Job(SETTINGS, cell, method, watcher or SilentWatcher())
            walked = walk(job, plan, scene, tuple(done), log)
        points = method.finish(walked.state, None).points if walked.complete(plan) else None
        return points, walked.in_order(), tmp_path / f"log{count}"

    return go


def same(one, other) -> bool:
    """Whether two records hold the same numbers; a stop that was visited later has another time."""
    return all(
        np.array_equal(getattr(one, field.name), getattr(other, field.name), equal_nan=True)
        for field in dataclasses.fields(one)
        if field.name != "t_s"
        and isinstance(getattr(one, field.name), np.ndarray)
        and getattr(one, field.name).dtype.kind in "fib"
    )


def test_the_part_is_found_where_it_stands(located):
    part, _, _, watcher = located
    size = np.ptp(part.outline.vertices_m, axis=0)
    assert size == pytest.approx([0.20, 0.20], abs=0.02)
    assert part.pictures <= watcher.stages[0][1] + 8
    origin = part.outline.world_from_part[:3, 3]
    assert np.degrees(np.arctan2(origin[1], origin[0])) == pytest.approx(SETTINGS.scene.azimuth_deg, abs=2.0)
    assert origin[2] == pytest.approx(SETTINGS.cell.table_height_m, abs=1e-6)


def test_the_plan_covers_the_outline_and_its_margin(located):
    part, plan, _, watcher = located
    low, high = part.outline.vertices_m.min(axis=0), part.outline.vertices_m.max(axis=0)
    assert np.all(plan.uv_m.min(axis=0) <= low + plan.step_m)
    assert np.all(plan.uv_m.max(axis=0) >= high - plan.step_m)
    assert (plan.step_m, plan.standoff_m) == (0.05, 0.43)
    assert [stage for stage, _ in watcher.stages] == ["search", "plan"]


def test_stops_that_are_left_out_are_counted_for_the_user():
    settings = load(None, ["scene.name=flat", "scan.step_m=0.05", "arm.driver=kinematic", "arm.clearance_m=0.2"])
    cell, watcher = simulated_rig(settings), Stubborn()
    with cell.opened():
        part = locate(cell, settings, watcher)
        try:
            plan = plan_for(cell, settings, part.outline, watcher)
        except DataError as error:
            told = str(error)
        else:
            told = " ".join(watcher.notes)
            assert plan.skipped
    assert "clearance" in told


def test_fusion_gets_the_outline_as_seen_not_enlarged(located):
    part, plan, scene, _ = located
    assert scene.outline.margin_m == 0.0
    assert np.array_equal(scene.outline.vertices_m, part.outline.vertices_m)
    assert plan.outline.margin_m == pytest.approx(0.02)
    assert not hasattr(scene, "truth")


def test_the_deepest_range_ends_at_the_outer_edge_of_the_table(located):
    _, plan, scene, _ = located
    grip = plan.world_from_grip
    ends = grip[:, :3, 3] + scene.depth_max_m * grip[:, :3, 2]
    assert np.hypot(ends[:, 0], ends[:, 1]).max() == pytest.approx(1.25, abs=1e-9) or np.all(
        np.hypot(ends[:, 0], ends[:, 1]) >= 1.25 - 1e-9
    )
    facing = dataclasses.replace(first_stops(plan, 1), world_from_grip=outwards(0.7)[None])
    assert _to_outer_edge(facing, 1.25) == pytest.approx(0.55)


def outwards(radius_m: float) -> np.ndarray:
    """A grip on the x axis that looks away from the arm."""
    pose = np.eye(4)
    pose[:3, :3] = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    pose[0, 3] = radius_m
    return pose


def test_a_walk_visits_every_stop_in_order_and_logs_each_sweep(located, walked):
    points, sweeps, log = walked()
    assert [sweep.stop for sweep in sweeps] == list(range(len(located[1])))
    assert len(points) == len(sweeps)
    assert [sweep.stop for sweep in read_log(log).sweeps] == [sweep.stop for sweep in sweeps]


@pytest.mark.parametrize("lost", [[], [0], [3, 4], [0, 5, 9], [24], list(range(25))], ids=str)
def test_whatever_is_done_already_the_points_are_the_same(located, walked, lost):
    whole, sweeps, _ = walked()
    kept = [sweep for sweep in sweeps if sweep.stop not in lost]
    again, resumed, log = walked(kept)
    assert same(again, whole)
    assert all(same(one, other) for one, other in zip(resumed, sweeps, strict=True))
    assert sorted(sweep.stop for sweep in read_log(log).sweeps) == sorted(
        sweep.stop for sweep in sweeps if sweep.stop in lost
    )


def test_a_request_to_stop_is_kept_at_the_next_checkpoint(walked):
    watcher = Stubborn(after=4)
    points, sweeps, log = walked(watcher=watcher)
    assert points is None
    assert len(sweeps) == len(read_log(log).sweeps) == 4
    again, _, _ = walked(sweeps)
    assert same(again, walked()[0])


def test_replace_stops_keeps_the_first(located):
    plan = located[1]
    first = first_stops(plan, 3)
    assert len(first) == 3
    assert np.array_equal(first.joints_rad, plan.joints_rad[:3])
    assert len(first_stops(plan, len(plan))) == len(plan)


def test_the_finder_takes_its_threshold_from_the_settings(located):
    frame = located[0].frame
    for name in ("otsu", "minimum_error"):
        found = finder(load(None, [f"search.threshold={name}"]))(frame)
        assert len(found) == 1
        assert found[0].centroid_px == pytest.approx(located[0].detection.centroid_px, abs=3.0)
