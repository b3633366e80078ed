"""Acceptance of a ranger: a good one passes, every planted fault is named and nothing else, logs are judged too."""

import json
from dataclasses import replace

import numpy as np
import pytest

from surfuse.commands.rangers import acceptance
from surfuse.commands.rangers.acceptance import TrialSource, accept, judge, measured_model, metres
from surfuse.commands.rangers.acceptance_checks import AcceptanceLimits
from surfuse.commands.rangers.acceptance_trials import Trials, twin_trials
from surfuse.commands.rangers.sensor_sheet import NAMED
from surfuse.errors import ConfigError, DataError, UsageError
from surfuse.records import SensorSpec
from surfuse.rig.simulated.acceptance_bench import FAULTS, planted
from surfuse.rig.simulated.ranger_bench import known_readings_of
from surfuse.runs.scan_source import load_scan
from surfuse.runs.side_files import read_corrections, read_sensors, sensors_toml
from surfuse.twin.acoustics.noise import AcousticNoise

SPEC = NAMED["polaroid"]
LASER = SensorSpec("laser", "infrared", 0.1, 2.0, 0.04, 1e-3)


def faults_of(spec, trials):
    return [check.fault for check in judge(spec, trials) if not check.passed]


@pytest.fixture(scope="module")
def good():
    return twin_trials(planted(SPEC, None))


def test_a_good_sensor_passes_every_check_and_all_are_tested(good):
    checks = judge(SPEC, good)
    assert all(check.passed for check in checks)
    assert all(check.value is not None for check in checks)
    assert good.crosstalk.max() == 0.0


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_named_and_no_other(fault):
    assert faults_of(SPEC, twin_trials(planted(SPEC, fault), seed=2)) == [fault]


def test_other_sensors_pass_too():
    bare = NAMED["polaroid_bare"]
    assert faults_of(bare, twin_trials(planted(bare, None))) == []
    laser = judge(LASER, twin_trials(planted(LASER, None)))
    assert all(check.passed for check in laser)
    assert {check.name for check in laser if check.value is None} == {"cycle slips", "beam", "cross-talk"}


def test_cross_talk_is_between_neighbours_on_both_sides_of_a_step():
    matrix = twin_trials(planted(SPEC, "cross-talk")).crosstalk
    np.testing.assert_array_equal(np.diag(matrix), 0.0)
    # Sensors 0 and 2 stand over the near side first, so that their bursts reach the far ones too early.
    assert matrix[0, 1] > matrix[1, 0]
    assert matrix[2, 3] > matrix[3, 2]


def test_the_model_is_what_was_measured_and_reads_back(tmp_path, good):
    narrow = replace(good, beam_rad=2.0 * good.beam_rad, usable_rad=np.radians(15.0))
    model = measured_model(SPEC, narrow)
    assert model.beam_full_angle_rad == pytest.approx(2.0 * SPEC.beam_full_angle_rad, rel=0.02)
    assert model.aperture_m == pytest.approx(0.5 * SPEC.aperture_m, rel=0.02)
    assert model.incidence_limit_rad == pytest.approx(np.radians(15.0))
    assert model.sigma_m == pytest.approx(AcousticNoise().timing_m, rel=0.15)
    (tmp_path / "m.toml").write_text(sensors_toml((model,)))
    assert read_sensors(tmp_path / "m.toml")[0].sigma_m == model.sigma_m


def test_page_and_model_are_written_and_a_refusal_says_why(tmp_path, monkeypatch, good):
    deaf = replace(
        good.facing, status=np.ones_like(good.facing.status), range_m=np.full_like(good.facing.range_m, np.inf)
    )
    monkeypatch.setattr(acceptance, "twin_trials", lambda ranger, seed, material: replace(good, facing=deaf))
    page, model = tmp_path / "a.html", tmp_path / "m.toml"
    outcome = accept("polaroid", None, page, model)
    assert outcome.summary["passed"] is False
    assert "dropout" in outcome.summary["faults"]
    assert "FAIL" in page.read_text()
    assert read_sensors(model)[0].sigma_m == SPEC.sigma_m


def test_the_model_corrects_the_ranges_of_the_next_log(tmp_path):
    """An offset of 4 mm and a scale of 1.02 are found from one log and taken out of the other."""
    distances = (0.4, 0.6, 0.8, 1.0)
    log = tmp_path / "readings.csv"
    log_of(log, distances, np.zeros(10))
    rows = [line.split(",") for line in log.read_text().splitlines()]
    rows[1:] = [[*row[:-1], str(0.004 + 1.02 * float(row[-1]))] for row in rows[1:]]
    log.write_text("\n".join(",".join(row) for row in rows) + "\n")
    sheet, model = tmp_path / "sensors.toml", tmp_path / "model.toml"
    outcome = accept(str(sheet), None, None, model, TrialSource(log=log, distances_m=distances))
    assert "bias" in outcome.summary["faults"]
    found = read_corrections(model)[0].inverse
    assert found.offset_m == pytest.approx(0.004, abs=2e-6)
    assert found.scale == pytest.approx(1.02, abs=2e-6)
    corrected = load_scan(log, sensors=model).readings.range_m
    np.testing.assert_allclose(corrected, np.repeat(distances, 10), atol=1e-5)


def log_of(path, distances, errors):
    lines = ["t,sensor,px,py,pz,ax,ay,az,range_m"]
    times = 0
    for distance in distances:
        for error in errors:
            lines.append(f"{times},laser,0,0,0,1,0,0,{distance + error}")
            times += 1
    path.write_text("\n".join(lines) + "\n")
    (path.parent / "sensors.toml").write_text(sensors_toml((LASER,)))
    return path


@pytest.mark.parametrize(("bias", "faults"), [(0.0, []), (0.01, ["bias"])])
def test_a_log_of_a_facing_plate_is_judged(tmp_path, bias, faults):
    noise = np.random.default_rng(3).normal(bias, 1e-3, 25)
    log = log_of(tmp_path / "readings.csv", (0.4, 0.6, 0.8), noise)
    outcome = accept(
        str(tmp_path / "sensors.toml"), None, None, None, TrialSource(log=log, distances_m=(0.4, 0.6, 0.8))
    )
    assert outcome.summary["faults"] == faults
    assert outcome.summary["bias_mm"] == pytest.approx(1e3 * float(np.median(noise)), abs=0.01)
    untested = [check["name"] for check in outcome.summary["checks"] if check["value"] is None]
    assert untested == ["cycle slips", "warm-up drift", "beam", "usable incidence", "cross-talk"]
    json.dumps(outcome.summary)


def test_a_log_of_the_warm_up_shows_the_drift(tmp_path):
    log = log_of(tmp_path / "readings.csv", (0.4, 0.6), np.zeros(10))
    warm = log_of(tmp_path / "warm.csv", (0.43,), 0.005 * np.exp(-np.arange(60) / 12.0))
    path = str(tmp_path / "sensors.toml")
    outcome = accept(path, None, None, None, TrialSource(log=log, distances_m=(0.4, 0.6), warm_up=warm))
    assert outcome.summary["faults"] == ["drift"]


def test_readings_that_cannot_be_shared_out_are_refused(tmp_path):
    log = log_of(tmp_path / "readings.csv", (0.4, 0.6), np.zeros(5))
    with pytest.raises(DataError, match="10 readings of 'laser' for 3 distances"):
        accept(str(tmp_path / "sensors.toml"), None, None, None, TrialSource(log=log, distances_m=(0.4, 0.5, 0.6)))
    with pytest.raises(UsageError, match="without --distances"):
        accept(str(tmp_path / "sensors.toml"), None, None, None, TrialSource(log=log))


def test_slips_are_told_from_noise_and_do_not_count_as_bias():
    half = 0.5 * 343.2 / SPEC.frequency_hz
    generator = np.random.default_rng(1)
    ranges = 0.5 + generator.normal(0.0, 3e-4, 200)
    ranges[:40] += half
    known = known_readings_of(SPEC, np.full(200, 0.5), np.zeros(200), None, ranges)
    found = {check.fault: check for check in judge(SPEC, Trials(known))}
    assert found["cycle slips"].value == pytest.approx(20.0, abs=0.5)
    assert found["bias"].passed
    assert found["noise"].passed


def test_limits_and_distances_are_checked():
    assert metres("0.4,0.6") == (0.4, 0.6)
    assert metres(None) == ()
    for text in ("0.4;0.6", "-1", "400"):
        with pytest.raises(UsageError, match="--distances"):
            metres(text)
    with pytest.raises(UsageError, match="did you mean 'drift'"):
        planted(SPEC, "drit")
    known = known_readings_of(LASER, np.ones(9), np.zeros(9), None, np.linspace(1.0, 1.001, 9))
    strict = judge(LASER, Trials(known), AcceptanceLimits(noise_factor=0.01))
    assert [check.fault for check in strict if not check.passed] == ["noise"]


def test_options_of_a_log_without_a_log_are_refused(tmp_path):
    with pytest.raises(UsageError, match="--distances without --log"):
        accept("polaroid", None, None, None, TrialSource(distances_m=(0.4, 0.6)))
    with pytest.raises(UsageError, match="--warm-up without --log"):
        accept("polaroid", None, None, None, TrialSource(warm_up=tmp_path / "warm.csv"))


def test_the_table_of_the_page_says_the_same_as_the_line(good):
    for check in judge(SPEC, good):
        name, measured, limit, verdict = check.cells()
        assert (name, verdict) == (check.name, "pass")
        assert measured in check.text()
        assert limit.split()[0] in check.text()


@pytest.mark.parametrize(
    ("material", "low_deg", "high_deg"), [("painted", 22.5, 27.5), ("matte", 45.0, 60.0), ("metal", 5.0, 9.0)]
)
def test_the_usable_incidence_is_what_was_found_and_not_what_the_sheet_says(material, low_deg, high_deg, tmp_path):
    model = tmp_path / "model.toml"
    outcome = accept("polaroid", None, None, model, TrialSource(seed=3, material=material))
    found = outcome.summary["usable_incidence_deg"]
    assert low_deg <= found <= high_deg
    assert outcome.summary["material"] == material
    assert f"{found:.1f} degrees on a plate of '{material}'; the spec says 25" in dict(outcome.table)["usable up to"]
    assert np.degrees(read_sensors(model)[0].incidence_limit_rad) == pytest.approx(found)
    assert outcome.summary["faults"] == (["incidence"] if material == "metal" else [])


def test_a_material_belongs_to_the_twin(tmp_path):
    with pytest.raises(UsageError, match="--material"):
        TrialSource(log=tmp_path / "x.csv", distances_m=(0.4,), material="foam").trials(SPEC)
    with pytest.raises(ConfigError, match="material 'wood'"):
        TrialSource(material="wood").trials(SPEC)
