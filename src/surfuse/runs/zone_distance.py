"""Whether zones measure along their own direction or perpendicular to their chip: what sensors.toml says, and the data.

Read the wrong way, a plane seen by all zones at once becomes a bowl that moves with the chip: places that several zones
saw no longer agree. The reading of the numbers that leaves clearly less scatter about local planes is right.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from surfuse.records import FloatArray, IntArray
from surfuse.runs.range_correction import ALONG, PERPENDICULAR, RangeCorrection

# Readings that are looked at, neighbours that a plane is laid through, and how much less scatter is clear.
MOST, NEIGHBOURS = 3000, 24
LEAST = 200
CLEARLY = 0.75


def contradicted(
    position_m: FloatArray, axis: FloatArray, range_m: FloatArray, sensor: IntArray,
    corrections: Sequence[RangeCorrection],
) -> list[str]:  # fmt: skip
    """A warning where the other reading of the numbers of zones fits much better; without zones there is none.

    `position_m`, `axis` (N, 3), `range_m`, `sensor` (N,) of readings as they are in the log.
    """
    off = np.array([one.off_axis_rad for one in corrections])
    told = [one for one in corrections if one.off_axis_rad > 0.0]
    rows = np.flatnonzero(np.isfinite(range_m) & np.isin(sensor, np.flatnonzero(off > 0.0)))
    if not told or len(rows) < LEAST:
        return []
    rows = rows[:: max(1, -(-len(rows) // MOST))]
    offset = np.array([one.offset_m for one in corrections])[sensor[rows]]
    along = range_m[rows] * np.array([one.scale for one in corrections])[sensor[rows]] + offset
    left = {
        ALONG: _scatter(position_m[rows] + axis[rows] * along[:, None]),
        PERPENDICULAR: _scatter(position_m[rows] + axis[rows] * (along / np.cos(off[sensor[rows]]))[:, None]),
    }
    said = PERPENDICULAR if told[0].perpendicular else ALONG
    other = ALONG if told[0].perpendicular else PERPENDICULAR
    if left[other] >= CLEARLY * left[said]:
        return []
    return [
        f'the zones are said to measure distance = "{said}" and scatter by {1e3 * left[said]:.1f} mm; as "{other}" '
        f'they scatter by {1e3 * left[other]:.1f} mm: write distance = "{other}" in sensors.toml'
    ]


def _scatter(point_m: FloatArray) -> float:
    """Median distance (m) of points (N, 3) from the plane through their neighbours."""
    _, near = cKDTree(point_m).query(point_m, k=min(NEIGHBOURS, len(point_m)))
    group = point_m[near] - point_m[near].mean(axis=1, keepdims=True)
    _, vector = np.linalg.eigh(np.einsum("nki,nkj->nij", group, group))
    return float(np.median(np.abs(np.einsum("ni,ni->n", group[:, 0], vector[:, :, 0]))))
