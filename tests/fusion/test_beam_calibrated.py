"""A measured lateness on tilt replaces that of the model: a sensor that the model does not describe is put right."""

from __future__ import annotations

import dataclasses
import importlib.util
from pathlib import Path

import numpy as np
import pytest

from surfuse.beam_model.echo.detector import TILTS, DetectorModel, beam_table, measured
from surfuse.records import FusionScene, LateTable, Readings, SensorSpec

_SPEC = importlib.util.spec_from_file_location("beam_scans_of_tilt", Path(__file__).with_name("test_beam.py"))
assert _SPEC is not None
assert _SPEC.loader is not None
scans = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(scans)

TILT_DEG, LATE_M, SCATTER_M = 25.0, 0.020, 0.002
TABLE = LateTable((float(np.radians(TILT_DEG)),), (LATE_M,), (SCATTER_M,))


def late_scan(spec: SensorSpec) -> tuple[FusionScene, Readings, object]:
    """A plate at 25 degrees whose ranges come 20 mm behind the axis: later than the model of the sensor says."""
    slope, rng = np.tan(np.radians(TILT_DEG)), np.random.default_rng(3)

    def along_axis(place: np.ndarray) -> np.ndarray:
        return place[:, 2] - slope * place[:, 0] + LATE_M + rng.normal(0.0, SCATTER_M, len(place))

    return scans.scan(along_axis, spec=spec, outliers=0.0, reach=4)


def error_mm(spec: SensorSpec) -> np.ndarray:
    case = late_scan(spec)
    surface = scans.fuse(*case)
    u, _ = np.meshgrid(case[2].u_m, case[2].v_m)
    return 1e3 * (surface.height_m - np.tan(np.radians(TILT_DEG)) * u)[surface.mask & (np.abs(u) < 0.05)]


@pytest.mark.parametrize("spec", [scans.TUBE, scans.LASER])
def test_a_wrong_lateness_is_corrected_by_the_table(spec):
    before = error_mm(spec)
    after = error_mm(dataclasses.replace(spec, late=TABLE))
    assert abs(np.median(before)) > 5.0
    assert abs(np.median(after)) < 1.5
    assert np.sqrt(np.mean(after**2)) < 0.4 * np.sqrt(np.mean(before**2))


def test_the_table_keeps_the_mirror_and_what_amplitudes_tell():
    plain = beam_table(scans.TUBE, 440, DetectorModel())
    moved = beam_table(dataclasses.replace(scans.TUBE, late=TABLE), 440, DetectorModel())
    assert np.array_equal(plain.mirror, moved.mirror)
    assert np.interp(np.radians(TILT_DEG), TILTS, moved.speckle_m[:, -1]) == pytest.approx(LATE_M, abs=1e-3)
    assert np.array_equal(moved.speckle_m[:, :-1], plain.speckle_m[:, :-1])


def test_what_was_measured_under_the_mirror_says_nothing_of_speckle():
    location, scale = np.ones((len(TILTS), 9)), np.full((len(TILTS), 9), 0.005)
    facing = LateTable((0.0, float(np.radians(5.0))), (-0.001, -0.002), (0.001, 0.001))
    spec = dataclasses.replace(scans.TUBE, late=facing)
    same = measured(location, scale, spec, float(np.radians(9.0)))
    assert same[0] is location
    assert same[1] is scale
