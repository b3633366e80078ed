"""What a threshold detector makes of an echo: beam, rise of the envelope, speckle; tabulated once a sensor.

Sources: circular-piston directivity (Morse and Ingard, Theoretical Acoustics, 7.4); half-plane diffraction by the
Fresnel integral (Born and Wolf, Principles of Optics, 8.7); fully developed speckle as circular complex Gaussian noise
(Goodman, Speckle Phenomena in Optics, 3.2); detector and burst as in the Polaroid 6500 ranging module.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import fresnel, j1

from surfuse.beam_model.echo.crossing import Beam, RangeBins, first_crossings, plane_impulse
from surfuse.records import FloatArray, SensorSpec

SPEED_OF_SOUND_M_S = 343.2
ROOM_K = 293.15
# Angles of the tables: fine where the mirror-like echo dies, up to where no matte surface answers.
TILTS = np.radians(np.array([0, 3, 6, 8, 10, 12, 14, 17, 20, 23, 26, 30, 35, 40, 50, 60, 75], dtype=np.float64))
OFF_AXIS = np.radians(np.linspace(0.0, 45.0, 181))
LEVELS = np.log(np.array([1.0, 1.2, 1.5, 1.9, 2.4, 3.2, 4.5, 7.0]))
TRIALS = 500
BIN_M = 0.001
FINE_BIN_M = 0.0002
SMOOTH_ANGLES = 13
# An echo later than this many rise lengths is lost in what follows.
MOST_LATE = 1.2
FIRST_NULL = 3.8317
# Speckle of the strip beside a rim, relative to the rim's own wave, per scattering length in wavelengths.
RIM_GRAIN = 0.38
# A calibration of a few hundred echoes does not prove a smaller scatter than this.
LEAST_SCATTER_M = 0.0003


@dataclass(frozen=True)
class DetectorModel:
    """Constants of burst, detector and matte surface that no sheet of a sensor gives.

    `threshold` relative to the echo of a facing plate, `cycles` of the burst, `rise_wavelengths` the time constant of
    the envelope in ranges of one wavelength, `roughness_m` the diffuse scattering length of a matte surface,
    `air_temperature_sigma_k` the standard deviation of the air temperature that the ranges were computed with.
    """

    threshold: float = 0.0145
    cycles: int = 16
    rise_wavelengths: float = 2.0
    roughness_m: float = 0.00065
    air_temperature_sigma_k: float = 0.4

    @property
    def speed_share(self) -> float:
        """Standard deviation of the speed of sound, as a share of it: the speed grows with the root of T."""
        return 0.5 * self.air_temperature_sigma_k / ROOM_K


@dataclass(frozen=True)
class BeamTable:
    """One sensor's answers: mirror-like echoes and rims by off-axis angle, speckle by tilt.

    Over `OFF_AXIS`: `directivity` two-way; `mirror` and `rim` the amplitudes that explain when a smooth plane of that
    tilt, and the rim of a facing half plane at that angle, cross the threshold (0: never). `half_angle_rad` the capture
    angle; `wavelength_m`; `speckle_m`, `scatter_m` (tilts, levels + 1) location and scale of range minus axis range,
    the last column for readings without amplitude; `level` (tilts,) the median amplitude. `speed_share` is how
    uncertain the speed of sound is, the same for all readings.

    `rise_m` is the time constant of the envelope in m of range, `threshold` that of the detector relative to a facing
    plate, `rim_speckle` the speckle amplitude that competes with a rim; `optical` sensors hear on their axis alone.
    """

    directivity: FloatArray
    mirror: FloatArray
    rim: FloatArray
    speckle_m: FloatArray
    scatter_m: FloatArray
    level: FloatArray
    half_angle_rad: float
    wavelength_m: float
    threshold: float
    rise_m: float
    rim_speckle: float
    optical: bool
    speed_share: float = 0.0


def piston(ka: float, angle_rad: FloatArray) -> FloatArray:
    """One-way amplitude of a circular piston, 1 on the axis: 2 J1(x) / x with x = ka sin(angle).

    `angle_rad` of any shape. `ka` is the wave number times the radius of the aperture. Formula: the far field of a
    rigid piston in a baffle (Kinsler and others, Fundamentals of Acoustics).
    """
    x = ka * np.sin(angle_rad)
    safe = np.where(np.abs(x) < 1e-9, 1.0, x)
    return np.where(np.abs(x) < 1e-9, 1.0, 2.0 * j1(safe) / safe)


def rise_delay(amplitude: FloatArray, threshold: float, rise_m: float) -> FloatArray:
    """How much later (m of range) an echo of this peak amplitude crosses the threshold than one of amplitude 1.

    Of any shape; inf for amplitudes within 2 % of the threshold and below. `threshold` is relative to an amplitude of
    1, `rise_m` the time constant of the envelope in m of range: it rises as 1 - exp(-x / rise).
    """
    ratio = np.clip(threshold / np.maximum(amplitude, 1e-12), 0.0, 1.0 - 1e-6)
    delay = -rise_m * np.log1p(-ratio) + rise_m * np.log1p(-threshold)
    return np.where(amplitude > 1.02 * threshold, delay, np.inf)


def half_plane(distance_m: FloatArray, range_m: FloatArray, wavelength_m: float) -> FloatArray:
    """Amplitude of a facing half plane whose edge is `distance_m` beside the axis (negative: it covers the axis).

    Of any shape, 1 far inside the plane and 1/2 at its edge. `range_m` is the distance of the plane; the way there and
    back makes the Fresnel argument 2 d / sqrt(wavelength range).
    """
    s, c = fresnel(2.0 * np.asarray(distance_m) / np.sqrt(wavelength_m * np.asarray(range_m)))
    return np.asarray(np.hypot(0.5 - c, 0.5 - s) / np.sqrt(2.0), dtype=np.float64)


def _profile(ka: float, tilt: float, range_m: float, wavelength_m: float, bins: int, origin_m: float) -> FloatArray:
    """Diffuse echo power by range bin from a matte plane of this tilt, per squared scattering length."""
    theta = np.radians(np.arange(0.25, 45.0, 0.5))
    phi = np.radians(np.arange(0.0, 360.0, 7.5))
    th, ph = np.meshgrid(theta, phi, indexing="ij")
    cos_incidence = np.cos(tilt) * np.cos(th) - np.sin(tilt) * np.sin(th) * np.cos(ph)
    hit = cos_incidence > 0.05
    rho = range_m * np.cos(tilt) / np.where(hit, cos_incidence, 1.0)
    solid = np.sin(th) * np.radians(0.5) * np.radians(7.5)
    # Patch of area rho^2 dOmega / cos, amplitude 2 D^2 / (lambda rho), power falls with the cosine.
    power = piston(ka, th) ** 4 * (2.0 / wavelength_m) ** 2 * solid
    index = ((rho - origin_m) / BIN_M).astype(np.int64)
    keep = hit & (index >= 0) & (index < bins)
    return np.bincount(index[keep], weights=power[keep], minlength=bins).astype(np.float64)


def _location(values: FloatArray, fallback: tuple[float, float]) -> tuple[float, float]:
    """Robust location and scale: median, then a redescending mean around it."""
    if len(values) < 12:
        return fallback
    centre = float(np.median(values))
    scale = max(1.4826 * float(np.median(np.abs(values - centre))), 0.001)
    for _ in range(8):
        weight = 1.0 / (1.0 + ((values - centre) / (2.0 * scale)) ** 2) ** 2
        centre = float(np.sum(weight * values) / np.sum(weight))
    return centre, scale


def _speckle_row(profile: FloatArray, mirror: float, mirror_bin: int, model: DetectorModel, rise_m: float,
                 wavelength_m: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Range bins of first crossings (nan: none) and peak amplitudes of random realisations of one profile."""
    noise = rng.normal(size=(TRIALS, len(profile), 2)) * (model.roughness_m * np.sqrt(profile))[:, None]
    if 0 <= mirror_bin < len(profile):
        phase = rng.uniform(0.0, 2.0 * np.pi, TRIALS)
        noise[:, mirror_bin, 0] += mirror * np.cos(phase)
        noise[:, mirror_bin, 1] += mirror * np.sin(phase)
    burst = round(0.5 * model.cycles * wavelength_m / BIN_M)
    pole = 1.0 - np.exp(-BIN_M / rise_m)
    gain = 1.0 - np.exp(-burst * BIN_M / rise_m)
    bins, peaks = first_crossings(np.ascontiguousarray(noise), burst, pole, model.threshold * gain)
    return bins, peaks / gain


def _speckle(ka: float, wavelength_m: float, rise_m: float, range_m: float, model: DetectorModel
             ) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Tables (tilts, levels + 1) of location and scale, and median amplitudes (tilts,)."""
    rng = np.random.default_rng(20)
    shape = (len(TILTS), len(LEVELS) + 1)
    location, scale, level = np.zeros(shape), np.zeros(shape), np.zeros(len(TILTS))
    origin = 0.55 * range_m
    bins = round(1.3 * range_m / BIN_M)
    for k, tilt in enumerate(TILTS):
        profile = _profile(ka, float(tilt), range_m, wavelength_m, bins, origin)
        mirror = float(piston(ka, np.array([tilt]))[0] ** 2)
        # A strong mirror-like echo is an arrival of its own; only a weak one of the main lobe competes with speckle.
        mirror = mirror if ka * np.sin(tilt) < FIRST_NULL and mirror < 2.0 * model.threshold else 0.0
        mirror_bin = int((range_m * np.cos(tilt) - origin) / BIN_M)
        crossing, peak = _speckle_row(profile, mirror, mirror_bin, model, rise_m, wavelength_m, rng)
        late = origin + crossing * BIN_M - range_m + rise_m * np.log1p(-model.threshold)
        heard = np.isfinite(late)
        whole = _location(late[heard], (0.0, 0.03))
        location[k, -1], scale[k, -1] = whole
        level[k] = float(np.median(peak[heard])) if np.any(heard) else model.threshold
        ratio = np.log(np.maximum(peak, 1e-9) / model.threshold)
        for m in range(len(LEVELS)):
            near = heard & (np.abs(ratio - LEVELS[m]) < 0.2)
            location[k, m], scale[k, m] = _location(late[near], whole)
    return location, scale, level


def _first(impulse: FloatArray, wavelength_m: float, rise_m: float, model: DetectorModel) -> float:
    """First crossing (bins) of a coherent echo, nan where there is none."""
    burst = round(0.5 * model.cycles * wavelength_m / FINE_BIN_M)
    pole = 1.0 - np.exp(-FINE_BIN_M / rise_m)
    gain = 1.0 - np.exp(-burst * FINE_BIN_M / rise_m)
    bins, _ = first_crossings(impulse, burst, pole, model.threshold * gain)
    return float(bins[0])


def _smooth(two_way: FloatArray, wavelength_m: float, rise_m: float, range_m: float, model: DetectorModel,
            optical: bool) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Equivalent amplitudes of mirror-like echoes and of rims over `OFF_AXIS`, from physical optics of a plane."""
    mirror, rim = np.zeros(len(OFF_AXIS)), np.zeros(len(OFF_AXIS))
    if optical:
        return mirror, rim
    # The main lobe only, a little wider than for a far plane: the first Fresnel zone blurs it.
    silent = np.flatnonzero(two_way < model.threshold)
    widest = 1.25 * float(OFF_AXIS[silent[0]]) if len(silent) else float(OFF_AXIS[-1])
    angles = np.linspace(0.0, widest, SMOOTH_ANGLES)
    origin, bins = 0.85 * range_m, round(0.35 * range_m / FINE_BIN_M)
    half = range_m * float(np.tan(min(2.0 * widest + 0.05, 0.9)))
    beam, by_range = Beam(wavelength_m, two_way, float(OFF_AXIS[1])), RangeBins(origin, FINE_BIN_M, bins)
    arguments = (range_m, beam, wavelength_m / 3.5, half, by_range)
    zero = _first(plane_impulse(0.0, -half, *arguments), wavelength_m, rise_m, model)
    found = np.zeros((2, len(angles)))
    for k, angle in enumerate(angles):
        tilted = _first(plane_impulse(float(angle), -half, *arguments), wavelength_m, rise_m, model)
        beside = _first(
            plane_impulse(0.0, range_m * float(np.tan(angle)), *arguments), wavelength_m, rise_m, model
        )  # fmt: skip
        found[0, k] = (tilted - zero) * FINE_BIN_M + range_m * (1.0 - np.cos(angle))
        found[1, k] = (beside - zero) * FINE_BIN_M - range_m * (1.0 / np.cos(angle) - 1.0)
    late = np.maximum(np.nan_to_num(found, nan=np.inf), 0.0)
    amplitude = model.threshold / -np.expm1(np.log1p(-model.threshold) - late / rise_m)
    amplitude = np.where(late < MOST_LATE * rise_m, np.minimum(amplitude, 1.0), 0.0)
    across = 2.0 * np.tan(angles) * np.sqrt(range_m / wavelength_m) / 2.0
    wave = half_plane(across, np.ones(1), 1.0)
    mirror = np.interp(OFF_AXIS, angles, amplitude[0], right=0.0)
    rim = np.interp(OFF_AXIS, angles, amplitude[1] / wave, right=0.0)
    return mirror, rim


def measured(
    location_m: FloatArray, scale_m: FloatArray, spec: SensorSpec, silent_rad: float
) -> tuple[FloatArray, FloatArray]:
    """Speckle tables (tilts, levels + 1) with what the spec's calibration measured on tilted plates.

    Up to `silent_rad` the mirror-like echo is heard first, and the measurement says nothing of the speckle. Beyond, the
    column of unknown amplitude becomes the measured bias and scatter; between and beside the measured tilts its change
    is interpolated and held. The other columns stay: how late an echo of known strength is does not depend on the
    roughness of the surface, which is what a calibration finds out. A sensor that reads on its axis has one column.
    """
    late, optical = spec.late, spec.along_axis
    if late is None:
        return location_m, scale_m
    tilt, bias = np.array(late.tilt_rad), np.array(late.bias_m)
    # The readings' own timing noise is added to every arrival again.
    scatter = np.sqrt(np.maximum(np.array(late.scatter_m) ** 2 - spec.sigma_m**2, LEAST_SCATTER_M**2))
    use = np.ones(len(tilt), dtype=bool) if optical else tilt > silent_rad
    if not np.any(use):
        return location_m, scale_m
    if optical:
        return (
            location_m + np.interp(TILTS, tilt, bias)[:, None],
            np.maximum(scale_m, np.interp(TILTS, tilt, scatter)[:, None]),
        )
    at, own, wide = tilt[use], bias[use], scatter[use]
    shift = own - np.interp(at, TILTS, location_m[:, -1])
    ratio = wide / np.interp(at, TILTS, scale_m[:, -1])
    location, scale = location_m.copy(), scale_m.copy()
    location[:, -1] += np.interp(TILTS, at, shift)
    scale[:, -1] *= np.interp(TILTS, at, ratio)
    return location, scale


@lru_cache(maxsize=32)
def beam_table(spec: SensorSpec, range_mm: int, model: DetectorModel) -> BeamTable:
    """Tabulate one sensor at a typical range; missing frequency or aperture follow from the beam angle.

    `range_mm` is that range in whole millimetres, so that equal ones share their table.
    """
    half = 0.5 * spec.beam_full_angle_rad
    wavelength = SPEED_OF_SOUND_M_S / (spec.frequency_hz or 50e3)
    # Without an aperture: the two-way beam of a piston falls to 1/6 at the capture angle.
    ka = np.pi * spec.aperture_m / wavelength if spec.aperture_m else 2.65 / np.sin(min(half, 1.4))
    rise = model.rise_wavelengths * wavelength
    optical = spec.along_axis
    two_way = piston(ka, OFF_AXIS) ** 2
    range_m = 0.001 * range_mm
    shape = (len(TILTS), len(LEVELS) + 1)
    if optical:
        tables = np.zeros(shape), np.full(shape, spec.sigma_m), np.ones(len(TILTS))
    else:
        tables = _speckle(float(ka), wavelength, rise, range_m, model)
    mirror, rim = _smooth(two_way, wavelength, rise, range_m, model, optical)
    if spec.late is not None:
        silent = float(OFF_AXIS[np.flatnonzero(mirror)[-1]]) if np.any(mirror) else 0.0
        tables = (*measured(tables[0], tables[1], spec, silent), tables[2])
    return BeamTable(
        two_way,
        mirror,
        rim,
        *tables,
        half,
        wavelength,
        model.threshold,
        rise,
        RIM_GRAIN * model.roughness_m / wavelength,
        optical,
        0.0 if optical else model.speed_share,
    )
