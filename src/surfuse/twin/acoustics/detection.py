"""From arrivals to readings: the received envelope, and when it first reaches the detection level."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray, IntArray

_PEAK_STRIDE = 4


def burst_envelope(burst_s: float, rise_time_s: float, step_s: float) -> FloatArray:
    """Envelope (W,) of one echo in even steps: a rectangular burst through two first-order delays.

    Transducer and receiver each delay the envelope once, so that it rises as 1 - (1 + x) exp(-x), x = t / rise time,
    and decays likewise after the burst. W covers the burst and six rise times; 1 is what a long burst reaches.
    """
    samples = int(np.ceil((burst_s + 6.0 * rise_time_s) / step_s)) + 1
    time: FloatArray = step_s * np.arange(samples, dtype=np.float64)

    def rise(t: FloatArray) -> FloatArray:
        x = np.maximum(t, 0.0) / rise_time_s
        return np.asarray(1.0 - (1.0 + x) * np.exp(-x), dtype=np.float64)

    return rise(time) - rise(np.asarray(time - burst_s))


class Received(NamedTuple):
    """Energies and complex amplitudes by bin (B,), their used span (2,), the shape of one echo (W,) and its square.

    `mirror` are energies, `real` and `imag` complex amplitudes, `extent` is the first and the last bin in use; `shape2`
    is `shape` squared.
    """

    mirror: FloatArray
    real: FloatArray
    imag: FloatArray
    extent: IntArray
    shape: FloatArray
    shape2: FloatArray


class Detector(NamedTuple):
    """Detection level and the transducer's own ringing at each bin (B,), and the bin at which the detector opens."""

    level: FloatArray
    ringing: FloatArray
    opens: int


@compiled
def envelope_at(k: int, received: Received) -> float:
    """Received envelope at bin k: mirror-like parts add as energies, the diffuse part as amplitudes.

    Formula: sqrt(sum energy shape^2 + |sum amplitude shape|^2), the sums over all bins whose echo still lasts at bin k.
    """
    shape, shape2, extent = received.shape, received.shape2, received.extent
    mirror, real, imag = received.mirror, received.real, received.imag
    energy, x, y = 0.0, 0.0, 0.0
    first = max(extent[0], k - len(shape) + 1)
    last = min(extent[1], k)
    for b in range(first, last + 1):
        energy += mirror[b] * shape2[k - b]
        x += real[b] * shape[k - b]
        y += imag[b] * shape[k - b]
    return float(np.sqrt(energy + x * x + y * y))


@compiled
def detect(received: Received, detector: Detector, scale: FloatArray, shift: FloatArray, crossing: FloatArray) -> float:
    """First crossing of the detection level for each of P pings; returns the peak of the envelope after it.

    Ping p sees the envelope times `scale[p]` plus `shift[p]`. `crossing` (P,) receives the place in bins between
    samples; inf for none, -inf when the level is already reached as the detector opens.

    `scale` and `shift` (P,) in units of the envelope of a facing plate; the detector opens at the bin `detector.opens`.
    """
    level, ringing, opens = detector.level, detector.ringing, detector.opens
    mirror, real, imag, extent = received.mirror, received.real, received.imag, received.extent
    waiting, width = len(crossing), len(received.shape)
    strongest, offset = 0.0, -np.inf
    for p in range(len(crossing)):
        crossing[p] = np.inf
        strongest, offset = max(strongest, scale[p]), max(offset, shift[p])
    sum_energy, sum_amplitude = 0.0, 0.0
    before, before_known, found = 0.0, False, -1
    # Window sums bound the envelope from above, so that silent stretches cost one addition a bin.
    begin = opens if ringing[opens] > 0.0 else max(opens, extent[0])
    for b in range(max(extent[0], begin - width + 1), min(begin, extent[1] + 1)):
        sum_energy += mirror[b]
        sum_amplitude += np.hypot(real[b], imag[b])
    for k in range(begin, min(len(level) - 1, extent[1] + width) + 1):
        if extent[0] <= k <= extent[1]:
            sum_energy += mirror[k]
            sum_amplitude += np.hypot(real[k], imag[k])
        gone = k - width
        if extent[0] <= gone <= extent[1]:
            sum_energy -= mirror[gone]
            sum_amplitude -= np.hypot(real[gone], imag[gone])
        bound = np.sqrt(max(sum_energy, 0.0)) + max(sum_amplitude, 0.0) + ringing[k]
        if bound * strongest * 1.000001 + offset < level[k]:
            before_known = False
            continue
        now = np.hypot(envelope_at(k, received), ringing[k])
        if k > opens and not before_known:
            before = np.hypot(envelope_at(k - 1, received), ringing[k - 1])
        crossed, heard = _cross(k, before, now, detector, scale, shift, crossing)
        waiting -= crossed
        if heard and found < 0:
            found = k
        before, before_known = now, True
        if waiting == 0:
            break
    return peak_after(found, received)


@compiled
def _cross(
    k: int,
    before: float,
    now: float,
    detector: Detector,
    scale: FloatArray,
    shift: FloatArray,
    crossing: FloatArray,
) -> tuple[int, bool]:
    """Note the pings that cross the level at bin k; returns how many, and whether the detector heard them begin."""
    level, crossed, heard = detector.level, 0, False
    for p in range(len(crossing)):
        if crossing[p] != np.inf:
            continue
        above = now * scale[p] + shift[p] - level[k]
        if above < 0.0:
            continue
        crossed += 1
        if k == detector.opens:
            crossing[p] = -np.inf
            continue
        below = before * scale[p] + shift[p] - level[k - 1]
        # A step of the gain lifts the whole envelope at once: the crossing then is at the step.
        crossing[p] = k if below >= 0.0 or above == below else k - above / (above - below)
        heard = True
    return crossed, heard


@compiled
def peak_after(found: int, received: Received) -> float:
    """Largest envelope within one burst after a detection at bin `found`; nan when there was none."""
    if found < 0:
        return float(np.nan)
    peak = 0.0
    for k in range(found, found + len(received.shape), _PEAK_STRIDE):
        peak = max(peak, envelope_at(k, received))
    return peak
