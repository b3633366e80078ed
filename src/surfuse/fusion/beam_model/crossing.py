"""First crossing of a threshold by the envelope of a burst echo."""

from __future__ import annotations

import numpy as np

from surfuse.geometry.compiled import compiled
from surfuse.records import FloatArray


@compiled
def first_crossings(impulse: FloatArray, burst: int, pole: float, threshold: float) -> tuple[FloatArray, FloatArray]:
    """First crossing (in bins, fractional; nan: none) and peak of the filtered envelope of each row.

    `impulse` (K, B, 2) complex echo by range bin; the burst is a boxcar of `burst` bins, the transducer a single pole.
    """
    rows, bins, _ = impulse.shape
    crossing = np.full(rows, np.nan)
    peak = np.zeros(rows)
    for k in range(rows):
        box_re = box_im = re = im = last = 0.0
        for b in range(bins):
            box_re += impulse[k, b, 0]
            box_im += impulse[k, b, 1]
            if b >= burst:
                box_re -= impulse[k, b - burst, 0]
                box_im -= impulse[k, b - burst, 1]
            re += pole * (box_re - re)
            im += pole * (box_im - im)
            envelope = np.sqrt(re * re + im * im)
            if envelope >= threshold and np.isnan(crossing[k]):
                crossing[k] = b + (threshold - last) / (envelope - last)
            peak[k] = max(peak[k], envelope)
            last = envelope
    return crossing, peak
