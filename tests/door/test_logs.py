"""Logs of the Python door: arrays are a readings CSV by another way."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import surfuse as sf
from surfuse.door.sensor import described
from surfuse.runs.side_files import SENSOR_KEYS, described_sensor

A = sf.Sensor(kind="ultrasonic", beam_full_angle_deg=13.0, range_min_m=0.2, range_max_m=1.2, sigma_m=0.0005)
B = sf.Sensor(
    kind="ultrasonic",
    beam_full_angle_deg=22.5,
    range_min_m=0.1,
    range_max_m=2.0,
    sigma_m=0.001,
    frequency_hz=63000,
    aperture_m=0.04,
    incidence_limit_deg=30.0,
    dead_length_m=0.01,
    firing_time_s=0.02,
    offset_m=0.003,
    scale=1.01,
    late_tilt_deg=(0.0, 10.0),
    late_bias_m=(0.0, 0.001),
    late_scatter_m=(0.0, 0.0005),
)
FRAME = ([0.01, 0.02, 0.0], [1.0, 0.1, 0.0], [0.0, 1.0, 0.0])
OUTLINE = [[-0.08, -0.05], [0.08, -0.05], [0.08, 0.09], [-0.08, 0.09]]
SIDES = {"sensors": {"a": A, "b b": B}, "frame": FRAME, "outline": OUTLINE}


def bits(log: sf.Log) -> dict[str, object]:
    """Everything of a log, arrays as bytes; warnings without the names of files and arguments."""
    scan = log.scan
    found = {
        f"readings.{field.name}": value.tobytes() if isinstance(value, np.ndarray) else value
        for field in dataclasses.fields(scan.readings)
        for value in [getattr(scan.readings, field.name)]
    }
    return found | {
        "frame": scan.world_from_part.tobytes(),
        "estimated": scan.frame_estimated,
        "outline": None if scan.outline is None else scan.outline.vertices_m.tobytes(),
        "warnings": [text.replace(".toml", "") for text in scan.warnings],
    }


@pytest.mark.parametrize("seed", [0, 1])
def test_arrays_and_the_same_csv_give_the_same_bits(seed, tmp_path, log_writer, array_reader):
    path = log_writer(tmp_path, seed)
    arrays = array_reader(path)
    ours, theirs = sf.log(*arrays.required, **SIDES, **arrays.optional), sf.read(path)
    assert bits(ours) == bits(theirs)
    assert any("goes back" in text for text in ours.warnings)
    assert any("repeated" in text for text in ours.warnings)
    assert "sensors holds a calibration: offset and scale are taken out of the ranges" in ours.warnings


@pytest.mark.parametrize("missing", ["sensors", "frame", "outline", "status", "sigma_m", "amplitude", "stop"])
def test_the_same_bits_where_something_is_not_given(missing, plate_csv, arrays):
    given_ = {**SIDES, **arrays.optional}
    del given_[missing]
    if missing == "frame":
        del given_["outline"]
    column = {"status", "sigma_m", "amplitude", "stop"} & {missing}
    for name in {"sensors": ["sensors.toml"], "frame": ["frame.toml", "outline.csv"], "outline": ["outline.csv"]}.get(
        missing, []
    ):
        plate_csv.with_name(name).unlink()
    if column:
        rows = [line.split(",") for line in plate_csv.read_text("utf-8").splitlines()]
        at = rows[0].index(missing)
        plate_csv.write_text("\n".join(",".join(row[:at] + row[at + 1 :]) for row in rows), "utf-8")
    assert bits(sf.log(*arrays.required, **given_)) == bits(sf.read(plate_csv))


@given(
    st.lists(
        st.tuples(st.sampled_from(["x", "7", "ü"]), st.floats(-2, 2), st.floats(0, 3) | st.just(np.inf)),
        min_size=1,
        max_size=12,
    )
)
@settings(max_examples=40, deadline=None)
def test_any_numbers_give_the_same_bits(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("any") / "r.csv"
    lines = [f"{0.1 * i!r},{name},{x!r},0,0.5,0,0,-1,{r!r}" for i, (name, x, r) in enumerate(rows)]
    path.write_text("\n".join(["t,sensor,px,py,pz,ax,ay,az,range_m", *lines]), "utf-8")
    n = len(rows)
    position = np.column_stack([[x for _, x, _ in rows], np.zeros(n), np.full(n, 0.5)])
    ours = sf.log(
        [0.1 * i for i in range(n)], [name for name, _, _ in rows], position, [[0, 0, -1]] * n, [r for _, _, r in rows]
    )
    assert bits(ours) == bits(sf.read(path))


def test_what_a_log_shows_makes_it_again(arrays):
    first = sf.log(*arrays.required, **SIDES, **arrays.optional)
    r = first.readings
    names = [list(first.sensors)[i] for i in r.sensor]
    again = sf.log(
        r.t_s,
        names,
        r.position_m,
        r.axis,
        r.range_m,
        first.sensors,
        status=r.status,
        sigma_m=r.sigma_m,
        amplitude=r.amplitude,
        stop=np.repeat(r.stop, np.diff(r.start)),
        frame=first.frame,
        outline=first.outline,
    )
    assert again.warnings == ()
    assert again.readings.range_m.tobytes() == r.range_m.tobytes()
    assert again.readings.specs == r.specs
    assert np.allclose(again.readings.world_from_grip, r.world_from_grip, rtol=0.0, atol=1e-15)
    assert again.sensors == first.sensors
    assert repr(first) == f"<Log: {len(first)} readings of 2 sensors in 77 sweeps>"


def columns_of(arrays, how: str):
    """The same columns as another kind of array."""
    plain = (*arrays.required, arrays.stop)
    kinds = {
        "lists": lambda x: x if isinstance(x, list) else x.tolist(),
        "tuples": lambda x: tuple(x) if isinstance(x, list) or x.ndim == 1 else tuple(map(tuple, x.tolist())),
        "pandas": lambda x: pd.Series(x) if isinstance(x, list) or x.ndim == 1 else pd.DataFrame(x),
        "objects": lambda x: np.array(x, dtype=object),
        "strided": lambda x: x if isinstance(x, list) else np.repeat(x, 2, axis=0)[::2],
        "fortran": lambda x: x if isinstance(x, list) else np.asfortranarray(x),
        "big endian": lambda x: x if isinstance(x, list) else x.astype(x.dtype.newbyteorder(">")),
        "read only": frozen,
    }
    return [kinds[how](values) for values in plain]


def frozen(values):
    array = np.array(values)
    array.setflags(write=False)
    return array


@pytest.mark.parametrize(
    "how", ["lists", "tuples", "pandas", "objects", "strided", "fortran", "big endian", "read only"]
)
def test_every_kind_of_array_is_taken(how, arrays):
    *required, stop = columns_of(arrays, how)
    found = sf.log(*required, SIDES["sensors"], stop=stop)
    assert bits(found) == bits(sf.log(*arrays.required, SIDES["sensors"], stop=arrays.stop))


def test_whole_numbers_and_categories_name_sensors(arrays):
    numbers = [["a", "b b"].index(name) for name in arrays.sensor]
    rest = arrays.required[2:]
    sensors = {"0": A, "1": B}
    plain = sf.log(arrays.t_s, numbers, *rest, sensors)
    for column in (np.array(numbers, dtype=np.uint8), pd.Series(numbers), pd.Series(numbers).astype("category")):
        assert bits(sf.log(arrays.t_s, column, *rest, sensors)) == bits(plain)
    text = pd.Series(arrays.sensor)
    for column in (text.astype("category"), text.astype("string"), np.array(arrays.sensor)):
        assert list(sf.log(arrays.t_s, column, *rest).sensors) == ["a", "b b"]


def test_single_precision_and_whole_numbers_are_numbers():
    position = np.array([[0, 0, 1]], dtype=np.int32)
    found = sf.log(np.array([1], dtype=np.uint8), ["s"], position, [[0, 0, -1]], np.array([0.5], dtype=np.float32))
    assert found.readings.range_m.tolist() == [0.5]


@pytest.mark.parametrize("kind", [float, object, np.float32])
def test_masked_ranges_are_faulty_readings(kind, arrays):
    ranges = np.ma.masked_array(arrays.range_m.astype(kind), mask=np.arange(len(arrays.range_m)) == 0)
    found = sf.log(*arrays.required[:4], ranges)
    assert found.readings.status[0] == 3
    assert np.isnan(found.readings.range_m[0])


def test_the_arrays_of_the_caller_stay_theirs(arrays):
    before = arrays.range_m.copy()
    found = sf.log(*arrays.required, **SIDES)
    kept = found.readings.position_m.copy()
    arrays.position_m[:] = 7.0
    assert np.array_equal(found.readings.position_m, kept)
    assert np.array_equal(arrays.range_m, before, equal_nan=True)
    assert arrays.range_m.flags.writeable
    with pytest.raises(ValueError, match="read-only"):
        found.readings.range_m[0] = 1.0


def refused(arrays, *words: str, **changed: object) -> None:
    """The call with some arguments changed is refused with a SurfuseError that holds the words, and a cure."""
    names = ("t_s", "sensor", "position_m", "axis", "range_m")
    arguments = dict(zip(names, arrays.required, strict=True)) | SIDES | arrays.optional | changed
    with pytest.raises(sf.SurfuseError) as caught:
        sf.log(**arguments)
    text = str(caught.value)
    for word in words:
        assert word in text
    assert caught.value.cure
    assert "\n" not in text
    assert len(text) < 500


N = 155


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"t_s": np.zeros((N, 1))}, ["sf.log: t_s", "(155, 1)", "give numbers in a list or array of one dimension"]),
        ({"t_s": 3.0}, ["t_s", "()"]),
        ({"t_s": []}, ["no readings"]),
        ({"t_s": ["1.0"] * N}, ["t_s", "give numbers"]),
        ({"t_s": pd.date_range("2026-01-01", periods=N)}, ["t_s", "datetime64"]),
        ({"t_s": np.ones(N, dtype=bool)}, ["t_s", "bool"]),
        ({"t_s": np.ones(N, dtype=complex)}, ["t_s", "complex"]),
        ({"t_s": None}, ["t_s"]),
        ({"t_s": np.ma.masked_array(np.ones(N, dtype=bool))}, ["t_s", "bool"]),
        ({"t_s": {"a": 1}}, ["t_s"]),
        ({"t_s": np.full(N, np.nan)}, ["sf.log: t_s[0]", "t = nan"]),
        ({"position_m": np.zeros((3, N))}, ["position_m", "(3, 155)", "(155, 3)"]),
        ({"position_m": [[0.0, 0.0]] * (N - 1) + [[0.0]]}, ["position_m"]),
        ({"position_m": np.full((N, 3), 430.0)}, ["position_m[0, 0]", "px = 430", "millimetres"]),
        ({"axis": np.zeros((N, 3))}, ["axis[0, 0]", "length 0"]),
        ({"axis": [0.0, 0.0, -1.0]}, ["axis", "(3,)"]),
        ({"range_m": np.zeros(N - 1)}, ["range_m", "(154,)", "(155)"]),
        ({"range_m": np.full(N, -0.1)}, ["range_m[0]", "-0.1"]),
        ({"range_m": np.full(N, 430.0)}, ["range_m[0]", "millimetres"]),
        ({"range_m": ["far"] * N}, ["range_m"]),
        ({"range_m": [None] * N}, ["range_m holds None", "nan where there is none"]),
        ({"stop": [-3, *range(N - 1)]}, ["stop[0]", "stop = -3", "0, 1, 2"]),
        ({"sensor": "a"}, ["sensor", "one text"]),
        ({"sensor": ["a"]}, ["sensor", "(1,)"]),
        ({"sensor": [["a"]] * N}, ["sensor"]),
        ({"sensor": [1.5] * N}, ["sensor[0]", "1.5"]),
        ({"sensor": [None] * N}, ["sensor[0]", "None"]),
        ({"sensor": [True] * N}, ["sensor[0]", "True"]),
        ({"sensor": [" "] * N}, ["sensor[0]", "no name"]),
        ({"sensor": ["c"] * N}, ["sensor[0]", "'c' is not in sensors"]),
        ({"sensors": {}}, ["sensors"]),
        ({"sensors": {"a": {"kind": "ultrasonic"}}}, ["sensors", "sf.Sensor"]),
        ({"sensors": "sensors.toml"}, ["sensors"]),
        ({"status": ["fine"] * N}, ["status[0]", "'fine'"]),
        ({"status": [9] * N}, ["status[0]", "'9'"]),
        ({"status": ["ok"]}, ["status", "(1,)"]),
        ({"sigma_m": np.zeros(N)}, ["sigma_m[0]", "sigma_m = 0"]),
        ({"sigma_m": np.ones(3)}, ["sigma_m", "(3,)"]),
        ({"amplitude": np.full(N, -1.0)}, ["amplitude[0]", "-1"]),
        ({"stop": np.full(N, 0.5)}, ["stop[0]", "0.5"]),
        ({"stop": np.zeros(2)}, ["stop", "(2,)"]),
        ({"frame": None}, ["an outline without a part frame", "frame=(origin, u, v)"]),
        ({"frame": np.eye(4)}, ["frame", "(origin, u, v)"]),
        ({"frame": (FRAME[0], FRAME[1])}, ["frame", "(origin, u, v)"]),
        ({"frame": ([430.0, 0, 0], *FRAME[1:])}, ["frame", "millimetres"]),
        ({"frame": (FRAME[0], [0, 0, 0], FRAME[2])}, ["frame"]),
        ({"frame": (FRAME[0], FRAME[1], FRAME[1])}, ["frame"]),
        ({"frame": ([np.nan, 0, 0], *FRAME[1:])}, ["frame: origin", "not finite"]),
        ({"frame": ([0, 0], *FRAME[1:])}, ["frame: origin", "(2,)"]),
        ({"outline": [[0, 0], [1, 0]]}, ["outline", "2 vertices"]),
        ({"outline": [[0, 0], [1, 0], [2, 0]]}, ["outline", "no area"]),
        ({"outline": [[0, 0], [100, 0], [100, 100]]}, ["outline", "millimetres"]),
        ({"outline": np.zeros((4, 3))}, ["outline", "(4, 3)"]),
        ({"outline": [[0, 0], [1, np.inf], [2, 0]]}, ["outline", "not finite"]),
    ],
)
def test_bad_arrays_are_refused_by_name(arrays, changed, words):
    assert len(arrays.t_s) == N
    refused(arrays, *words, **changed)


def test_two_readings_of_one_sensor_at_one_time_are_refused_by_row(arrays):
    times = arrays.t_s.copy()
    times[2] = times[0]
    refused(arrays, "rows 0 and 2", t_s=times)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"kind": ""}, "kind"),
        ({"kind": 3}, "kind"),
        ({"beam_full_angle_deg": 0.0}, "beam_full_angle_deg"),
        ({"beam_full_angle_deg": "13"}, "beam_full_angle_deg"),
        ({"range_min_m": 2.0}, "range_min_m"),
        ({"sigma_m": 0.0}, "sigma_m"),
        ({"frequency_hz": -1}, "frequency_hz"),
        ({"aperture_m": 40.0}, "aperture_m"),
        ({"scale": 1000.0}, "scale"),
        ({"offset_m": True}, "offset_m"),
        ({"late_tilt_deg": (0.0,)}, "late_bias_m"),
    ],
)
def test_a_sensor_is_checked_when_it_is_made(changed, words):
    values = {
        "kind": "ultrasonic",
        "beam_full_angle_deg": 13.0,
        "range_min_m": 0.2,
        "range_max_m": 1.2,
        "sigma_m": 1e-3,
    }
    with pytest.raises(sf.SurfuseError, match=words):
        sf.Sensor(**(values | changed))


def test_a_sensor_has_the_keys_and_the_defaults_of_sensors_toml():
    assert {field.name for field in dataclasses.fields(sf.Sensor)} == set(SENSOR_KEYS)
    least = {"kind": "ultrasonic", "beam_full_angle_deg": 13.0, "range_min_m": 0.2, "range_max_m": 1.2, "sigma_m": 5e-4}
    assert described(A, "a", "") == described_sensor("a", least, "")


def test_numbers_of_numpy_describe_a_sensor():
    values = {"beam_full_angle_deg": np.float32(13.0), "range_min_m": np.float64(0.2), "range_max_m": np.int64(1)}
    found = sf.Sensor(kind="ultrasonic", sigma_m=np.float64(1e-3), late_tilt_deg=np.array([0.0]), **values,
                      late_bias_m=[0.0], late_scatter_m=(0.0,))  # fmt: skip
    assert described(found, "a", "").spec.range_max_m == 1.0


@pytest.mark.parametrize("wrong", ["nowhere.csv", "nowhere.mcap", 3, None, b"x\0y"])
def test_a_log_that_is_not_there_is_refused(wrong, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(sf.SurfuseError):
        sf.read(wrong)


def test_side_files_by_name(plate_csv, tmp_path):
    elsewhere = {}
    (tmp_path / "other").mkdir()
    for name, file in (("sensors", "sensors.toml"), ("frame", "frame.toml"), ("outline", "outline.csv")):
        elsewhere[name] = str(plate_csv.with_name(file).rename(tmp_path / "other" / file))
    assert sf.read(str(plate_csv), **elsewhere).outline is not None
    with pytest.raises(sf.SurfuseError, match=r"nothing\.toml"):
        sf.read(plate_csv, sensors=Path("nothing.toml"))
