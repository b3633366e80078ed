"""One table of columns: slices, stacks, messages and files follow from it, also for columns that are added."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import surfuse
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import (
    Echo,
    FusedPoints,
    FusionScene,
    ReadingColumns,
    Readings,
    SensorSpec,
    Status,
    Sweep,
    columns_of_echoes,
    readings_from_sweeps,
    stacked_points,
)
from surfuse.records.columns import columns_of
from surfuse.records.readings import ECHO_COLUMNS
from surfuse.runs.definitions import SWEEP
from surfuse.runs.log_writer import LogWriter
from surfuse.runs.sweep_fields import VERSION_1, logged, sweep_message, sweep_of

SPECS = tuple(SensorSpec(f"us{k}", "ultrasonic", 0.2, 1.2, 0.23, 3e-4) for k in range(4))
ANY = st.floats(width=64)
POSITIVE = st.one_of(st.floats(0.0, 1e9), st.just(float("nan")))


@st.composite
def sweeps(draw: st.DrawFn, joints: int = 6) -> Sweep:
    n, angle = draw(st.integers(0, 5)), draw(st.floats(-3.0, 3.0))
    # A place in metres: one at the edge of what a double can hold is no place.
    place = draw(arrays(np.float64, 3, elements=st.floats(-1e300, 1e300)))

    def column(values: st.SearchStrategy[float], *tail: int) -> np.ndarray:
        return draw(arrays(np.float64, (n, *tail), elements=values))

    turned = np.array([[np.sin(a), np.cos(a), 0.0] for a in column(st.floats(-3.0, 3.0))]).reshape(-1, 3)
    return Sweep(
        stop=draw(st.integers(-(2**62), 2**62)), row=draw(st.integers(0, 2**40)),
        world_from_grip=pose(rotation_about([1, 2, 3], angle), place),
        t_s=column(ANY), sensor=draw(arrays(np.int64, n, elements=st.integers(0, 3))), position_m=column(ANY, 3),
        axis=turned, range_m=column(ANY), status=draw(arrays(np.int64, n, elements=st.integers(0, 3))),
        amplitude=column(POSITIVE), spread_m=column(POSITIVE), sigma_m=column(POSITIVE),
        count=draw(arrays(np.int64, n, elements=st.integers(0, 99))),
        joints_rad=draw(arrays(np.float64, joints, elements=ANY)),
    )  # fmt: skip


def bits(record: object) -> list[bytes]:
    return [np.asarray(getattr(record, column.name)).tobytes() for column in columns_of(type(record))]


@settings(deadline=None, max_examples=60)
@given(sweeps())
def test_a_sweep_and_its_message_are_inverse_to_each_other_to_the_last_bit(sweep: Sweep) -> None:
    back = sweep_of(sweep_message(sweep).get)
    assert bits(back) == bits(sweep)
    assert back == sweep
    assert hash(back) == hash(sweep)


@settings(deadline=None, max_examples=60)
@given(st.lists(sweeps(), max_size=5))
def test_the_stack_of_the_slices_is_the_whole(given_sweeps: list[Sweep]) -> None:
    whole = readings_from_sweeps(SPECS, given_sweeps)
    slices = [whole.sweep(j) for j in range(whole.n_sweeps)]
    assert [bits(one) for one in slices] == [bits(one) for one in given_sweeps]
    again = readings_from_sweeps(SPECS, slices)
    assert again == whole
    assert bits(again) == bits(whole)
    assert whole.select(np.arange(whole.n_readings)) == readings_from_sweeps(
        SPECS, [one for one in given_sweeps if one.n_readings]
    )


def test_slices_are_views_and_stay_read_only() -> None:
    rng = np.random.default_rng(0)
    whole = plain(rng, 3, 4)
    sweep = whole.sweep(1)
    assert np.shares_memory(sweep.range_m, whole.range_m)
    assert np.shares_memory(sweep.world_from_grip, whole.world_from_grip)
    for column in columns_of(Sweep):
        value = getattr(sweep, column.name)
        assert isinstance(value, int) if column.name in ("stop", "row") else not value.flags.writeable


def plain(rng: np.random.Generator, stops: int, each: int) -> Readings:
    n = stops * each
    return Readings(
        specs=SPECS, t_s=np.arange(n, dtype=np.float64), sensor=np.arange(n) % 4, position_m=rng.normal(size=(n, 3)),
        axis=np.tile([0.0, 0.0, 1.0], (n, 1)), range_m=rng.uniform(0.3, 1.0, n), status=np.zeros(n),
        start=each * np.arange(stops + 1), stop=np.arange(stops), row=np.zeros(stops),
        world_from_grip=np.tile(np.eye(4), (stops, 1, 1)),
    )  # fmt: skip


def test_what_is_not_given_takes_no_memory_and_says_that_it_is_unknown() -> None:
    readings = plain(np.random.default_rng(0), 1000, 4)
    assert readings.amplitude.strides == (0,)
    assert np.all(np.isnan(readings.amplitude))
    assert np.all(np.isnan(readings.sigma_m))
    assert np.all(readings.count == 1)
    assert readings.joints_rad.shape == (1000, 0)


def test_given_columns_that_nobody_can_write_to_are_not_copied() -> None:
    readings = plain(np.random.default_rng(0), 1000, 4)
    again = Readings(
        specs=SPECS, start=readings.start, stop=readings.stop, row=readings.row,
        world_from_grip=readings.world_from_grip, **readings.by_name(),
    )  # fmt: skip
    for name in ("range_m", "position_m", "world_from_grip", "start"):
        assert np.shares_memory(getattr(again, name), getattr(readings, name)), name


def test_joints_of_some_sweeps_alone_are_filled_up() -> None:
    whole = plain(np.random.default_rng(0), 2, 4)
    one = whole.sweep(0)
    values = {column.name: getattr(one, column.name) for column in columns_of(Sweep)}
    stacked = readings_from_sweeps(SPECS, [one, Sweep(**{**values, "joints_rad": np.arange(6.0)})])
    np.testing.assert_array_equal(stacked.joints_rad, [[np.nan] * 6, np.arange(6.0)])


def test_fused_points_are_the_stack_of_their_points() -> None:
    rng = np.random.default_rng(1)
    start = np.array([0, 2, 2, 5])
    points = FusedPoints(
        stop=[3, 4, 9], row=[0, 0, 1], depth_m=rng.normal(size=3), sigma_m=rng.uniform(size=3),
        point_m=rng.normal(size=(3, 3)), gap=[0, 1, 0], reset=[True, False, True], start=start,
        sensor=np.arange(5) % 4, dc=rng.uniform(size=5), dc1=rng.uniform(size=5), dc2=rng.uniform(size=5),
        dc3=rng.uniform(size=5), gate=np.zeros(5),
    )  # fmt: skip
    single = [points.at(j) for j in range(3)]
    assert [len(one) for one in single] == [1, 1, 1]
    assert [len(one.sensor) for one in single] == [2, 0, 3]
    assert stacked_points(single) == points
    assert bits(stacked_points(single)) == bits(points)
    assert len(stacked_points([])) == 0


def test_the_answer_of_a_device_has_the_columns_of_a_reading() -> None:
    table = {column.name for column in columns_of(ReadingColumns)}
    assert set(ECHO_COLUMNS) <= table
    echoes = (Echo(0.4, Status.OK, 1.0, 0.9, 1e-4, 5, 3e-4), Echo(float("inf"), Status.NO_ECHO, 1.1))
    sweep = Sweep(
        stop=0, row=0, world_from_grip=np.eye(4), sensor=[0, 1], position_m=np.zeros((2, 3)),
        axis=[[0, 0, 1.0]] * 2, **columns_of_echoes(echoes),
    )  # fmt: skip
    assert sweep.echo(0) == echoes[0]
    assert (sweep.echo(1).range_m, sweep.echo(1).status, sweep.echo(1).count) == (np.inf, Status.NO_ECHO, 1)


def test_every_column_says_what_it_is() -> None:
    for record in (Sweep, Readings, FusedPoints):
        for column in columns_of(record):
            assert column.meaning, column.name
            assert column.tail.count(None) <= 1, column.name


def test_the_message_of_format_version_1_stays_as_it_was() -> None:
    first = "\n".join(SWEEP.text.splitlines()[: len(VERSION_1)])
    assert first == (
        "int64 stop\nint64 row\nfloat64[16] world_from_grip\nfloat64[] t_s\nint64[] sensor\nfloat64[] position_m\n"
        "float64[] axis\nfloat64[] range_m\nint64[] status\nfloat64[] amplitude\nfloat64[] spread_m\nint64[] count\n"
        "float64[] joints_rad\nfloat64[] sigma_m"
    )
    assert tuple(column.name for column in logged())[: len(VERSION_1)] == VERSION_1


def test_a_message_from_before_a_column_gives_its_missing_entries() -> None:
    whole = plain(np.random.default_rng(0), 1, 4)
    message = sweep_message(whole.sweep(0))
    del message["sigma_m"], message["spread_m"]
    back = sweep_of(message.get)
    assert back == whole.sweep(0)
    del message["range_m"]
    with pytest.raises(ValueError, match="range_m"):
        sweep_of(message.get)


DEFINITIONS = {
    "    sigma_m: FloatArray = per_reading(": (
        '    amplitude2: FloatArray = per_reading("1", "strength of the second echo", missing=np.nan)\n'
        '    waveform: FloatArray = per_reading("1", "the whole echo, B samples", tail=(None,), missing=0.0)\n'
    ),
    "_row = partial(": '_sway_m = partial(per_stop, "m", "how far the grip swayed", tail=(3,), missing=np.nan)\n',
    "    joints_rad: FloatArray = _joints_rad()": "    sway_m: FloatArray = _sway_m()\n",
}
"""Lines that define three columns, before the lines that they are put in front of."""

FOLLOWED = """
import dataclasses, sys
from pathlib import Path
import numpy as np
from surfuse.records import *
from surfuse.runs.log_reader import read_log
from surfuse.runs.log_writer import LogWriter

spec = SensorSpec("us", "ultrasonic", 0.2, 1.2, 0.23, 3e-4)
def sweep(stop, **more):
    return Sweep(stop=stop, row=0, world_from_grip=np.eye(4), t_s=[1.0, 2.0], sensor=[0, 0],
                 position_m=np.zeros((2, 3)), axis=[[0, 0, 1.0]] * 2, range_m=[0.4, 0.5], status=[0, 0], **more)

full = sweep(0, amplitude2=[0.1, 0.2], waveform=np.arange(14.0).reshape(2, 7), sway_m=[1.0, 2.0, 3.0])
bare = sweep(1)
assert bare.waveform.shape == (2, 0) and np.isnan(bare.amplitude2).all() and np.isnan(bare.sway_m).all()
readings = readings_from_sweeps((spec,), [full, bare])
assert readings.waveform.shape == (4, 7) and readings.sway_m.shape == (2, 3)
assert np.array_equal(readings.amplitude2, [0.1, 0.2, np.nan, np.nan], equal_nan=True)
assert readings.sweep(0) == full
assert readings.select(np.array([1])).waveform.tolist() == [list(range(7, 14))]
with LogWriter(Path(sys.argv[1])) as log:
    log.append_scene(FusionScene((spec,), np.eye(4)))
    log.append_sweep(full)
    log.append_sweep(bare)
assert read_log(Path(sys.argv[1])).sweeps == (full, bare)
assert [len(one.sweeps) for one in [read_log(Path(old)) for old in sys.argv[2:]]] == [3]
print("followed")
"""


def test_a_column_is_its_definition_and_nothing_else(tmp_path: Path) -> None:
    """Three lines are put into the table of a copy of the package; slices, stacks and the log follow."""
    source = Path(surfuse.__file__).parent
    shutil.copytree(source, tmp_path / "surfuse", ignore=shutil.ignore_patterns("__pycache__"))
    table = tmp_path / "surfuse" / "records" / "readings.py"
    text = table.read_text()
    for before, lines in DEFINITIONS.items():
        assert before in text
        text = text.replace(before, lines + before)
    table.write_text(text)
    old = tmp_path / "old"
    with LogWriter(old) as log:
        log.append_scene(FusionScene(SPECS, np.eye(4)))
        for j in range(3):
            log.append_sweep(plain(np.random.default_rng(0), 3, 4).sweep(j))
    done = subprocess.run(
        [sys.executable, "-c", FOLLOWED, str(tmp_path / "new"), str(old)],
        env={"PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1", "PATH": ""},
        capture_output=True, text=True, check=False, timeout=100,
    )  # fmt: skip
    assert done.stdout == "followed\n", done.stderr
