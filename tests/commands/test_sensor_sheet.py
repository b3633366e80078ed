"""The data sheet of a ranger: its numbers against what the sensor is, in the twin and from a log."""

import json
import math
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh

from surfuse.commands.rangers.sensor_sheet import (
    NAMED,
    Curve,
    SheetSource,
    _limit,
    charts_of,
    facts_of,
    sensor_sheet,
    spec_of,
    twin_sheet,
)
from surfuse.errors import ConfigError, DataError, StorageError, UsageError
from surfuse.records import SensorSpec
from surfuse.rig.simulated.ranger_bench import Bench
from surfuse.runs.side_files import sensors_toml

OPTICAL = SensorSpec("laser", "infrared", 0.1, 1.0, 0.04, 2e-3)


@pytest.fixture(scope="module")
def tube():
    return twin_sheet(NAMED["polaroid"])


def test_the_paper_s_transducer_in_its_tube(tube):
    assert tube.nearest_m == pytest.approx(0.327, abs=0.005)
    assert 7.0 <= tube.limit_smooth_deg <= 10.0
    assert tube.limit_rough_deg >= 25.0
    assert np.nanmax(np.abs(tube.over_range.error_mm)) < 1.0
    assert tube.noise_mm[0] == pytest.approx(0.3, rel=0.35)
    assert tube.noise_mm[-1] < 0.5 * tube.noise_mm[0]


def test_the_beam_is_that_of_a_piston(tube):
    """2 J1(x) / x squared is half at x = 1.616."""
    wave_number = 2.0 * math.pi * 63e3 / 343.2
    half = math.degrees(math.asin(1.616 / (wave_number * 0.020)))
    assert tube.beam_full_angle_deg == pytest.approx(2.0 * half, rel=0.01)
    assert max(tube.beam_db) == pytest.approx(0.0, abs=1e-9)


def test_a_rough_plate_is_heard_where_a_smooth_one_is_silent(tube):
    at = tube.over_incidence_rough.x.index(15.0)
    assert tube.over_incidence_rough.heard[at] > 0.9
    assert tube.over_incidence_smooth.heard[at] < 0.1


def test_the_limit_ends_at_the_first_gap():
    curve = Curve((0.0, 1.0, 2.0, 3.0), (0.0,) * 4, (0.0,) * 4, (1.0, 0.6, 0.4, 0.9))
    assert _limit(curve) == 1.0
    assert _limit(replace(curve, heard=(0.4, 1.0, 1.0, 1.0))) is None
    assert _limit(replace(curve, heard=(1.0,) * 4)) == 3.0


def test_an_optical_sensor_has_no_beam_pattern():
    sheet = twin_sheet(OPTICAL)
    assert sheet.beam_deg == ()
    assert sheet.beam_full_angle_deg is None
    assert sheet.noise_mm[0] == pytest.approx(2.0, rel=0.35)
    assert "beam, full angle" not in " ".join(label for label, _ in facts_of(sheet))


def test_page_picture_and_numbers_are_whole(tmp_path, monkeypatch, tube):
    monkeypatch.setattr("surfuse.commands.rangers.sensor_sheet.twin_sheet", lambda spec, seed: tube)
    page, picture, numbers = tmp_path / "s.html", tmp_path / "s.svg", tmp_path / "s.json"
    sensor_sheet("polaroid", None, page, numbers)
    sensor_sheet("polaroid", None, picture, None)
    text = page.read_text()
    assert text.count("<svg") == len(charts_of(tube)) == 5
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert "<script" not in text
    root = ElementTree.fromstring(picture.read_text())
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert json.loads(numbers.read_text())["limit_smooth_deg"] == tube.limit_smooth_deg
    with pytest.raises(StorageError):
        sensor_sheet("polaroid", None, page, None)


def test_the_bench_expects_the_foot_of_a_beam_and_the_axis_of_a_laser():
    known = Bench(NAMED["polaroid"]).measure(0.5, math.radians(5.0), 4)
    np.testing.assert_allclose(Bench(OPTICAL).measure(0.5, 0.1, 2).expected_m, 0.5)
    np.testing.assert_allclose(known.expected_m, 0.2 + 0.3 * math.cos(math.radians(5.0)))
    assert np.abs(known.errors_m()).max() < 2e-3
    assert len(set(known.t_s.tolist())) == 4


@pytest.fixture
def measured(tmp_path):
    """A log of a laser with a bias of 3 mm before a plate that is met at 0 and at 30 degrees."""
    plate = trimesh.Trimesh([[0, -2, -2], [0, 2, -2], [0, 2, 2], [0, -2, 2]], [[0, 2, 1], [0, 3, 2]], process=False)
    plate.export(tmp_path / "plate.ply")
    lines = ["t,sensor,px,py,pz,ax,ay,az,range_m"]
    for number in range(40):
        tilt = math.radians(30.0 * (number % 2))
        axis_m = 0.4 + 0.01 * (number // 8)
        away = axis_m * math.cos(tilt)
        lines.append(f"{number},laser,{-away},0,0,{math.cos(tilt)},{math.sin(tilt)},0,{axis_m + 0.003}")
    (tmp_path / "readings.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "sensors.toml").write_text(sensors_toml((OPTICAL,)))
    return tmp_path


def test_a_measured_log_gives_the_error_against_range_and_incidence(measured):
    outcome = sensor_sheet(
        str(measured / "sensors.toml"), None, None, None, SheetSource(measured / "readings.csv", measured / "plate.ply")
    )
    over_incidence = outcome.summary["over_incidence_rough"]
    assert len(over_incidence["x"]) == 2
    np.testing.assert_allclose(over_incidence["error_mm"], 3.0, atol=1e-6)
    np.testing.assert_allclose(outcome.summary["over_range"]["error_mm"], 3.0, atol=1e-6)


def test_names_and_tables_are_told_apart(tmp_path):
    assert spec_of("polaroid_bare").dead_length_m == 0.0
    path = tmp_path / "sensors.toml"
    path.write_text(sensors_toml((OPTICAL, replace(OPTICAL, name="right"))))
    assert spec_of(str(path), "right").name == "right"
    for name, table, told in (
        ("polaroyd", None, "did you mean 'polaroid'"),
        (str(path), None, "laser, right"),
        (str(path), "lasre", "did you mean 'laser'"),
    ):
        with pytest.raises(Exception, match=told):
            spec_of(name, table)
    with pytest.raises(UsageError, match="belong together"):
        sensor_sheet("polaroid", None, None, None, SheetSource(log=path))


def test_a_named_sensor_has_no_tables():
    with pytest.raises(UsageError, match="--sensor chooses a table"):
        spec_of("polaroid", "left")


GOOD_TABLE = 'kind = "ultrasonic"\nbeam_full_angle_deg = 20\nrange_min_m = 0.3\nrange_max_m = 4\nsigma_m = 0.001\n'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("frequency_hz = 40", "frequency_hz = 40; give 1000 to"),
        ("frequency_hz = -63000.0", "frequency_hz"),
        ("aperture_m = 38.4", r"aperture_m = 38\.4; give 0\.0001 to 1"),
        ("dead_length_m = -0.2", "dead_length_m"),
        ("firing_time_s = inf", "firing_time_s"),
        ("frequency_hz = [63000]", "frequency_hz"),
        ("freqency_hz = 63000", "freqency_hz"),
        ("late = 3", "late"),
    ],
)
def test_a_hostile_table_is_refused_with_key_value_and_cure(tmp_path, text, told):
    path = tmp_path / "sensors.toml"
    path.write_text(f"[one]\n{GOOD_TABLE}{text}\n")
    with pytest.raises((ConfigError, DataError), match=told):
        spec_of(str(path))


@pytest.mark.parametrize(
    "raw", [b"\xff\xfe\x00", b"[a]\n[a]\n", b"a = " + b"[" * 3000, b"", b"x = 1\n", b"[a]\nkind = 1\n"]
)
def test_a_file_that_is_no_sensors_toml_is_refused(tmp_path, raw):
    path = tmp_path / "sensors.toml"
    path.write_bytes(raw)
    with pytest.raises((ConfigError, DataError)):
        spec_of(str(path))
