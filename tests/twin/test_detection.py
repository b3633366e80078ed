import numpy as np
import pytest

from surfuse.twin.acoustics.detection import Detector, Received, burst_envelope, detect, envelope_at
from surfuse.twin.acoustics.kit import GAIN_STEP_ENDS_S, KitParameters

SHAPE = burst_envelope(254e-6, 12e-6, 2.9e-6)
BINS = 900


def plain_envelope(mirror, real, imag, ringing):
    """The same by convolution over the whole time."""
    energy = np.convolve(mirror, SHAPE**2)[:BINS]
    diffuse = np.convolve(real + 1j * imag, SHAPE)[:BINS]
    return np.sqrt(energy + np.abs(diffuse) ** 2 + ringing**2)


def plain_detect(envelope, level, opens, scale, shift):
    above = envelope[opens:] * scale + shift >= level[opens:]
    if not above.any():
        return np.inf
    k = opens + int(np.argmax(above))
    if k == opens:
        return -np.inf
    before = envelope[k - 1] * scale + shift - level[k - 1]
    now = envelope[k] * scale + shift - level[k]
    return k - now / (now - before)


def random_arrivals(seed, faint=1.0):
    generator = np.random.default_rng(seed)
    mirror, real, imag = np.zeros(BINS), np.zeros(BINS), np.zeros(BINS)
    for bins, count in ((mirror, 4), (real, 40), (imag, 40)):
        where = generator.integers(100, 700, count)
        bins[where] = faint * generator.normal(size=count) ** (2 if bins is mirror else 1)
    used = np.flatnonzero((mirror != 0) | (real != 0) | (imag != 0))
    return mirror, real, imag, np.array([used[0], used[-1]])


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("faint", [1.0, 0.05])
def test_detection_agrees_with_a_plain_one(seed: int, faint: float) -> None:
    generator = np.random.default_rng(100 + seed)
    mirror, real, imag, extent = random_arrivals(seed, faint)
    ringing = 5.0 * np.exp(-np.arange(BINS) / 20.0) * (np.arange(BINS) < 200)
    level = np.full(BINS, 0.5)
    scale, shift = 1.0 + 0.1 * generator.normal(size=5), 0.02 * generator.normal(size=5)
    envelope = plain_envelope(mirror, real, imag, ringing)
    crossing = np.empty(5)
    for opens in (30, 80, 150, 400):
        received = Received(mirror, real, imag, extent, SHAPE, SHAPE**2)
        peak = detect(received, Detector(level, ringing, opens), scale, shift, crossing)
        expected = [plain_detect(envelope, level, opens, a, b) for a, b in zip(scale, shift, strict=True)]
        assert crossing == pytest.approx(np.array(expected), abs=1e-9)
        assert np.isnan(peak) == (not np.isfinite(crossing).any())


def test_the_envelope_is_the_sum_over_the_window() -> None:
    mirror, real, imag, extent = random_arrivals(3)
    expected = plain_envelope(mirror, real, imag, np.zeros(BINS))
    for k in (0, extent[0], 333, extent[1] + 5, BINS - 1):
        got = envelope_at(int(k), Received(mirror, real, imag, extent, SHAPE, SHAPE**2))
        assert got == pytest.approx(expected[int(k)], abs=1e-12)


def test_nothing_arrives_nothing_is_heard() -> None:
    crossing = np.empty(2)
    empty = np.zeros(BINS)
    received = Received(empty, empty, empty, np.array([BINS, -1]), SHAPE, SHAPE**2)
    peak = detect(received, Detector(np.full(BINS, 0.1), empty, 10), np.ones(2), np.zeros(2), crossing)
    assert np.all(crossing == np.inf)
    assert np.isnan(peak)


def test_the_burst_rises_with_its_cycles_and_decays() -> None:
    assert SHAPE[0] == 0.0
    assert SHAPE.max() == pytest.approx(1.0, abs=1e-3)
    assert SHAPE[-1] < 0.02
    assert burst_envelope(4 / 63e3, 30e-6, 1e-6).max() < 0.7


def test_the_gain_rises_in_twelve_steps_at_the_times_of_the_chip() -> None:
    assert 1e3 * np.array(GAIN_STEP_ENDS_S[:4]) == pytest.approx([2.38, 5.12, 7.87, 10.61], abs=0.01)
    assert 1e3 * np.array(GAIN_STEP_ENDS_S[-3:]) == pytest.approx([27.07, 32.55, 38.04], abs=0.01)
    kit = KitParameters(threshold=0.06, gain=2.0, gain_step_db=5.0)
    level = kit.level(np.array([1e-3, 3e-3, 39e-3]))
    assert level == pytest.approx(0.03 * 10.0 ** (-np.array([0.0, 5.0, 55.0]) / 20.0))
