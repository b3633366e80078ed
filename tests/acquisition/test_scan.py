import numpy as np
import pytest
from numpy.testing import assert_allclose

from surfuse.acquisition.scan import ScanParameters, WalkHooks, scan
from surfuse.acquisition.stop_arm import JointStopArm
from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, LIMITS, READY_RAD, STAND_HEIGHT_M, Puma560
from surfuse.arms import simulated
from surfuse.errors import ConfigError, DeviceError, SafetyStopError
from surfuse.geometry.poses import pose
from surfuse.motion.arm_surroundings import Guard
from surfuse.plan.scan_plan import PlanParameters, scan_plan
from surfuse.records import ByteArray, CameraModel, Echo, Fixture, FloatArray, Outline, SensorSpec, Status, Sweep

ARM = Puma560(pose(np.eye(3), [0, 0, STAND_HEIGHT_M]), pose(np.eye(3), [0, 0, 0.08 - FLANGE_OFFSET_M]))
SPEC = SensorSpec("s", "sonar", 0.35, 4.0, 0.4, 0.001)
FIXTURE = Fixture(
    np.array([pose(np.eye(3), [x, y, 0.0]) for x in (-0.025, 0.025) for y in (-0.025, 0.025)]), (SPEC,) * 4
)
# A plate in the plane x = 1.05 m of the world, facing the arm.
PART = pose(np.column_stack([[0, -1, 0], [0, 0, 1], [-1, 0, 0]]), [1.05, 0.0, 1.0])
PLAN = scan_plan(
    Outline([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.2], [-0.1, 0.2]], PART), ARM, READY_RAD, None, PlanParameters(step_m=0.05)
)


class Cell:
    """Clock and world in one: a plane at x = 1.05 m, errors that depend on the stop alone."""

    def __init__(self) -> None:
        self.time_s = 0.0
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
        distance = (1.05 - world_from_sensor[0, 3]) / world_from_sensor[0, 2]
        return distance + self.rng.normal(0.0, 1e-4, pings), np.ones(pings)

    def image(self, camera: CameraModel, world_from_camera: FloatArray) -> ByteArray:
        return np.zeros((camera.height_px, camera.width_px), dtype=np.uint8)


def arm_in(cell: Cell, guard: Guard | None = None) -> simulated.SimulatedArm:
    around = simulated.Surroundings(
        kinematics=ARM, limits=LIMITS, clock=cell, guard=guard, world=cell, start_rad=READY_RAD
    )
    return simulated.create(simulated.Parameters(surroundings=around))


class Array:
    """Four rangers that ride on the arm; `failures` says how often the sweep of a stop fails."""

    fixture = FIXTURE

    def __init__(self, cell: Cell, arm: simulated.SimulatedArm, failures: dict[int, int] | None = None) -> None:
        self.cell, self.arm, self.failures = cell, arm, dict(failures or {})

    def __enter__(self) -> "Array":
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def sweep(self) -> tuple[Echo, ...]:
        stop = self.cell.begun[-1]
        if self.failures.get(stop, 0) > 0:
            self.failures[stop] -= 1
            raise DeviceError("no answer from node 3", cure="check its supply", where="can0")
        echoes = []
        for grip_from_sensor in FIXTURE.grip_from_sensor:
            world_from_sensor = self.arm.true_tool_pose() @ grip_from_sensor
            ranges, _ = self.cell.ping(world_from_sensor, SPEC, 3, self.cell.now_s())
            echoes.append(Echo(float(ranges.mean()), Status.OK, self.cell.now_s(), 1.0, float(ranges.std()), 3))
            self.cell.advance(0.05)
        return tuple(echoes)


def walk(cell: Cell, arm, on_sweep, failures: dict[int, int] | None = None) -> None:
    hooks = WalkHooks(on_sweep, lambda stop: cell.begin("scan", stop))
    scan(PLAN, JointStopArm(arm), Array(cell, arm, failures), hooks)


def run(failures: dict[int, int] | None = None, start_at: int = 0, last: int | None = None) -> tuple:
    cell = Cell()
    arm = arm_in(cell)
    sweeps: list[Sweep] = []
    outcome = scan(
        PLAN,
        JointStopArm(arm),
        Array(cell, arm, failures),
        WalkHooks(
            sweeps.append,
            lambda stop: cell.begin("scan", stop),
            lambda: last is not None and len(sweeps) + start_at >= last,
        ),
        start_at,
    )
    return outcome, sweeps, cell


def test_every_stop_of_the_plan_is_visited_in_order() -> None:
    outcome, sweeps, cell = run()
    assert outcome.finished
    assert outcome.next_stop == len(PLAN) == len(sweeps) == 25
    assert outcome.retried == 0
    assert outcome.robot_time_s == cell.time_s
    assert [sweep.stop for sweep in sweeps] == cell.begun == list(range(25))
    assert [sweep.row for sweep in sweeps] == PLAN.row.tolist()
    for sweep, target in zip(sweeps, PLAN.world_from_grip, strict=True):
        assert_allclose(sweep.world_from_grip, target, atol=2e-3)
        assert_allclose(sweep.range_m, 0.43, atol=2e-3)


def test_readings_and_poses_put_the_surface_where_it_is() -> None:
    _, sweeps, _ = run()
    hits = np.concatenate([sweep.position_m + sweep.range_m[:, None] * sweep.axis for sweep in sweeps])
    # Noise 0.1 mm / sqrt(3), encoders of half a count.
    assert_allclose(hits[:, 0], 1.05, atol=5e-4)


def test_times_go_forward_through_the_scan() -> None:
    _, sweeps, _ = run()
    assert np.all(np.diff(np.concatenate([sweep.t_s for sweep in sweeps])) > 0.0)


def test_the_sweep_is_handed_on_before_the_arm_moves() -> None:
    cell = Cell()
    arm = arm_in(cell)
    seen: list[bool] = []

    def persist(sweep: Sweep) -> None:
        seen.append(np.array_equal(sweep.joints_rad, arm.joint_state().position_rad))

    walk(cell, arm, persist)
    assert seen == [True] * 25


def test_a_stopped_scan_goes_on_with_the_same_readings() -> None:
    whole, first, second = run()[1], run(last=9), run(start_at=9)
    assert not first[0].finished
    assert first[0].next_stop == 9
    assert second[0].finished
    for one, other in zip(whole, first[1] + second[1], strict=True):
        assert one.stop == other.stop
        assert np.array_equal(one.range_m, other.range_m)
        assert np.array_equal(one.position_m, other.position_m)


def test_a_failing_sweep_is_fired_again() -> None:
    outcome, sweeps, _ = run({4: 2, 11: 1})
    assert outcome.finished
    assert outcome.retried == 3
    assert len(sweeps) == 25


def test_a_dead_array_ends_the_scan_with_everything_before_it_handed_on() -> None:
    cell = Cell()
    arm = arm_in(cell)
    sweeps: list[Sweep] = []
    with pytest.raises(DeviceError, match=r"can0: stop 6 of 25: the array failed 3 times: no answer from node 3"):
        walk(cell, arm, sweeps.append, {6: 99})
    assert [sweep.stop for sweep in sweeps] == list(range(6))


def test_a_refused_move_ends_the_scan_with_everything_before_it_handed_on() -> None:
    cell = Cell()

    def guard(start: np.ndarray, target: np.ndarray) -> None:
        if np.array_equal(target, PLAN.joints_rad[3]):
            raise SafetyStopError("a hand is in the way")

    arm = arm_in(cell, guard)
    sweeps: list[Sweep] = []
    with pytest.raises(SafetyStopError):
        walk(cell, arm, sweeps.append)
    assert len(sweeps) == 3


def test_starting_at_the_end_does_nothing_and_beyond_it_is_refused() -> None:
    outcome, sweeps, _ = run(start_at=25)
    assert outcome.finished
    assert sweeps == []
    for start_at in (-1, 26):
        with pytest.raises(ConfigError, match="start_at"):
            run(start_at=start_at)
    with pytest.raises(ConfigError, match="retries"):
        ScanParameters(retries=-1)
