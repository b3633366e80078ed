"""The walk without stops: readings at their own poses, lines that stand alone, failures, hostile parameters."""

from collections.abc import Container
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.acquisition.smooth import (
    PassHooks,
    SmoothParameters,
    SmoothPass,
    _joints_of,
    lines_of,
    smooth_scan,
    way_of,
)
from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, LIMITS, READY_RAD, STAND_HEIGHT_M, Puma560
from surfuse.arms import simulated
from surfuse.errors import ConfigError, DeviceError, SafetyStopError
from surfuse.geometry.poses import pose
from surfuse.motion.planners import LinePlanner, through_lines
from surfuse.motion.trapezoid import durations_s
from surfuse.plan.scan_plan import PlanParameters, scan_plan
from surfuse.records import (
    ByteArray,
    CameraModel,
    Echo,
    Fixture,
    FloatArray,
    JointSamples,
    Outline,
    SensorSpec,
    Status,
    Sweep,
)

ARM = Puma560(pose(np.eye(3), [0, 0, STAND_HEIGHT_M]), pose(np.eye(3), [0, 0, 0.08 - FLANGE_OFFSET_M]))
SPEC = SensorSpec("s", "sonar", 0.35, 4.0, 0.4, 0.001, firing_time_s=0.025)
FIXTURE = Fixture(
    np.array([pose(np.eye(3), [x, y, 0.0]) for x in (-0.025, 0.025) for y in (-0.025, 0.025)]), (SPEC,) * 4
)
# A plate in the plane x = 1.05 m of the world, facing the arm.
PART = pose(np.column_stack([[0, -1, 0], [0, 0, 1], [-1, 0, 0]]), [1.05, 0.0, 1.0])
PLAN = scan_plan(
    Outline([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.1], [-0.1, 0.1]], PART), ARM, READY_RAD, None, PlanParameters(step_m=0.03)
)
WHEN = SmoothParameters(lead_s=0.0375)
SPEED = 0.95 * 0.03 / 0.1


class Cell:
    """Clock and world in one: a plane at x = 1.05 m that leans, errors that depend on the stop alone."""

    slope = np.tan(np.radians(20.0))

    def __init__(self) -> None:
        self.time_s = 3.0
        self.rng = np.random.default_rng(0)
        self.begun: list[int] = []

    def now_s(self) -> float:
        return self.time_s

    def advance(self, duration_s: float) -> None:
        self.time_s += duration_s

    def begin(self, stage: str, index: int) -> None:
        self.begun.append(index)
        self.rng = np.random.default_rng(index)

    def repeatability(self, joints: int) -> FloatArray:
        return self.rng.normal(0.0, 1e-4, joints)

    def ping(
        self, world_from_sensor: FloatArray, spec: SensorSpec, pings: int, t_s: float
    ) -> tuple[FloatArray, FloatArray]:
        surface = 1.05 + self.slope * world_from_sensor[1, 3]
        return np.full(pings, (surface - world_from_sensor[0, 3]) / world_from_sensor[0, 2]), np.ones(pings)

    def image(self, camera: CameraModel, world_from_camera: FloatArray) -> ByteArray:
        return np.zeros((camera.height_px, camera.width_px), dtype=np.uint8)


def arm_in(cell: Cell) -> simulated.SimulatedArm:
    around = simulated.Surroundings(kinematics=ARM, limits=LIMITS, clock=cell, world=cell, start_rad=PLAN.joints_rad[0])
    return simulated.create(simulated.Parameters(surroundings=around))


class Array:
    """Four rangers that ride on the arm and fire one after the other; the sweeps numbered in `failing` fail."""

    fixture = FIXTURE

    def __init__(self, cell: Cell, arm: simulated.SimulatedArm, failing: Container[int] = ()) -> None:
        self.cell, self.arm, self.failing, self.fired = cell, arm, failing, 0
        self.true_m: list[FloatArray] = []

    def __enter__(self) -> "Array":
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def sweep(self) -> tuple[Echo, ...]:
        self.fired += 1
        if self.fired - 1 in self.failing:
            raise DeviceError("no answer from node 3", cure="check its supply", where="can0")
        echoes, places = [], []
        for grip_from_sensor in FIXTURE.grip_from_sensor:
            world_from_sensor = self.arm.true_tool_pose() @ grip_from_sensor
            places.append(world_from_sensor[:3, 3])
            ranges, _ = self.cell.ping(world_from_sensor, SPEC, 1, self.cell.now_s())
            echoes.append(Echo(float(ranges[0]), Status.OK, self.cell.now_s(), 1.0, 0.0, 1))
            self.cell.advance(SPEC.firing_time_s)
        self.true_m.append(np.array(places))
        return tuple(echoes)


class Walk:
    """A walk over the plan, and all that it handed on."""

    def __init__(
        self, failing: Container[int] = (), planner: LinePlanner | None = None, when: SmoothParameters = WHEN
    ) -> None:
        self.cell, self.when = Cell(), when
        self.arm = arm_in(self.cell)
        self.array = Array(self.cell, self.arm, failing)
        self.sweeps: dict[int, Sweep] = {}
        self.samples: list[JointSamples] = []
        self.brought: list[int] = []
        self.planner = planner or through_lines(ARM, LIMITS, None, SPEED)

    def keep(self, sweep: Sweep, samples: JointSamples) -> None:
        self.sweeps[sweep.stop] = sweep
        self.samples.append(samples)

    def bring(self, stop: int) -> None:
        self.brought.append(stop)
        self.arm.move_to(PLAN.joints_rad[max(stop - 1, 0)])

    def run(self, lines: int | None = None):
        rows: set[int] = set()

        def stop_now() -> bool:
            rows.update(int(PLAN.row[stop]) for stop in self.sweeps)
            return lines is not None and len(rows) >= lines

        run = SmoothPass(self.arm, self.planner, self.when)
        hooks = PassHooks(self.keep, lambda stop: self.cell.begin("stop", stop), self.bring, stop_now)
        return smooth_scan(PLAN, run, self.array, hooks, self.sweeps)


@pytest.fixture(scope="module")
def whole() -> Walk:
    walk = Walk()
    assert walk.run().finished
    return walk


def test_every_stop_is_read_once_and_in_order(whole: Walk) -> None:
    assert list(whole.sweeps) == list(range(len(PLAN)))
    assert [sweep.row for sweep in whole.sweeps.values()] == PLAN.row.tolist()
    assert whole.brought == [0]
    times = np.concatenate([sweep.t_s for sweep in whole.sweeps.values()])
    assert np.all(np.diff(times) > 0.0)


def test_it_takes_a_fraction_of_the_time_of_stops(whole: Walk) -> None:
    moves = durations_s(PLAN.joints_rad[:-1], PLAN.joints_rad[1:], LIMITS)
    stop_and_go = float(moves.sum()) + len(PLAN) * (0.15 + 4 * 0.125)
    assert whole.cell.time_s - 3.0 < 0.3 * stop_and_go


def test_each_reading_lies_where_its_sensor_was_when_it_fired(whole: Walk) -> None:
    for sweep, true_m in zip(whole.sweeps.values(), whole.array.true_m, strict=True):
        # Half a count a joint, and a straight line between samples 4 ms apart.
        assert_allclose(sweep.position_m, true_m, atol=1.5e-4)
    sweep = whole.sweeps[5]
    assert np.ptp(np.linalg.norm(sweep.position_m - sweep.world_from_grip[:3, 3], axis=1)) > 1e-3


def test_the_pose_of_a_reading_is_that_of_the_middle_of_its_pings() -> None:
    middle_s = 0.012
    walk = Walk(when=SmoothParameters(WHEN.lead_s, middle_s))
    assert walk.run(lines=1).next_stop > 0
    further_m = []
    for sweep, samples in zip(walk.sweeps.values(), walk.samples, strict=True):
        then = samples.at(np.minimum(sweep.t_s + middle_s, samples.t_s[-1]))
        grips = ARM.forward(then) @ FIXTURE.grip_from_sensor
        assert_allclose(sweep.position_m, grips[:, :3, 3], atol=1e-9)
        at_the_start = (ARM.forward(samples.at(sweep.t_s)) @ FIXTURE.grip_from_sensor)[:, :3, 3]
        further_m.append(np.linalg.norm(sweep.position_m - at_the_start, axis=1).max())
    assert np.median(further_m) > 0.5 * SPEED * middle_s


def test_the_surface_is_where_it_is_although_the_arm_moves(whole: Walk) -> None:
    hits = np.concatenate([s.position_m + s.range_m[:, None] * s.axis for s in whole.sweeps.values()])
    assert_allclose(hits[:, 0], 1.05 + Cell.slope * hits[:, 1], atol=3e-4)


def test_a_sweep_is_half_over_when_the_arm_passes_its_stop(whole: Walk) -> None:
    for stop, sweep in whole.sweeps.items():
        off = np.linalg.norm(sweep.world_from_grip[:3, 3] - PLAN.world_from_grip[stop, :3, 3])
        first_of_scan = stop == 0
        assert off < (0.005 if first_of_scan else 0.0015)


def test_the_samples_go_on_from_sweep_to_sweep(whole: Walk) -> None:
    for before, after in pairwise(whole.samples):
        # From the last sample at or before the end of the sweep before.
        assert -4e-3 - 1e-9 <= after.t_s[0] - before.t_s[-1] <= 1e-9
        assert after.t_s[-1] > before.t_s[-1]
    assert all(np.diff(samples.t_s).max() <= 4e-3 + 1e-9 for samples in whole.samples)


def test_a_pass_that_was_stopped_goes_on_from_its_line_with_the_same_numbers(whole: Walk) -> None:
    first = Walk()
    outcome = first.run(lines=2)
    assert not outcome.finished
    assert outcome.next_stop == len(first.sweeps)
    second = Walk()
    second.sweeps.update(first.sweeps)
    del second.sweeps[outcome.next_stop - 2]
    assert second.run().finished
    assert second.brought == [outcome.next_stop - len(lines_of(PLAN)[1])]
    for stop, sweep in whole.sweeps.items():
        assert_allclose(second.sweeps[stop].position_m, sweep.position_m, atol=1e-9)
        assert_allclose(second.sweeps[stop].range_m, sweep.range_m, atol=1e-9)


def test_a_failing_sweep_is_left_out_and_the_arm_goes_on(whole: Walk) -> None:
    walk = Walk(failing={3, 11})
    outcome = walk.run()
    assert (outcome.finished, outcome.retried) == (False, 2)
    assert set(range(len(PLAN))) - set(walk.sweeps) == {3, 11}
    assert_allclose(walk.sweeps[4].position_m, whole.sweeps[4].position_m, atol=1e-9)


def test_a_dead_array_ends_the_pass_at_the_end_of_a_line() -> None:
    walk = Walk(failing=range(2, 100))
    with pytest.raises(DeviceError, match=r"can0: line 0: the array failed 4 times in a row: no answer from node 3"):
        walk.run()
    assert list(walk.sweeps) == [0, 1]
    last = lines_of(PLAN)[0][-1]
    assert_allclose(walk.arm.joint_state().position_rad, PLAN.joints_rad[last], atol=1e-3)


def test_a_refused_motion_ends_the_pass_before_the_arm_moves() -> None:
    def refusing(points: FloatArray):
        raise SafetyStopError("too near")

    walk = Walk(planner=refusing)
    with pytest.raises(SafetyStopError, match="too near"):
        walk.run()
    assert walk.sweeps == {}
    assert walk.cell.time_s < 3.2


def test_lines_and_ways_cover_the_plan() -> None:
    lines = lines_of(PLAN)
    assert np.array_equal(np.concatenate(lines), np.arange(len(PLAN)))
    assert np.array_equal(way_of(PLAN, lines[0]), PLAN.joints_rad[lines[0]])
    assert np.array_equal(way_of(PLAN, lines[1])[0], PLAN.joints_rad[lines[0][-1]])


@pytest.mark.parametrize("change", [{"lead_s": -1.0}, {"lead_s": np.nan}, {"reading_s": np.inf}, {"misses_max": -1}])
def test_hostile_parameters_are_refused(change: dict) -> None:
    with pytest.raises(ConfigError, match=next(iter(change))):
        SmoothParameters(**{"lead_s": 0.0, **change})


def test_a_reading_a_clock_s_rounding_before_the_first_sample_is_at_that_sample() -> None:
    samples = JointSamples(np.array([1.0, 1.1]), np.array([np.zeros(6), np.full(6, 0.1)]))
    echoes = [Echo(0.4, Status.OK, t_s) for t_s in (1.0 - 5e-5, 1.0, 1.05)]
    assert_allclose(_joints_of(echoes, samples, 0.0)[:, 0], [0.0, 0.0, 0.05], atol=1e-12)
