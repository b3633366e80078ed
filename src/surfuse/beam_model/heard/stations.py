"""From readings to stations: part frame, repeats merged, spikes and lying sensors set aside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from surfuse.records import BoolArray, FloatArray, FusionScene, IntArray, LateTable, Readings, SensorSpec, Status

SAME_PLACE_M = 0.0015
SAME_AXIS = 0.01
# Neighbours among which one beside the nearest is looked for, how far off its direction (cosine), and from which ratio
# of the two distances on the points lie on lines.
AROUND = 40
SIDEWAYS = 0.7
LINES = 2.0
AGREEMENT_SIGMAS = 4.0
AGREEMENT_FLOOR_M = 0.002
TORN_SHARE = 0.3
# A surface steeper than this between neighbours is a step, not a slope.
STEEPEST = 1.5


@dataclass(frozen=True)
class Stations:
    """Places from which the surface was heard, in the part frame: M rows.

    `position_m`, `axis` (M, 3); `range_m`, `sigma_m` of the merged range; `amplitude` (nan: unknown); `spec` index of
    the sensor kind; `count` readings merged; `of_reading` (N,) the station of each reading (-1: rejected).

    Positions are where the beam begins: at the mouth of a tube, from where the ranges count.
    """

    position_m: FloatArray
    axis: FloatArray
    range_m: FloatArray
    sigma_m: FloatArray
    amplitude: FloatArray
    spec: IntArray
    count: IntArray
    of_reading: IntArray

    def __len__(self) -> int:
        return len(self.range_m)

    @property
    def foot_m(self) -> FloatArray:
        """Own-axis points (M, 3): where the axis is at the measured range."""
        return self.position_m + self.axis * self.range_m[:, None]

    def select(self, keep: BoolArray) -> Stations:
        """The stations marked by `keep` (M,); readings of the others become rejected."""
        renumber = np.where(keep, np.cumsum(keep) - 1, -1)
        of_reading = np.where(self.of_reading >= 0, renumber[self.of_reading], -1) if len(keep) else self.of_reading
        return Stations(
            self.position_m[keep], self.axis[keep], self.range_m[keep], self.sigma_m[keep], self.amplitude[keep],
            self.spec[keep], self.count[keep], of_reading,
        )  # fmt: skip


Kind = tuple[str, float, float | None, float | None, LateTable | None]


def _kind(spec: SensorSpec) -> Kind:
    return (spec.kind, spec.beam_full_angle_rad, spec.frequency_hz, spec.aperture_m, spec.late)


def kinds(specs: tuple[SensorSpec, ...]) -> tuple[SensorSpec, ...]:
    """One spec for each kind of sensor (same beam and waves), in the order in which they come."""
    return tuple({_kind(spec): spec for spec in reversed(specs)}[kind] for kind in dict.fromkeys(map(_kind, specs)))


def usable(readings: Readings, scene: FusionScene) -> BoolArray:
    """Readings (N,) with an echo inside the limits of their sensor, looking at the front of the part."""
    low = np.array([spec.range_min_m for spec in readings.specs])[readings.sensor]
    high = np.array([spec.range_max_m for spec in readings.specs])[readings.sensor]
    towards = readings.axis @ scene.world_from_part[:3, 2]
    finite = np.isfinite(readings.range_m) & np.all(np.isfinite(readings.position_m), axis=1)
    with np.errstate(invalid="ignore"):
        inside = (readings.range_m >= low) & (readings.range_m <= np.minimum(high, scene.depth_max_m))
        return np.asarray((readings.status == Status.OK) & finite & inside & (towards < -0.1), dtype=np.bool_)


def _groups(position: FloatArray, axis: FloatArray, spec: IntArray) -> IntArray:
    """Number (N,) of the place and direction that readings share."""
    columns = [np.round(position / SAME_PLACE_M), np.round(axis / SAME_AXIS), spec[:, None]]
    key = np.column_stack(columns).astype(np.int64)
    _, group = np.unique(key, axis=0, return_inverse=True)
    return np.asarray(group.ravel(), dtype=np.int64)


def _lying(sensor: IntArray, agrees: BoolArray, judged: BoolArray, sensors: int) -> BoolArray:
    """Which sensors (S,) disagree with the others at most of the places that they share."""
    shared = np.bincount(sensor[judged], minlength=sensors)
    wrong = np.bincount(sensor[judged & ~agrees], minlength=sensors)
    return (shared >= 8) & (wrong > 0.6 * shared)


def _agreement(group: IntArray, range_m: FloatArray, sigma: FloatArray) -> tuple[BoolArray, IntArray, FloatArray]:
    """Whether a reading agrees with the median of its group (N,), the size of each group, and that median (N,)."""
    order = np.lexsort((range_m, group))
    size = np.bincount(group)
    first = np.concatenate([[0], np.cumsum(size)[:-1]])
    ordered = range_m[order]
    median = 0.5 * (ordered[first + (size - 1) // 2] + ordered[first + size // 2])
    tolerance = np.maximum(AGREEMENT_SIGMAS * sigma, AGREEMENT_FLOOR_M)
    return np.abs(range_m - median[group]) <= tolerance, size, median[group]


def stated_sigma(readings: Readings, rows: IntArray) -> FloatArray:
    """Standard deviation (m) of some readings: their own where the log states one, else that of their sensor.

    `rows` (N,) are indices of readings; the result (N,) goes with them.
    """
    own = readings.sigma_m[rows]
    of_sensor = np.array([spec.sigma_m for spec in readings.specs])[readings.sensor[rows]]
    return np.where((own > 0.0) & np.isfinite(own), own, of_sensor)


@dataclass(frozen=True)
class _Heard:
    """The usable readings `row` (N,) of a scan, as columns (N,), in the part frame.

    `position_m`, `axis` (N, 3): the beam begins at the mouth of the tube, and `range_m` counts from there. `spec` is
    the index of the sensor kind. `sigma_m` of a reading, `sensor` its number.
    """

    row: IntArray
    position_m: FloatArray
    axis: FloatArray
    range_m: FloatArray
    sigma_m: FloatArray
    amplitude: FloatArray
    sensor: IntArray
    spec: IntArray


def _in_part_frame(readings: Readings, scene: FusionScene) -> _Heard:
    """The readings that count, seen from the part."""
    rows = np.nonzero(usable(readings, scene))[0]
    part = scene.world_from_part
    position = (readings.position_m[rows] - part[:3, 3]) @ part[:3, :3]
    axis = readings.axis[rows] @ part[:3, :3]
    axis = axis / np.maximum(np.linalg.norm(axis, axis=1), 1e-12)[:, None]
    sensor = readings.sensor[rows]
    # The beam starts at the mouth of the tube; the range counts from the transducer behind it.
    dead = np.array([spec.dead_length_m for spec in readings.specs])[sensor]
    number = {_kind(k): n for n, k in enumerate(kinds(readings.specs))}
    kind_of = np.array([number[_kind(k)] for k in readings.specs], dtype=np.int64)
    return _Heard(
        row=rows,
        position_m=position + dead[:, None] * axis,
        axis=axis,
        range_m=readings.range_m[rows] - dead,
        sigma_m=stated_sigma(readings, rows),
        amplitude=readings.amplitude[rows],
        sensor=sensor,
        spec=kind_of[sensor],
    )


def _believed(heard: _Heard, sensors: int) -> tuple[IntArray, BoolArray, FloatArray]:
    """Place of each reading (N,), whether it is believed (N,), and its sigma (N,) in m, larger at a torn place."""
    sensor, range_m, sigma = heard.sensor, heard.range_m, heard.sigma_m
    group = _groups(heard.position_m, heard.axis, heard.spec)
    agrees, size, median = _agreement(group, range_m, sigma)
    # Where only two meet and disagree, neither is believed more: both stay, as places of their own. So do all at a
    # place where the median has no follower (two against two), when that is no accident but the rule.
    followers = np.bincount(group, weights=agrees, minlength=len(size))
    torn = (followers[group] == 0) & (size[group] >= 3)
    if np.count_nonzero(torn) <= TORN_SHARE * np.count_nonzero(size[group] >= 3):
        torn[:] = False
    sigma = np.where(torn, np.maximum(sigma, np.abs(range_m - median)), sigma)
    pair = ((size[group] == 2) & ~agrees) | torn
    lying = _lying(sensor, agrees, (size[group] >= 3) & ~pair, sensors)
    keep = (agrees | pair) & ~lying[sensor]
    return np.where(pair, group.max(initial=0) + 1 + np.arange(len(group)), group), keep, sigma


def gather(readings: Readings, scene: FusionScene) -> Stations:
    """Merge repeats from one place by the mean of those that agree with their median, the better ones counting more.

    A mean is weighted by the inverse variances. Sensors that disagree with the others at most of the places which they
    share are left out whole. Without a usable reading there are no stations.
    """
    heard = _in_part_frame(readings, scene)
    group, keep, sigma = _believed(heard, len(readings.specs))
    of_reading = np.full(len(readings.range_m), -1, dtype=np.int64)
    names, station = np.unique(group[keep], return_inverse=True)
    of_reading[heard.row[keep]] = station
    count = np.bincount(station, minlength=len(names))
    # Inverse variances relative to the best reading of a station: equal readings have the weight 1 to the last bit.
    finest = np.full(len(names), np.inf)
    np.minimum.at(finest, station, sigma[keep])
    weight = (finest[station] / sigma[keep]) ** 2
    total = np.maximum(np.bincount(station, weights=weight, minlength=len(names)), 1.0)

    def mean(values: FloatArray) -> FloatArray:
        return np.bincount(station, weights=weight * values[keep], minlength=len(names)) / total

    first = np.zeros(len(names), dtype=np.int64)
    first[station[::-1]] = np.nonzero(keep)[0][::-1]
    return Stations(
        position_m=np.column_stack([mean(heard.position_m[:, k]) for k in range(3)]),
        axis=heard.axis[first],
        range_m=mean(heard.range_m),
        sigma_m=mean(sigma) / np.sqrt(total),
        amplitude=mean(heard.amplitude),
        spec=heard.spec[first] if len(names) else np.zeros(0, dtype=np.int64),
        count=count,
        of_reading=of_reading,
    )


def spacing(stations: Stations) -> float:
    """Typical distance (m) between neighbouring own-axis points across the part (nan: fewer than two).

    Where points are dense along lines but the lines are far apart (the array fired while it moved), it is the distance
    of the lines: no closer neighbour says how the surface runs across them.
    """
    if len(stations) < 2:
        return float("nan")
    foot = stations.foot_m[:, :2]
    unique = np.unique(np.round(foot, 4), axis=0)
    if len(unique) < 2:
        return float("nan")
    distance, index = cKDTree(unique).query(unique, k=min(len(unique), 1 + AROUND))
    nearest = float(np.median(distance[:, 1]))
    apart = unique[index] - unique[:, None]
    along = np.abs(np.einsum("nkc,nc->nk", apart, apart[:, 1])) / np.maximum(distance * distance[:, 1:2], 1e-12)
    beside = np.where(along < SIDEWAYS, distance, np.inf)
    beside[:, 0] = np.inf
    across = np.min(beside, axis=1)
    found = np.isfinite(across)
    if np.mean(found) < 0.5:
        return nearest
    lines = float(np.median(across[found]))
    return lines if lines > LINES * nearest else nearest


def isolated(stations: Stations, step_m: float) -> BoolArray:
    """Stations (M,) that no neighbour supports: fewer than two of the eight nearest lie on a possible slope.

    A place with fewer than four neighbours within three steps is not judged.
    """
    if len(stations) < 9:
        return np.zeros(len(stations), dtype=bool)
    foot = stations.foot_m
    reach = 3.0 * step_m
    # The beam, not the axis, was there: neighbours are found where the sensor stood, so that a spike cannot hide.
    middle = stations.position_m + stations.axis * np.median(stations.range_m)
    distance, index = cKDTree(middle[:, :2]).query(middle[:, :2], k=9, distance_upper_bound=reach)
    near = np.isfinite(distance[:, 1:])
    other = np.where(near, index[:, 1:], 0)
    rise = np.abs(foot[other, 2] - foot[:, None, 2])
    noise = np.hypot(stations.sigma_m[other], stations.sigma_m[:, None])
    supported = near & (rise <= STEEPEST * 0.5 * distance[:, 1:].clip(max=reach) + 4.0 * noise + 0.002)
    return np.asarray((near.sum(axis=1) >= 4) & (supported.sum(axis=1) < 2), dtype=np.bool_)
