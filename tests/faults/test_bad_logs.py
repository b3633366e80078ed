"""Logs of other people: what is wrong with them is said with file, line and column, or is put right and told."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from surfuse.exporters import nc
from surfuse.runs.readings_csv import write_readings_csv
from surfuse.runs.scan_source import load_scan

SIDES = ("sensors.toml", "frame.toml", "outline.csv")
PAPER = ("--method", "weighted_average")
Rows = list[list[str]]


@pytest.fixture(scope="module")
def sound(tmp_path_factory, flat_run) -> Path:
    """A readings CSV with its side files, exported from a scan."""
    path = tmp_path_factory.mktemp("sound") / "readings.csv"
    scan = load_scan(flat_run)
    write_readings_csv(path, scan.readings, scan.scene())
    return path


@pytest.fixture
def changed(tmp_path, sound) -> Callable[..., Path]:
    """Write the sound log with its rows changed; row 0 is the header."""

    def write(change: Callable[[Rows], Rows], sides: tuple[str, ...] = SIDES, separator: str = ",") -> Path:
        rows = [line.split(",") for line in sound.read_text().splitlines()]
        path = tmp_path / "readings.csv"
        path.write_text("".join(separator.join(row) + "\n" for row in change(rows)))
        for name in sides:
            shutil.copy(sound.with_name(name), tmp_path / name)
        return path

    return write


def cell(column: str, line: int, value: str) -> Callable[[Rows], Rows]:
    """Change one cell; lines are counted as an editor does, the header is line 1."""

    def change(rows: Rows) -> Rows:
        rows[line - 1][rows[0].index(column)] = value
        return rows

    return change


def without_echo(rows: Rows) -> Rows:
    place, status = rows[0].index("range_m"), rows[0].index("status")
    for row in rows[1:]:
        row[place], row[status] = "", "no_echo"
    return rows


def in_millimetres(rows: Rows) -> Rows:
    return [rows[0], *([*row[:2], *(str(1e3 * float(value)) for value in row[2:5]), *row[5:]] for row in rows[1:])]


BAD = {
    "missing column": (lambda rows: [row[:3] + row[4:] for row in rows], [":1:", "py is missing"]),
    "misspelt column": (lambda rows: [["t", "sensr", *rows[0][2:]], *rows[1:]], [":1:", "sensor"]),
    "column twice": (lambda rows: [[*row, row[2]] for row in rows], [":1:", "'px' comes twice"]),
    "text in a number": (cell("px", 6, "abc"), [":6:px", "'abc'"]),
    "decimal comma": (cell("px", 6, '"0,5"'), [":6"]),
    "axis not unit": (cell("ax", 6, "0.9"), [":6:ax", "length 1.06"]),
    "unknown sensor": (cell("sensor", 8, "us9"), [":8:sensor", "'us9'", "did you mean 'us"]),
    "no rows": (lambda rows: rows[:1], ["no readings"]),
    "nothing": (lambda rows: [], ["empty"]),
    "no echo at all": (without_echo, ["readings is an echo (", " without echo, 0 too close, 0 faulty"]),
    "nan pose": (cell("py", 5, "nan"), [":5:py", "nan"]),
    "infinite time": (cell("t", 5, "inf"), [":5:t", "inf"]),
    "negative range": (cell("range_m", 4, "-0.2"), [":4:range_m", "-0.2"]),
    "unknown status": (cell("status", 4, "okk"), [":4:status", "did you mean 'ok'"]),
    "half a stop": (cell("stop", 4, "1.5"), [":4:stop", "stop = 1.5;"]),
    "one time, two readings": (lambda rows: [*rows, [*rows[50][:8], "0.5", *rows[50][9:]]], ["two different readings"]),
    "short line": (lambda rows: [*rows[:3], rows[3][:5], *rows[4:]], [":4:", "5 values"]),
    "millimetres": (in_millimetres, [":2:px", "millimetres"]),
    "endless number": (cell("px", 6, "9" * 100_000), [":6"]),
}


def test_a_csv_with_a_column_of_somebody_else_is_fused_with_a_note(command, changed):
    path = changed(lambda rows: [[*row, "k" if row[0] == "t" else "x"] for row in rows])
    answer = command("fuse", path, "--method", "mean", "--out", path.parent / "out")
    assert answer.status == 0
    assert answer.err == f"surfuse: note: {path}:1: column not read: 'k'\n"


@pytest.mark.parametrize(("change", "told"), BAD.values(), ids=BAD.keys())
def test_a_csv_that_cannot_be_used(command, changed, digests, change, told):
    path = changed(change)
    before = digests(path.parent)
    line = command("fuse", path, "--out", path.parent / "out").error(3, str(path), *told)
    assert "np." not in line
    assert digests(path.parent) == before


def test_times_out_of_order_are_put_in_order_and_told(command, changed, sound, tmp_path, map_bits):
    command("fuse", sound, *PAPER, "--out", tmp_path / "sound", "--quiet")
    path = changed(lambda rows: [rows[0], *rows[:0:-1]])
    answer = command("fuse", path, *PAPER, "--out", tmp_path / "sorted")
    assert answer.status == 0
    assert "the time goes back" in answer.err
    assert map_bits(tmp_path / "sorted") == map_bits(tmp_path / "sound")


def test_repeated_rows_are_used_once_and_told(command, changed, sound, tmp_path, map_bits):
    command("fuse", sound, *PAPER, "--out", tmp_path / "sound", "--quiet")
    path = changed(lambda rows: [*rows, rows[3]])
    answer = command("fuse", path, *PAPER, "--out", tmp_path / "once", "--json")
    assert any("repeated" in warning for warning in answer.json["warnings"])
    assert map_bits(tmp_path / "once") == map_bits(tmp_path / "sound")


def test_the_csv_of_a_scan_gives_the_map_of_the_scan(command, sound, flat_run, tmp_path):
    command("fuse", sound, *PAPER, "--out", tmp_path / "out", "--quiet")
    one, two = nc.read_points(tmp_path / "out" / "surface.nc"), nc.read_points(flat_run / "surface.nc")
    # A CSV has no grip pose: the mean of the sensors stands for it, to a fraction of their mounting errors.
    assert np.allclose(one.depth_m, two.depth_m, rtol=0.0, atol=1e-4, equal_nan=True)


def test_without_side_files_everything_assumed_is_told(command, changed, tmp_path):
    answer = command("fuse", changed(lambda rows: rows, sides=()), "--out", tmp_path / "out", "--json")
    assert answer.status == 0
    assert answer.json["frame_estimated"] is True
    assert any("no sensors.toml" in warning for warning in answer.json["warnings"])


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_separators_and_byte_order_mark(command, changed, tmp_path, separator):
    path = changed(lambda rows: rows, separator=separator)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert command("fuse", path, "--out", tmp_path / "out", "--quiet").status == 0


def test_side_files_that_are_none(command, sound, tmp_path):
    (tmp_path / "empty.toml").write_text("")
    (tmp_path / "odd.toml").write_text("[us0]\nkind = 'ultrasonic'\nbeam_angle = 22\n")
    command("fuse", sound, "--sensors", tmp_path / "empty.toml").error(3, "empty.toml", "no sensor")
    command("fuse", sound, "--sensors", tmp_path / "odd.toml").error(3, "odd.toml", "beam_full_angle_deg")
    command("fuse", sound, "--sensors", tmp_path / "missing.toml").error(3, "missing.toml", "no such file")
    command("fuse", sound, "--frame", sound.with_name("sensors.toml")).error(3, "sensors.toml", "origin, u, v")
    command("fuse", sound, "--outline", sound).error(3, "readings.csv", "columns u,v")


@pytest.mark.parametrize("name", ["log.txt", "log.csv", "log.mcap", "log.bag", "log"])
@pytest.mark.parametrize("content", [b"", b"\x00\xff\xfe" * 999, b"hello\n"], ids=["empty", "bytes", "text"])
def test_files_that_are_no_log(command, tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    command("fuse", path, "--out", tmp_path / "out").error(3, str(path))
    assert path.read_bytes() == content


def test_a_log_cut_anywhere_gives_its_whole_sweeps_or_says_that_there_is_none(command, flat_run, tmp_path):
    whole = (flat_run / "log" / "000.mcap").read_bytes()
    dice, counts = random.Random(3), []
    sizes = [0, 7, 8, 9, *sorted(dice.randrange(len(whole)) for _ in range(6))]
    for size in [*sizes, len(whole) - 30_000, len(whole) - 9, len(whole)]:
        path, out = tmp_path / "cut.mcap", tmp_path / f"out{size}"
        path.write_bytes(whole[:size])
        answer = command("fuse", path, *PAPER, "--out", out, "--json")
        if answer.status:
            answer.error(3, "cut.mcap")
            counts.append(0)
        else:
            counts.append(answer.json["stops"])
    assert counts == sorted(counts)
    stops = json.loads((flat_run / "summary.json").read_text())["stops"]
    assert counts[0] == 0 < counts[-3] < stops == counts[-1]


def test_a_flipped_bit_is_found_and_told(command, flat_run, tmp_path, map_bits):
    whole = (flat_run / "log" / "000.mcap").read_bytes()
    wanted = map_bits(flat_run)
    dice = random.Random(5)
    for number in range(6):
        damaged = bytearray(whole)
        damaged[dice.randrange(len(whole) - 25_000, len(whole))] ^= 1 << dice.randrange(8)
        path, out = tmp_path / f"flip{number}.mcap", tmp_path / f"out{number}"
        path.write_bytes(damaged)
        answer = command("fuse", path, *PAPER, "--out", out, "--json")
        if answer.status:
            answer.error(3, path.name)
        elif map_bits(out) != wanted:
            assert any(path.name in warning for warning in answer.json["warnings"])


def test_a_foreign_log_without_ranges_names_what_it_needs(command, tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "foreign.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="someone")
        schema = writer.register_schema("thing", "jsonschema", b"{}")
        channel = writer.register_channel("/thing", "json", schema)
        writer.add_message(channel, 1, json.dumps({"x": 1}).encode(), 1)
        writer.finish()
    command("fuse", path).error(3, "foreign.mcap", "sensor_msgs/msg/Range", "/thing")


def test_resume_with_a_damaged_plan_says_that_there_is_no_way_on(command, flat_run, tmp_path):
    run = Path(shutil.copytree(flat_run, tmp_path / "run"))
    (run / "report.html").unlink()
    log = run / "log" / "000.mcap"
    content = bytearray(log.read_bytes())
    # The scene is the first chunk, in the first kilobyte.
    for place in range(600, 700):
        content[place] ^= 0xFF
    log.write_bytes(content)
    command("resume", run).error(3, "sweeps", "damaged")
    assert log.read_bytes() == content
