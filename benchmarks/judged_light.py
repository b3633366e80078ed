"""An independent maker of time-of-flight readings: rays through the solid angle of each zone, shared with no method.

A zone returns the mean of the ranges over its solid angle, each direction weighted by cos(incidence) / range^2
(Lambert). The chip adds an offset that all zones share, one of each zone, noise, and outliers that come late.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from judged_scans import NOISE, OPTICS_SPECS, echoes, raster, with_noise
from judged_scenes import Array, JudgedScene

from surfuse.records import Outline, Readings, SensorSpec
from surfuse.runs.scan_log import ScanLog

SIDE, FIELD_RAD = 4, np.radians(45.0)
RAYS = 5
STEPS, BEHIND_M = 400, 0.12


@dataclass(frozen=True)
class Chip:
    """What a time-of-flight chip adds to the mean over a zone: lengths in m, shares of readings."""

    sigma_m: float = 0.004
    offset_m: float = 0.004
    zone_m: float = 0.002
    outliers: float = 0.03
    missing: float = 0.02


def towards(side: int = SIDE, field_rad: float = FIELD_RAD) -> Array:
    """Unit axes (side^2, 3) of the zones in the frame of the chip, z forward."""
    t = np.tan((np.arange(side) - (side - 1) / 2.0) * field_rad / side)
    a, b = np.meshgrid(t, t)
    axes = np.column_stack([a.ravel(), b.ravel(), np.ones(side * side)])
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def cast(scene: JudgedScene, origin: Array, ray: Array) -> tuple[Array, Array]:
    """Range (N,) at which rays first pass below the part (inf: never), and the cosine of incidence there."""
    low, high = 0.2, 0.8
    step = (high - low) / STEPS
    before = np.full(len(ray), np.inf)
    last = np.full(len(ray), np.nan)
    for k in range(STEPS + 1):
        t = low + k * step
        at = origin + t * ray
        above = at[:, 2] - np.where(scene.within(at[:, 0], at[:, 1]), scene.height(at[:, 0], at[:, 1]), -BEHIND_M)
        crossed = (above <= 0.0) & ~np.isfinite(before)
        share = np.where(last > 0.0, last / np.maximum(last - above, 1e-12), 1.0)
        before = np.where(crossed, t - step * (1.0 - share), before)
        last = above
    at = origin + np.where(np.isfinite(before), before, 0.0)[:, None] * ray
    e = 1e-4
    gu = (scene.height(at[:, 0] + e, at[:, 1]) - scene.height(at[:, 0] - e, at[:, 1])) / (2.0 * e)
    gv = (scene.height(at[:, 0], at[:, 1] + e) - scene.height(at[:, 0], at[:, 1] - e)) / (2.0 * e)
    gu, gv = np.clip(gu, -3.0, 3.0), np.clip(gv, -3.0, 3.0)
    cosine = (gu * ray[:, 0] + gv * ray[:, 1] - ray[:, 2]) / np.sqrt(1.0 + gu**2 + gv**2)
    # What lies beside the part is black cloth far below: it answers nothing.
    on = np.isfinite(before) & scene.within(at[:, 0], at[:, 1])
    return np.where(on, before, np.inf), np.clip(cosine, 0.02, 1.0)


def zone_means(scene: JudgedScene, origin: Array, axis: Array, half_rad: float) -> Array:
    """Mean range (N,) of each zone over a cone about its axis, inf where less than half of it meets the part."""
    helper = np.where(np.abs(axis[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(axis, helper)
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(axis, first)
    side = np.tan(half_rad) * np.linspace(-1.0, 1.0, RAYS)
    weight, moment, met, rays = np.zeros(len(axis)), np.zeros(len(axis)), np.zeros(len(axis)), 0
    for a in side:
        for b in side:
            if np.hypot(a, b) > 1.01 * np.tan(half_rad):
                continue
            ray = axis + a * first + b * second
            ray = ray / np.linalg.norm(ray, axis=1, keepdims=True)
            r, cosine = cast(scene, origin, ray)
            on = np.isfinite(r)
            w = np.where(on, cosine / np.where(on, r, 1.0) ** 2, 0.0)
            weight += w
            moment += w * np.where(on, r, 0.0)
            met += on
            rays += 1
    return np.where(met >= 0.5 * rays, moment / np.maximum(weight, 1e-12), np.inf)


def light_log(scene: JudgedScene, chip: Chip, seed: int, stated_m: float | None = None, sound: bool = True,
              light: bool = True) -> ScanLog:  # fmt: skip
    """One scan by four ultrasonic sensors and a chip of 4 x 4 zones in their middle, or by one of the two.

    The readings of a rig with both are those of the rigs with one: the same seed gives the same noise.
    """
    grip, rows, places = raster(scene)
    m = len(grip)
    specs: list[SensorSpec] = []
    parts: list[tuple[Array, Array, Array, Array]] = []
    if sound:
        spec = replace(OPTICS_SPECS["tube"], sigma_m=NOISE["low"][0])
        axis = np.repeat(grip[:, :3, 2], 4, axis=0)
        single, back = np.unique(np.round(places / 1e-6).astype(np.int64), axis=0, return_inverse=True)
        heard, loud = echoes(scene, "optics", single * 1e-6, np.tile(axis[0], (len(single), 1)), spec, seed)
        rng = np.random.default_rng([seed, 1])
        heard, loud = with_noise(heard[back.ravel()], loud[back.ravel()], "low", spec, rng)
        specs += [replace(spec, name=f"us{k}") for k in range(4)]
        parts.append((places.reshape(m, 4, 3), axis.reshape(m, 4, 3), heard.reshape(m, 4), loud.reshape(m, 4)))
    if light:
        rng = np.random.default_rng([seed, 2])
        zones = towards()
        half = 0.5 * float(FIELD_RAD) / SIDE
        axis = np.einsum("mij,zj->mzi", grip[:, :3, :3], zones)
        origin = np.repeat(grip[:, None, :3, 3], len(zones), axis=1)
        mean = zone_means(scene, origin.reshape(-1, 3), axis.reshape(-1, 3), half).reshape(m, -1)
        mean = mean + chip.offset_m * rng.normal() + chip.zone_m * rng.normal(size=len(zones))
        mean = mean + chip.sigma_m * rng.normal(size=mean.shape)
        wrong = rng.random(mean.shape) < chip.outliers
        mean = np.where(wrong, mean + rng.exponential(0.05, mean.shape), mean)
        mean = np.where(rng.random(mean.shape) < chip.missing, np.inf, mean)
        sigma = chip.sigma_m if stated_m is None else stated_m
        specs += [SensorSpec(f"zone{k:02d}", "tof", 0.02, 2.0, 2.0 * half, sigma) for k in range(len(zones))]
        parts.append((origin, axis, mean, np.full(mean.shape, np.nan)))
    where, axes, ranges, loud = (np.concatenate([p[k] for p in parts], axis=1) for k in range(4))
    count = len(specs)
    range_m = ranges.ravel()
    readings = Readings(
        specs=tuple(specs), t_s=np.arange(count * m) * 0.01, sensor=np.tile(np.arange(count), m),
        position_m=where.reshape(-1, 3), axis=axes.reshape(-1, 3), range_m=range_m,
        status=np.where(np.isfinite(range_m), 0, 1), amplitude=loud.ravel(), sigma_m=np.full(count * m, np.nan),
        count=np.ones(count * m, dtype=np.int64), start=np.arange(m + 1) * count, stop=np.arange(m), row=rows,
        world_from_grip=grip,
    )  # fmt: skip
    return ScanLog(readings, np.eye(4), False, Outline(scene.outline(), np.eye(4)))
