"""The readings CSV: what is right reads exactly, what is wrong is refused with file, line and column."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surfuse.errors import ConfigError, DataError, SurfuseError
from surfuse.geometry.poses import inverse, pose, rotation_about
from surfuse.records import FusionScene, Outline, SensorSpec, Status
from surfuse.runs.readings_csv import read_readings_csv, write_readings_csv
from surfuse.runs.scan_log import require_echoes
from surfuse.runs.side_files import read_sensors, sensors_toml

HEADER = "t,sensor,px,py,pz,ax,ay,az,range_m"
SENSORS = "".join(
    f'[us{i}]\nkind = "ultrasonic"\nbeam_full_angle_deg = 13.0\nrange_min_m = 0.2\nrange_max_m = 1.2\nsigma_m = 0.001\n'
    for i in range(4)
)
FRAME = "origin = [0.0, 0.0, 0.0]\nu = [1.0, 0.0, 0.0]\nv = [0, 1, 0]\n"
OUTLINE = "u,v\n-0.1,-0.1\n0.1,-0.1\n0.1,0.1\n-0.1,0.1\n"


def rows(stops: int = 6, per_line: int = 3, extra: str = "") -> list[str]:
    lines = []
    for stop in range(stops):
        for i in range(4):
            x, y = 0.01 * (stop % per_line) + 0.05 * (i % 2), 0.01 * (stop // per_line) + 0.05 * (i // 2)
            lines.append(f"{0.3 * stop + 0.05 * i:.2f},us{i},{x:.3f},{y:.3f},0.43,0,0,-1,{0.43 + 0.001 * i:.4f}{extra}")
    return lines


def folder(tmp_path: Path, content: str | bytes, **files: str) -> Path:
    path = tmp_path / "readings.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    for name, text in {"sensors": SENSORS, "frame": FRAME, **files}.items():
        suffix = "csv" if name == "outline" else "toml"
        if text:
            (tmp_path / f"{name}.{suffix}").write_text(text)
    return path


def text(lines: list[str], header: str = HEADER) -> str:
    return "\n".join([header, *lines]) + "\n"


@pytest.mark.parametrize("by_name", [False, True])
def test_a_calibration_of_version_0_1_0_is_read_as_it_was_meant(tmp_path, by_name):
    """A sensor says scale x range + offset: without a word of it in the file, and with one."""
    true_m, offset_m, scale = 0.43 + 0.001 * np.arange(4), 0.01 * np.arange(4), 1.0 + 0.02 * np.arange(4)
    lines = [line.rsplit(",", 1)[0] for line in rows()]
    told = [f"{line},{scale[i % 4] * true_m[i % 4] + offset_m[i % 4]:.17g}" for i, line in enumerate(lines)]
    tables = [
        f"{table}offset_m = {offset_m[i]}\nscale = {scale[i]}\n" + by_name * 'range_correction = "true_to_reading"\n'
        for i, table in enumerate(SENSORS.replace("[us", "|[us").split("|")[1:])
    ]
    scan = read_readings_csv(folder(tmp_path, text(told), sensors="".join(tables)))
    assert scan.readings.range_m == pytest.approx(np.tile(true_m, 6), abs=1e-12)
    notes = [warning for warning in scan.warnings if "offset and scale are taken out" in warning]
    assert len(notes) == 1
    assert ("which is how version 0.1.0 wrote them" in notes[0]) != by_name


def test_a_calibration_that_says_so_makes_true_ranges_of_readings(tmp_path):
    sensors = SENSORS.replace("[us1]", 'offset_m = 0.01\nscale = 1.5\nrange_correction = "reading_to_true"\n[us1]')
    plain = read_readings_csv(folder(tmp_path, text(rows())))
    scan = read_readings_csv(folder(tmp_path, text(rows()), sensors=sensors))
    mine = plain.readings.sensor == 0
    assert scan.readings.range_m[mine] == pytest.approx(1.5 * plain.readings.range_m[mine] + 0.01, abs=1e-12)
    assert np.array_equal(scan.readings.range_m[~mine], plain.readings.range_m[~mine])
    assert not any("0.1.0" in warning for warning in scan.warnings)
    wrong = sensors.replace("reading_to_true", "reading_to_ture")
    with pytest.raises(ConfigError, match=r"range_correction = 'reading_to_ture'; did you mean 'reading_to_true'"):
        read_readings_csv(folder(tmp_path, text(rows()), sensors=wrong))


@pytest.mark.parametrize("scale", ["0.49", "2.01", "0.0", "-1.0", "nan", "inf"])
def test_a_calibration_that_no_sensor_has_is_refused(tmp_path, scale):
    sensors = SENSORS.replace("[us1]", f"scale = {scale}\n[us1]")
    with pytest.raises((ConfigError, DataError), match="scale"):
        read_readings_csv(folder(tmp_path, text(rows()), sensors=sensors))


def test_a_plain_file_reads_as_written(tmp_path):
    scan = read_readings_csv(folder(tmp_path, text(rows()), outline=OUTLINE))
    readings = scan.readings
    assert readings.n_sweeps == 6
    assert readings.row.tolist() == [0, 0, 0, 1, 1, 1]
    assert readings.start.tolist() == [0, 4, 8, 12, 16, 20, 24]
    assert [spec.name for spec in readings.specs] == ["us0", "us1", "us2", "us3"]
    assert readings.specs[0].beam_full_angle_rad == math.radians(13.0)
    assert readings.range_m[:4].tolist() == [0.43, 0.431, 0.432, 0.433]
    assert np.allclose(readings.world_from_grip[4, :3, 3], [0.035, 0.035, 0.43], atol=1e-15)
    assert np.allclose(readings.world_from_grip[0, :3, :3], np.diag([1.0, -1.0, -1.0]))
    assert scan.outline is not None
    assert np.array_equal(scan.world_from_part, np.eye(4))
    assert scan.warnings == ()
    assert not scan.frame_estimated


@pytest.mark.parametrize(
    ("cell", "value", "status"),
    [
        ("", np.inf, Status.NO_ECHO),
        ("inf", np.inf, Status.NO_ECHO),
        ("-inf", -np.inf, Status.TOO_CLOSE),
        ("nan", np.nan, Status.FAULT),
        ("  0.5 ", 0.5, Status.OK),
        ("+5e-1", 0.5, Status.OK),
    ],
)
def test_rep_117_ranges_keep_their_meaning(tmp_path, cell, value, status):
    lines = rows()
    lines[5] = lines[5].rsplit(",", 1)[0] + "," + cell
    readings = read_readings_csv(folder(tmp_path, text(lines))).readings
    assert np.array_equal(readings.range_m[5], value, equal_nan=True)
    assert readings.status[5] == int(status)
    assert np.all(np.delete(readings.status, 5) == 0)


def _edit(line: int, column: str, cell: str) -> str:
    lines = [row.split(",") for row in rows()]
    lines[line][HEADER.split(",").index(column)] = cell
    return text([",".join(row) for row in lines])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ["empty"]),
        (b"\n  \n", ["empty"]),
        (HEADER + "\n", ["no readings"]),
        (text(rows(), HEADER.replace("range_m", "range")), [":1:", "range_m is missing", "'range' is close to"]),
        (text(rows(), HEADER.replace("px", "x")), [":1:", "px is missing"]),
        (text(rows(), "# of today\n\n" + HEADER.replace("az", "aZz")), [":3:", "az is missing", "'aZz' is close to"]),
        ("# nothing\n#\n", ["nothing but comments", "give a header"]),
        (text(rows(extra=",1"), HEADER + ",t"), ["'t' comes twice"]),
        (text(rows(extra=",1"), HEADER + ",Range M"), ["'range_m' comes twice"]),
        (_edit(2, "px", "abc"), [":4:px:", "'abc' is not a number"]),
        (_edit(2, "px", ""), [":4:px:", "empty cell"]),
        (_edit(2, "px", "1_0"), [":4:px:", "'1_0' is not a number"]),
        (_edit(2, "px", "٣"), [":4:px:", "not a number"]),
        (_edit(2, "range_m", "1e999"), [":4:range_m:", "too large"]),
        (_edit(2, "range_m", "0x10"), [":4:range_m:", "'0x10'"]),
        (_edit(2, "range_m", "-0.4"), [":4:range_m:", "-0.4", "too close"]),
        (_edit(2, "py", "nan"), [":4:py:", "nan", "pose"]),
        (_edit(2, "az", "inf"), [":4:az:"]),
        (_edit(0, "t", "nan"), [":2:t:"]),
        (_edit(2, "az", "-1.01"), [":4:ax:", "length 1.01", "unit"]),
        (_edit(2, "az", "0"), [":4:ax:", "length 0"]),
        (_edit(2, "px", "125.0"), [":4:px:", "millimetres", "divide by 1000"]),
        (_edit(2, "range_m", "430"), [":4:range_m:", "millimetres"]),
        (_edit(2, "sensor", "us9"), [":4:sensor:", "'us9'", "did you mean"]),
        (_edit(2, "sensor", " "), [":4:sensor:", "no name"]),
        (_edit(4, "t", "0.00"), ["two different readings", "lines 2 and 6"]),
        (text([*rows()[:3], rows()[3] + ",7", *rows()[4:]]), [":5:", "10 values", "9 columns"]),
        (text([*rows()[:3], "0.15,us3,0", *rows()[4:]]), [":5:", "3 values"]),
        (text([*rows()[:3], '0.15,"us3,0.05,0.05', *rows()[4:]]), ["not a CSV file"]),
        (text(rows()).encode() + b"9.9,us\xff0,0,0,0.43,0,0,-1,0.4\n", [":26:", "0xff", "UTF-8"]),
        (b"x," * 1_000_000 + b"\n1\n", [":1:", "missing"]),
        (b"t" * 100_000 + b"\n1\n", [":1:", "missing"]),
        (b"t" * 1_000_000, [":1:", "field limit"]),
        (bytes(range(1, 128)) * 20, ["readings.csv"]),
    ],
)
def test_bad_files_are_refused_where_they_are_bad(tmp_path, content, words):
    path = folder(tmp_path, content)
    with pytest.raises(DataError) as caught:
        read_readings_csv(path)
    message = str(caught.value)
    assert caught.value.exit_status == 3
    assert len(message) < 600
    assert "\n" not in message
    for word in ["readings.csv", *words]:
        assert word in message


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbf" + text(rows()).encode(),
        text(rows()).replace("\n", "\r\n").encode(),
        text(rows()).replace("\n", "\r").encode(),
        text(rows()).encode("utf-16"),
        text(rows()).replace(",", ";").encode(),
        text(rows()).replace(",", ";").replace(".", ",").encode(),
        text(rows()).replace(",", "\t").encode(),
        text(rows()).replace("us0", '"us0"').encode(),
        text(rows()).replace("\n", "\n\n").encode() + b"\n\n",
        text(rows()).replace(",", " , ").encode(),
        b"\n\r\n" + text(rows()).encode(),
    ],
    ids=[
        "bom",
        "crlf",
        "cr",
        "utf16",
        "semicolon",
        "decimal comma",
        "tab",
        "quotes",
        "blank lines",
        "blanks",
        "blank first lines",
    ],
)
def test_harmless_dialects_give_the_same_numbers(tmp_path, content):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    plain = read_readings_csv(folder(tmp_path / "a", text(rows()))).readings
    other = read_readings_csv(folder(tmp_path / "b", content)).readings
    for name in ("t_s", "sensor", "position_m", "axis", "range_m", "status", "start", "row", "world_from_grip"):
        assert np.array_equal(getattr(plain, name), getattr(other, name)), name


def test_decimal_points_and_commas_in_one_file_are_refused(tmp_path):
    lines = [row.replace(",", ";").replace(".", ",") for row in rows()]
    lines[3] = lines[3].replace("0,43", "0.43")
    with pytest.raises(DataError, match=r":5:pz.*mixes"):
        read_readings_csv(folder(tmp_path, text(lines, HEADER.replace(",", ";"))))


def test_lines_are_counted_as_an_editor_does_in_spite_of_blank_lines(tmp_path):
    lines = rows()
    lines[2] = "\n\n" + lines[2].replace("0.43", "x", 1)
    with pytest.raises(DataError, match=r"readings\.csv:6:pz"):
        read_readings_csv(folder(tmp_path, text(lines)))


def test_columns_of_others_are_not_read_and_named_once(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    plain = read_readings_csv(folder(tmp_path / "a", text(rows()))).readings
    lines = [f"x,{row},,1_0,0.9" for row in rows()]
    scan = read_readings_csv(folder(tmp_path / "b", text(lines, f"Operator,{HEADER},range2_m,,temperature_c")))
    assert scan.readings == plain
    (note,) = scan.warnings
    assert note.endswith(
        "readings.csv:1: columns not read: 'Operator', 'range2_m', one without a name, 'temperature_c'"
    )


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("amplitud", "; did you mean 'amplitude' by 'amplitud'?"),
        ("Sigma", "; did you mean 'sigma_m' by 'Sigma'?"),
        ("gain", "column not read: 'gain'"),
    ],
)
def test_a_column_that_may_be_misspelt_is_asked_for(tmp_path, name, told):
    (note,) = read_readings_csv(folder(tmp_path, text(rows(extra=",1"), f"{HEADER},{name}"))).warnings
    assert note.endswith(told)


def test_a_column_that_is_there_is_no_misspelling_of_another(tmp_path):
    scan = read_readings_csv(folder(tmp_path, text(rows(extra=",0.7,0.2"), f"{HEADER},amplitude,amplitude2")))
    assert scan.readings.amplitude.tolist() == [0.7] * 24
    (note,) = scan.warnings
    assert note.endswith("column not read: 'amplitude2'")


def test_of_many_columns_of_others_a_few_are_named(tmp_path):
    names = [f"extra{i}" for i in range(12)]
    (note,) = read_readings_csv(folder(tmp_path, text(rows(extra=",1" * 12), ",".join([HEADER, *names])))).warnings
    assert note.endswith("'extra6', 'extra7' and 4 more")


@pytest.mark.parametrize(
    "header",
    [HEADER.upper(), HEADER.replace(",", " , "), HEADER.replace("range_m", "Range m"), f"\ufeff{HEADER.title()}"],
)
def test_names_of_columns_are_read_in_any_case_and_with_spaces(tmp_path, header):
    scan = read_readings_csv(folder(tmp_path, text(rows(), header)))
    assert scan.readings.range_m[:4].tolist() == [0.43, 0.431, 0.432, 0.433]
    assert scan.warnings == ()


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_comments_are_skipped_wherever_they_stand(tmp_path, end):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    plain = read_readings_csv(folder(tmp_path / "a", text(rows()))).readings
    lines = rows()
    lines[3:3] = ['# an unfinished "quote, and commas, , ,', f"  #{lines[3]}"]
    content = text(lines, f"# rig 7, of today\n\n{HEADER}") + "# the end"
    scan = read_readings_csv(folder(tmp_path / "b", content.replace("\n", end)))
    assert scan.readings == plain
    assert scan.warnings == ()
    lines[10] = lines[10].replace("0.43", "x", 1)
    with pytest.raises(DataError, match=r"readings\.csv:14:pz"):
        read_readings_csv(folder(tmp_path / "b", text(lines, f"# rig 7, of today\n\n{HEADER}")))


def test_shuffled_rows_are_sorted_by_time_and_told(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    plain = read_readings_csv(folder(tmp_path / "a", text(rows()))).readings
    shuffled = rows()
    np.random.default_rng(1).shuffle(shuffled)
    scan = read_readings_csv(folder(tmp_path / "b", text(shuffled)))
    assert np.array_equal(scan.readings.range_m, plain.range_m)
    assert np.array_equal(scan.readings.world_from_grip, plain.world_from_grip)
    assert any("order of their times" in warning for warning in scan.warnings)


def test_repeated_rows_are_used_once_and_told(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    plain = read_readings_csv(folder(tmp_path / "a", text(rows()))).readings
    lines = rows()
    scan = read_readings_csv(folder(tmp_path / "b", text([*lines[:6], lines[5], *lines[6:], lines[0]])))
    assert np.array_equal(scan.readings.range_m, plain.range_m)
    assert any("2 readings are repeated" in warning for warning in scan.warnings)


def test_rows_of_one_stop_are_one_sweep_wherever_they_are(tmp_path):
    lines = [f"{row},{7 if i % 2 else 3}" for i, row in enumerate(rows(stops=1))]
    readings = read_readings_csv(folder(tmp_path, text(lines, HEADER + ",stop"))).readings
    assert readings.stop.tolist() == [3, 7]
    assert readings.start.tolist() == [0, 2, 4]
    assert readings.sensor.tolist() == [0, 2, 1, 3]
    with pytest.raises(DataError, match=r":2:stop"):
        read_readings_csv(folder(tmp_path, text([f"{row},1.5" for row in rows()], HEADER + ",stop")))


def test_a_missing_sensor_does_not_shift_the_sweeps(tmp_path):
    lines = rows()
    del lines[5]
    readings = read_readings_csv(folder(tmp_path, text(lines))).readings
    assert np.diff(readings.start).tolist() == [4, 3, 4, 4, 4, 4]


def test_status_words_count_and_contradictions_are_told(tmp_path):
    lines = [f"{row},{'no_echo' if i == 1 else 'ok' if i == 2 else ''}" for i, row in enumerate(rows())]
    lines[3] = lines[3].replace("0.4330", "").rsplit(",", 1)[0] + ",ok"
    scan = read_readings_csv(folder(tmp_path, text(lines, HEADER + ",status")))
    assert scan.readings.status[:4].tolist() == [0, 1, 0, 1]
    assert scan.readings.range_m[1] == np.inf
    assert any("2 readings have a status that contradicts" in warning for warning in scan.warnings)
    bad = [f"{row},okay" for row in rows()]
    with pytest.raises(DataError, match=r":2:status: unknown status 'okay'"):
        read_readings_csv(folder(tmp_path, text(bad, HEADER + ",status")))


@pytest.mark.parametrize(("column", "cell"), [("sigma_m", "0"), ("sigma_m", "inf"), ("amplitude", "-1")])
def test_nonsense_in_optional_columns_is_refused(tmp_path, column, cell):
    lines = [f"{row},{cell if i == 3 else ''}" for i, row in enumerate(rows())]
    with pytest.raises(DataError, match=rf":5:{column}"):
        read_readings_csv(folder(tmp_path, text(lines, f"{HEADER},{column}")))


def test_nearly_unit_axes_are_made_unit_length(tmp_path):
    scan = read_readings_csv(folder(tmp_path, text(rows()).replace(",-1,", ",-1.0005,")))
    assert np.array_equal(scan.readings.axis, np.tile([0.0, 0.0, -1.0], (24, 1)))


def test_all_no_echo_is_data_but_cannot_be_fused(tmp_path):
    lines = [row.rsplit(",", 1)[0] + "," for row in rows()]
    scan = read_readings_csv(folder(tmp_path, text(lines)))
    assert np.all(scan.readings.range_m == np.inf)
    with pytest.raises(DataError, match=r"none of the 24 readings is an echo \(24 without echo"):
        require_echoes(scan.readings, "readings.csv")
    require_echoes(read_readings_csv(folder(tmp_path, text(rows()))).readings, "readings.csv")
    faults = replace(scan.readings, status=np.full(24, int(Status.FAULT)), range_m=np.full(24, np.nan))
    with pytest.raises(DataError, match=r"24 faulty.*; '.*' reported 'fault' in every reading: check"):
        require_echoes(faults, "readings.csv")


def test_without_side_files_everything_assumed_is_told(tmp_path):
    scan = read_readings_csv(folder(tmp_path, text(rows()), sensors="", frame=""))
    assert scan.frame_estimated
    assert any("22 degrees" in warning and "3 mm" in warning for warning in scan.warnings)
    assert any("part frame is estimated" in warning for warning in scan.warnings)
    assert scan.readings.row.tolist() == [0, 0, 0, 1, 1, 1]


def test_the_estimated_frame_follows_beam_and_motion(tmp_path):
    turn = pose(rotation_about([1, 2, -1], 1.1), [1.0, 2.0, 3.0])
    lines = []
    for row in rows(stops=25, per_line=5):
        cells = row.split(",")
        p = turn[:3, :3] @ [float(x) for x in cells[2:5]] + turn[:3, 3]
        a = turn[:3, :3] @ [float(x) for x in cells[5:8]]
        lines.append(",".join([*cells[:2], *(repr(float(x)) for x in (*p, *a)), cells[8]]))
    scan = read_readings_csv(folder(tmp_path, text(lines), frame=""))
    part = scan.world_from_part
    assert np.allclose(part[:3, 2], turn[:3, 2], atol=1e-12)
    assert np.allclose(np.abs(part[:3, 0] @ turn[:3, 0]), 1.0, atol=1e-12)
    assert part[2, 1] > 0.0
    heights = scan.readings.position_m + scan.readings.axis * scan.readings.range_m[:, None]
    assert np.max(np.abs((heights - part[:3, 3]) @ part[:3, 2])) < 0.003
    assert scan.readings.row.tolist() == [j // 5 for j in range(25)]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("sensors", SENSORS.replace("sigma_m", "sigma"), ["[us0]", "unknown key 'sigma'", "sigma_m"]),
        ("sensors", SENSORS.replace("sigma_m = 0.001\n", "", 1), ["[us0]", "'sigma_m' is missing"]),
        ("sensors", SENSORS.replace("13.0", '"13"'), ["beam_full_angle_deg = '13' is not a number"]),
        ("sensors", SENSORS.replace("13.0", "0"), ["beam_full_angle_deg = 0"]),
        ("sensors", SENSORS.replace("13.0", "1e400"), ["finite"]),
        ("sensors", SENSORS.replace("1.2", "0.1"), ["range_min_m"]),
        ("sensors", SENSORS.replace("0.001", "true"), ["True is not a number"]),
        ("sensors", "x = 1\n", ["not a table"]),
        ("sensors", "# nothing\n", ["no sensor"]),
        ("sensors", "[us0\n", ["not valid TOML"]),
        ("sensors", "a" + ".a" * 40 + " = 1\n", ["deeper"]),
        ("sensors", "a = " + "[" * 20000, ["nested too deep"]),
        ("sensors", "# " + "x" * 70000, ["bytes"]),
        ("frame", FRAME.replace("v = [0, 1, 0]", ""), ["v = None", "[x, y, z]"]),
        ("frame", FRAME.replace("v = [0, 1, 0]", "v = [2, 0, 0]"), ["parallel"]),
        ("frame", FRAME.replace("v = [0, 1, 0]", "v = [0, 1]"), ["three numbers"]),
        ("frame", FRAME.replace("[0.0, 0.0, 0.0]", "[0.0, 950.0, 0.0]"), ["millimetres"]),
        ("frame", FRAME + "w = 1\n", ["unknown key 'w'"]),
        ("outline", "x,y\n0,0\n", ["'x,y'"]),
        ("outline", "u,v\n0,0\n1,1\n", ["2 vertices"]),
        ("outline", "u,v\n0,0\n1,1\n2,2\n", ["no area"]),
        ("outline", "u,v\n0,0\n100,0\n0,100\n", [":3:u", "millimetres"]),
        ("outline", "u,v\n0,0\nabc,0\n0,1\n", [":3:u", "'abc'"]),
        ("outline", "u,v\n0,0\nnan,0\n0,1\n", [":3:u"]),
        ("outline", "u,v\n0,0\n1\n0,1\n", [":3", "1 values"]),
    ],
)
def test_bad_side_files_are_refused(tmp_path, name, content, words):
    with pytest.raises((DataError, ConfigError)) as caught:
        read_readings_csv(folder(tmp_path, text(rows()), **{name: content}))
    message = str(caught.value)
    assert caught.value.exit_status == 3
    for word in [f"{name}.", *words]:
        assert word in message


def test_an_outline_without_a_frame_is_refused(tmp_path):
    with pytest.raises(DataError, match=r"outline\.csv.*frame\.toml"):
        read_readings_csv(folder(tmp_path, text(rows()), frame="", outline=OUTLINE))


def test_an_outline_is_made_counter_clockwise_and_not_repeated(tmp_path):
    clockwise = "u,v\n-0.1,0.1\n0.1,0.1\n0.1,-0.1\n-0.1,-0.1\n-0.1,0.1\n"
    outline = read_readings_csv(folder(tmp_path, text(rows()), outline=clockwise)).outline
    assert outline.vertices_m.tolist() == [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]]


def test_export_and_import_are_inverse_to_the_last_bit(tmp_path):
    rng = np.random.default_rng(5)
    lines = []
    for stop in range(30):
        for i in rng.permutation(4)[: rng.integers(1, 5)]:
            p = rng.normal(size=3)
            a = rng.normal(size=3)
            a /= np.linalg.norm(a)
            r = rng.choice(["", "nan", "-inf", repr(float(rng.uniform(0.2, 1.2)))])
            extra = f"{repr(rng.uniform(1e-4, 1e-2)) if stop % 2 else ''},{repr(rng.uniform()) if stop % 3 else ''}"
            cells = [repr(float(x)) for x in (*p, *np.abs(a))]
            lines.append(f"{float(stop + 0.1 * i)!r},us{i},{','.join(cells)},{r},{extra},{90 - stop}")
    header = HEADER + ",sigma_m,amplitude,stop"
    (tmp_path / "in").mkdir()
    first = read_readings_csv(folder(tmp_path / "in", text(lines, header), outline=OUTLINE))
    write_readings_csv(tmp_path / "out.csv", first.readings, first.scene())
    second = read_readings_csv(tmp_path / "out.csv")
    for name in first.readings.__dataclass_fields__:
        if name != "specs":
            a, b = getattr(first.readings, name), getattr(second.readings, name)
            assert np.array_equal(a, b, equal_nan=True), name
    assert second.readings.specs == first.readings.specs
    assert np.array_equal(second.world_from_part, first.world_from_part)
    assert np.array_equal(second.outline.vertices_m, first.outline.vertices_m)
    with pytest.raises(SurfuseError, match="exists"):
        write_readings_csv(tmp_path / "out.csv", first.readings, None)


def test_odd_sensor_names_survive_export(tmp_path):
    spec = SensorSpec('a "b", ü=[c].d', "tof", 0.5, 4.0, math.radians(25.0), 0.01, dead_length_m=1 / 3)
    (tmp_path / "in").mkdir()
    path = folder(tmp_path / "in", text(["0,x,0,0,0,0,0,1,0.5"]).replace("x,0", '"a ""b"", ü=[c].d",0'), sensors="")
    scan = read_readings_csv(path)
    assert scan.readings.specs[0].name == spec.name
    write_readings_csv(tmp_path / "out.csv", scan.readings, FusionScene(specs=(spec,), world_from_part=np.eye(4)))
    assert read_readings_csv(tmp_path / "out.csv").readings.specs[0].name == spec.name


def test_the_outline_of_a_scene_is_exported(tmp_path):
    outline = Outline(vertices_m=[[0, 0], [1, 0], [0, 1 / 3]], world_from_part=np.eye(4))
    scan = read_readings_csv(folder(tmp_path, text(rows())))
    scene = FusionScene(specs=scan.readings.specs, world_from_part=np.eye(4), outline=outline)
    (tmp_path / "out").mkdir()
    write_readings_csv(tmp_path / "out" / "readings.csv", scan.readings, scene)
    assert np.array_equal(read_readings_csv(tmp_path / "out" / "readings.csv").outline.vertices_m, outline.vertices_m)


_CELLS = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True, width=64).map(repr),
    st.sampled_from(
        ["", " ", "nan", "inf", "-inf", "1e999", "0.43", "1,5", "1_0", "us0", "us1", "\x00", '"', "'", "-"]
    ),
    st.text(max_size=6),
)


@settings(max_examples=150, deadline=None)
@given(st.lists(st.lists(_CELLS, min_size=7, max_size=11), max_size=6), st.sampled_from([",", ";", "\t"]))
def test_any_cells_give_a_scan_or_a_clear_error(tmp_path_factory, table, delimiter):
    path = tmp_path_factory.mktemp("any") / "r.csv"
    body = "\n".join(delimiter.join(cells) for cells in table)
    path.write_bytes((HEADER.replace(",", delimiter) + "\n" + body).encode("utf-8", "surrogatepass"))
    problem: SurfuseError | None = None
    try:
        scan = read_readings_csv(path)
        assert np.all(np.isfinite(scan.readings.position_m))
    except SurfuseError as error:
        problem = error
    assert problem is None or (problem.exit_status == 3 and "r.csv" in str(problem))


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=300))
def test_any_bytes_give_a_clear_error(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("any") / "r.csv"
    path.write_bytes(content)
    with pytest.raises(SurfuseError, match=r"r\.csv"):
        read_readings_csv(path)


_FINITE = st.floats(min_value=-49.0, max_value=49.0, allow_nan=False)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(_FINITE, _FINITE, _FINITE, st.floats(min_value=0.0, max_value=49.0)), min_size=1, max_size=12),
    st.sampled_from([",", ";"]),
    st.booleans(),
)
def test_numbers_are_never_wrong(tmp_path_factory, values, delimiter, comma):
    path = tmp_path_factory.mktemp("exact") / "r.csv"
    lines = [HEADER]
    for k, (px, py, pz, r) in enumerate(values):
        lines.append(f"{k},a,{px!r},{py!r},{pz!r},0,0,-1,{r!r}")
    content = "\n".join(lines).replace(",", delimiter)
    if comma and delimiter == ";":
        content = content.replace(".", ",")
    path.write_text(content)
    readings = read_readings_csv(path).readings
    assert readings.position_m.tolist() == [list(value[:3]) for value in values]
    assert readings.range_m.tolist() == [value[3] for value in values]


_SHARED = Path(__file__).parents[3] / "shared" / "data" / "scans"


@pytest.mark.skipif(not _SHARED.is_dir(), reason="the scans of the independent simulator are not here")
def test_the_scans_of_the_independent_simulator_read(tmp_path):
    """Folders with a log, its sensors, its frame and its outline, of arrays of four that scan line by line."""
    names = ("readings.csv", "sensors.toml", "frame.toml", "outline.csv")
    folders = [one for one in sorted(_SHARED.iterdir()) if all((one / name).is_file() for name in names)]
    assert folders
    for folder_ in folders:
        with (folder_ / "readings.csv").open(encoding="utf-8", newline="") as stream:
            cells = [row for row in csv.reader(stream) if row and not row[0].startswith("#")]
        unread = set(cells[0]) - {*HEADER.split(","), "status", "sigma_m", "amplitude", "stop"}
        # What some of them say of the detector is no key of a sensor here.
        sensors = (folder_ / "sensors.toml").read_text("utf-8").splitlines()
        sensors = [line for line in sensors if not line.startswith(("burst_cycles", "threshold_ratio"))]
        (tmp_path / "sensors.toml").write_text("\n".join(sensors), "utf-8")
        scan = read_readings_csv(folder_ / "readings.csv", tmp_path / "sensors.toml")
        assert scan.readings.n_readings == len(cells) - 1
        assert [name for name in sorted(unread) if f"'{name}'" not in "".join(scan.warnings)] == []
        assert len(scan.warnings) == bool(unread)
        assert scan.outline is not None
        # Each scan line has a height of its own.
        v = (inverse(scan.world_from_part) @ scan.readings.world_from_grip)[:, 1, 3]
        heights = [v[scan.readings.row == row] for row in range(int(scan.readings.row.max()) + 1)]
        assert len(heights) > 20
        assert max(np.ptp(line) for line in heights) < 0.5 * min(np.diff([line.mean() for line in heights]))


def test_sensor_specifications_survive_their_file(tmp_path, scans):
    path = tmp_path / "sensors.toml"
    path.write_text(sensors_toml(scans.SPECS), encoding="utf-8")
    assert read_sensors(path) == scans.SPECS
