"""Echo physics: closed forms, limits, and plain twins of the compiled kernels."""

from __future__ import annotations

import numpy as np
import pytest

from surfuse.beam_model.echo.crossing import Beam, RangeBins, first_crossings, plane_impulse
from surfuse.beam_model.echo.detector import (
    LEVELS,
    OFF_AXIS,
    TILTS,
    DetectorModel,
    beam_table,
    half_plane,
    piston,
    rise_delay,
)
from surfuse.records import SensorSpec

TUBE = SensorSpec("us", "ultrasonic", 0.2, 1.2, float(np.radians(13.0)), 3e-4, frequency_hz=63e3, aperture_m=0.04)
WIDE = SensorSpec("us", "ultrasonic", 0.2, 1.2, float(np.radians(26.0)), 3e-4, frequency_hz=63e3, aperture_m=0.0147)
LASER = SensorSpec("tof", "laser", 0.02, 2.0, float(np.radians(2.0)), 1e-3)


def plain_crossing(row: np.ndarray, burst: int, pole: float, threshold: float) -> tuple[float, float]:
    """The filtered envelope by whole arrays: boxcar by cumulative sums, then the recursion of one pole."""
    echo = row[:, 0] + 1j * row[:, 1]
    total = np.concatenate([[0.0], np.cumsum(echo)])
    box = total[1:] - total[np.maximum(np.arange(len(echo)) + 1 - burst, 0)]
    envelope, state = [], 0.0 + 0.0j
    for value in box:
        state = state + pole * (value - state)
        envelope.append(abs(state))
    above = np.flatnonzero(np.array(envelope) >= threshold)
    if len(above) == 0:
        return np.nan, max(envelope)
    b = above[0]
    last = envelope[b - 1] if b else 0.0
    return b + (threshold - last) / (envelope[b] - last), max(envelope)


def test_first_crossings_against_the_plain_twin() -> None:
    rng = np.random.default_rng(3)
    impulse = rng.normal(size=(20, 200, 2)) * 0.01
    crossing, peak = first_crossings(impulse, 30, 0.1, 0.05)
    for k in range(20):
        want, top = plain_crossing(impulse[k], 30, 0.1, 0.05)
        np.testing.assert_allclose(crossing[k], want, rtol=1e-9)
        np.testing.assert_allclose(peak[k], top, rtol=1e-9)
    assert np.any(np.isfinite(crossing))


def test_piston_is_one_on_the_axis_and_zero_at_its_null() -> None:
    assert piston(23.1, np.zeros(1))[0] == 1.0
    null = np.arcsin(3.8317 / 23.1)
    assert abs(piston(23.1, np.array([null]))[0]) < 1e-4


def test_half_plane_is_a_half_at_its_edge_and_whole_far_inside() -> None:
    amplitude = half_plane(np.array([0.0, -1.0, 0.2]), np.full(3, 0.43), 0.00545)
    np.testing.assert_allclose(amplitude[0], 0.5, atol=1e-9)
    assert abs(amplitude[1] - 1.0) < 0.02
    assert amplitude[2] < 0.05


def test_weaker_echoes_cross_later_and_below_the_threshold_never() -> None:
    delay = rise_delay(np.array([1.0, 0.5, 0.1, 0.03, 0.014]), 0.0145, 0.011)
    assert delay[0] == 0.0
    assert np.all(np.diff(delay[:4]) > 0.0)
    assert np.isinf(delay[4])


def test_an_infinite_facing_plane_has_amplitude_one() -> None:
    wavelength = 343.2 / 63e3
    beam = Beam(wavelength, piston(23.1, OFF_AXIS) ** 2, float(OFF_AXIS[1]))
    echo = plane_impulse(0.0, -1.0, 0.43, beam, wavelength / 5, 0.15, RangeBins(0.4, 2e-4, 600))
    total = np.cumsum(echo[0, :, 0] + 1j * echo[0, :, 1])
    assert abs(np.max(np.abs(total[len(total) // 2 :])) - 1.0) < 0.1


@pytest.mark.parametrize(("spec", "dies_deg"), [(TUBE, 10.0), (WIDE, 24.0)])
def test_mirror_echoes_die_off_axis(spec: SensorSpec, dies_deg: float) -> None:
    table = beam_table(spec, 440, DetectorModel())
    angle = np.degrees(OFF_AXIS)
    assert table.mirror[0] == pytest.approx(1.0, abs=0.05)
    assert np.interp(0.5 * dies_deg, angle, table.mirror) < np.interp(0.2 * dies_deg, angle, table.mirror)
    assert np.interp(1.3 * dies_deg, angle, table.mirror) < 0.0145


def test_speckle_of_the_tube_is_late_and_weak_echoes_are_later() -> None:
    table = beam_table(TUBE, 440, DetectorModel())
    row = int(np.argmin(np.abs(TILTS - np.radians(20.0))))
    assert 0.0 < table.speckle_m[row, -1] < 0.012
    assert table.speckle_m[row, 1] > table.speckle_m[row, len(LEVELS) - 2]
    assert np.all(table.scatter_m[row] > 0.0)


def test_light_has_no_beam() -> None:
    table = beam_table(LASER, 440, DetectorModel())
    assert table.optical
    assert not np.any(table.mirror)
    assert not np.any(table.speckle_m)


def test_missing_aperture_follows_from_the_beam_angle() -> None:
    bare = SensorSpec("us", "ultrasonic", 0.2, 1.2, float(np.radians(13.0)), 3e-4)
    table = beam_table(bare, 440, DetectorModel())
    at_half = np.interp(np.radians(6.5), OFF_AXIS, table.directivity)
    assert 0.05 < at_half < 0.3
