from dataclasses import astuple, replace

import numpy as np
import pytest

from surfuse.errors import ConfigError, DeviceError
from surfuse.geometry.poses import pose
from surfuse.records import Echo, Fixture, SensorSpec, Status, Sweep, readings_from_sweeps
from surfuse.records.columns import same
from surfuse.rig import recorded_array as recorded
from surfuse.rig import sequential_array as sequential
from surfuse.sensors import polaroid, simulated
from surfuse.twin.parts import make_part
from surfuse.twin.scene import Scene
from surfuse.twin.world import Twin

LOOK = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


class SimulatedClock:
    def __init__(self) -> None:
        self.time_s = 10.0

    def now_s(self) -> float:
        return self.time_s

    def advance(self, duration_s: float) -> None:
        self.time_s += duration_s


@pytest.fixture(scope="module")
def twin() -> Twin:
    return Twin(Scene([make_part("flat").body]), seed=2)


def ranger(twin: Twin, distance: float = 0.43, spec: SensorSpec = polaroid.SPEC, **options: int):
    clock = SimulatedClock()
    return in_the_twin(spec, twin, lambda: pose(LOOK, [1.10 - distance, 0.0, 1.1]), clock, **options), clock


def in_the_twin(spec, twin, place, clock, **options):
    around = simulated.Surroundings(clock=clock, spec=spec, world=twin, pose=place)
    return simulated.create(simulated.Parameters(surroundings=around, **options))


def test_a_simulated_ranger_reads_a_facing_plate_and_takes_its_time(twin: Twin) -> None:
    sensor, clock = ranger(twin)
    with sensor as opened:
        first, second = opened.fire(), opened.fire()
    assert first.range_m == pytest.approx(0.43, abs=6e-4)
    assert (first.status, first.count) == (Status.OK, 5)
    assert 0.0 < first.spread_m < 1e-3
    assert first.amplitude == pytest.approx(0.97, abs=0.1)
    assert (first.t_s, second.t_s) == (10.0, 10.0 + polaroid.SPEC.firing_time_s)
    assert clock.now_s() == 10.0 + 2 * polaroid.SPEC.firing_time_s
    assert first.range_m == round(first.range_m * 1e5) / 1e5


def test_more_pings_make_a_quieter_reading(twin: Twin) -> None:
    def scatter(pings: int) -> float:
        sensor, _ = ranger(twin, pings=pings)
        return float(np.std([sensor.fire().range_m for _ in range(60)]))

    assert scatter(16) < 0.5 * scatter(1)


@pytest.mark.parametrize(
    ("limits", "status"), [((0.5, 4.0), Status.TOO_CLOSE), ((0.1, 0.4), Status.NO_ECHO), ((0.1, 4.0), Status.OK)]
)
def test_ranges_outside_the_limits_are_no_measurement(twin: Twin, limits, status: Status) -> None:
    spec = replace(polaroid.SPEC, range_min_m=limits[0], range_max_m=limits[1], dead_length_m=0.0)
    echo = ranger(twin, spec=spec)[0].fire()
    assert echo.status is status
    assert np.isfinite(echo.range_m) == (status is Status.OK)


def test_too_close_and_nothing_there_are_answers(twin: Twin) -> None:
    assert ranger(twin, 0.30)[0].fire().status is Status.TOO_CLOSE
    assert ranger(twin, -0.30)[0].fire().status is Status.NO_ECHO
    with pytest.raises(ConfigError, match="pings"):
        ranger(twin, pings=0)


class Timer:
    """Stands for the counter on a module's two lines."""

    def __init__(self, *times_s: float | None) -> None:
        self.times = list(times_s)

    def __call__(self) -> float | None:
        return self.times.pop(0)


def fire(*times_s: float | None, **options: float) -> Echo:
    around = polaroid.Surroundings(clock=SimulatedClock(), timer=Timer(*times_s))
    parameters = polaroid.Parameters(pings=len(times_s), surroundings=around, **options)
    with polaroid.create(parameters) as sensor:
        assert sensor.spec is polaroid.SPEC
        return sensor.fire()


def test_the_module_s_times_become_ranges() -> None:
    flight = 2 * 0.43 / 343.2
    assert fire(flight, flight, flight).range_m == 0.43
    assert fire(flight + 1e-4, delay_s=1e-4).range_m == 0.43
    assert fire(None, None, flight).status is Status.NO_ECHO
    assert fire(1.9e-3).status is Status.TOO_CLOSE
    assert fire(float("nan"), -1.0).status is Status.FAULT
    assert fire(2 * 5.0 / 343.2).status is Status.NO_ECHO


@pytest.mark.parametrize("wrong", [{"pings": 0}, {"sound_speed_m_s": 34.0}, {"blanking_s": -1.0}, {"delay_s": 1.0}])
def test_impossible_module_parameters_are_refused(wrong) -> None:
    with pytest.raises(ConfigError):
        polaroid.Parameters(**wrong)


SPECS = tuple(replace(polaroid.SPEC, name=f"us{i}") for i in range(4))
FIXTURE = Fixture(np.tile(np.eye(4), (4, 1, 1)), SPECS)


def test_the_array_fires_one_after_the_other(twin: Twin) -> None:
    clock = SimulatedClock()
    there = pose(LOOK, [0.67, 0.0, 1.1])
    sensors = [in_the_twin(spec, twin, lambda: there, clock) for spec in SPECS]
    with sequential.create(FIXTURE, sensors) as array:
        assert array.fixture is FIXTURE
        echoes = array.sweep()
    assert [echo.t_s for echo in echoes] == pytest.approx(10.0 + 0.125 * np.arange(4))
    assert len({echo.range_m for echo in echoes}) > 1
    with pytest.raises(ConfigError, match="3 sensors"):
        sequential.create(FIXTURE, sensors[:3])
    with pytest.raises(ConfigError, match="us1"):
        sequential.create(FIXTURE, [sensors[1], sensors[0], *sensors[2:]])


class Door:
    """A sensor that cannot be opened, or notes that it was closed."""

    def __init__(self, spec: SensorSpec, log: list[str], broken: bool = False) -> None:
        self.spec, self.log, self.broken = spec, log, broken

    def __enter__(self):
        if self.broken:
            raise DeviceError("no such port")
        self.log.append(f"open {self.spec.name}")
        return self

    def __exit__(self, *_) -> None:
        self.log.append(f"close {self.spec.name}")

    def fire(self) -> Echo:
        return Echo(0.4, Status.OK, 0.0)


def test_what_was_opened_is_closed_even_when_a_later_one_fails() -> None:
    log: list[str] = []
    doors = [Door(spec, log, broken=i == 2) for i, spec in enumerate(SPECS)]
    with pytest.raises(DeviceError), sequential.create(FIXTURE, doors):
        pass
    assert log == ["open us0", "open us1", "close us1", "close us0"]


def record(stops: int):
    sweeps = [
        Sweep(
            stop=n,
            row=0,
            world_from_grip=np.eye(4),
            t_s=n + 0.1 * np.arange(3),
            sensor=np.array([0, 3, 1]),
            position_m=np.zeros((3, 3)),
            axis=np.tile([1.0, 0, 0], (3, 1)),
            range_m=np.array([0.4 + n, np.inf, 0.5]),
            status=np.array([0, 1, 0]),
            amplitude=np.array([1.0, np.nan, 0.5]),
            spread_m=np.full(3, 1e-4),
            count=np.array([5, 3, 4]),
        )
        for n in range(stops)
    ]
    return readings_from_sweeps(SPECS, sweeps)


def test_a_recorded_array_answers_what_was_recorded() -> None:
    readings = record(3)
    with recorded.create(readings, FIXTURE, start=1) as array:
        echoes = array.sweep()
        assert [echo.status for echo in echoes] == [Status.OK, Status.OK, Status.FAULT, Status.NO_ECHO]
        assert same(astuple(echoes[0]), (1.4, Status.OK, 1.0, 1.0, 1e-4, 5, np.nan))
        assert same(astuple(echoes[1]), (0.5, Status.OK, 1.2, 0.5, 1e-4, 4, np.nan))
        assert echoes[2].count == 0
        array.sweep()
        with pytest.raises(DeviceError, match="3 sweeps"):
            array.sweep()
    with pytest.raises(ConfigError, match="start"):
        recorded.create(readings, FIXTURE, start=9)
    with pytest.raises(ConfigError, match="fixture"):
        recorded.create(readings, Fixture(np.tile(np.eye(4), (1, 1, 1)), SPECS[:1]))
