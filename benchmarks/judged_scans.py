"""Scans of the judged parts: the array's raster, echoes by the twin or by the independent optics, and noise."""

from __future__ import annotations

import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
from judged_optics import scan_by_optics
from judged_scenes import Array, JudgedScene

from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import Outline, Readings, SensorSpec
from surfuse.runs.scan_log import ScanLog
from surfuse.sensors.polaroid import BARE_SPEC, SPEC
from surfuse.twin.acoustics.noise import AcousticNoise
from surfuse.twin.materials import Material
from surfuse.twin.scene import Scene, SceneBody
from surfuse.twin.world import Twin, TwinParameters

STANDOFF_M, STEP_M, SIDE_M, MARGIN_M = 0.43, 0.01, 0.05, 0.02
# Timing noise (m), bad readings, missing ones, and the spread of the air temperature's error as a share of the range.
NOISE = {"low": (0.0003, 0.01, 0.01, 0.0), "high": (0.001, 0.05, 0.05, 0.0007)}
# The independent optics hears without a tube in front, as in scans of other makers.
OPTICS_SPECS = {
    "tube": replace(SPEC, range_min_m=0.2, range_max_m=1.2, dead_length_m=0.0, incidence_limit_rad=np.pi / 2),
    "wide": replace(SPEC, range_min_m=0.2, range_max_m=1.2, dead_length_m=0.0, incidence_limit_rad=np.pi / 2,
                    beam_full_angle_rad=float(np.radians(26.0)), aperture_m=0.0147),
}  # fmt: skip
TWIN_SPECS = {"tube": SPEC, "wide": replace(BARE_SPEC, range_min_m=0.2)}
# Two readings closer than this come from one place: the twin and the optics are asked once.
SAME_M = 1e-6


def raster(scene: JudgedScene) -> tuple[Array, Array, Array]:
    """Grip poses (M, 4, 4) and rows (M,) over the part, and the places (4 M, 3) of the sensors."""
    turn = np.radians(scene.wrist_deg)
    half_u = scene.half_m[0] / np.cos(turn) + MARGIN_M
    half_v = scene.half_m[1] + MARGIN_M
    count_u, count_v = int(half_u / STEP_M + 1e-6), int(half_v / STEP_M + 1e-6)
    grips, rows = [], []
    turned = rotation_about([0.0, 1.0, 0.0], -turn) @ rotation_about([1.0, 0.0, 0.0], np.pi)
    for j in range(-count_v, count_v + 1):
        line = np.arange(-count_u, count_u + 1) * STEP_M
        for a in line if (j + count_v) % 2 == 0 else line[::-1]:
            place = a * np.array([np.cos(turn), 0.0, np.sin(turn)]) + np.array([0.0, j * STEP_M, 0.0])
            grips.append(pose(turned, place - STANDOFF_M * turned[:, 2]))
            rows.append(j + count_v)
    grip = np.array(grips)
    corner = 0.5 * SIDE_M * np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]])
    places = grip[:, None, :3, 3] + np.einsum("mij,kj->mki", grip[:, :3, :3], corner)
    return grip, np.array(rows), places.reshape(-1, 3)


def scan_by_twin(scene: JudgedScene, position: Array, axis: Array, spec: SensorSpec, seed: int) -> tuple[Array, Array]:
    """Ranges and amplitudes by the project's own twin, without timing noise."""
    vertices, faces = scene.mesh()
    body = SceneBody(vertices, faces, Material.PART, np.eye(4))
    noise = AcousticNoise(timing_m=0.0, dropout=0.0, slip=0.0)
    twin = Twin(Scene([body]), TwinParameters(noise=noise), seed)
    frame = rotation_about([0.0, 1.0, 0.0], -np.radians(scene.wrist_deg)) @ rotation_about([1.0, 0.0, 0.0], np.pi)
    heard = [twin.ping(pose(frame, place), spec, 1, 1e4) for place in position]
    return np.array([r[0] for r, _ in heard]), np.array([a[0] for _, a in heard])


def with_noise(range_m: Array, amplitude: Array, level: str, spec: SensorSpec, rng: np.random.Generator
               ) -> tuple[Array, Array]:  # fmt: skip
    """Timing noise, late echoes and cross-talk, drop-outs, and an error of the speed of sound common to all."""
    sigma, bad, missing, air = NOISE[level]
    n = len(range_m)
    heard = range_m * (1.0 + air * rng.normal()) + rng.normal(size=n) * sigma
    late, cross = heard + 0.005 + rng.exponential(0.06, n), rng.uniform(0.2, 0.8, n)
    wrong = rng.random(n) < bad
    heard = np.where(wrong, np.where(rng.random(n) < 0.5, late, cross), heard)
    heard[rng.random(n) < missing] = np.inf
    heard[~((heard > spec.range_min_m) & (heard < spec.range_max_m))] = np.inf
    return heard, np.where(np.isfinite(heard), amplitude, np.nan)


def echoes(scene: JudgedScene, maker: str, where: Array, towards: Array, spec: SensorSpec, seed: int
           ) -> tuple[Array, Array]:  # fmt: skip
    """Ranges and amplitudes without noise, by the twin or by the independent optics."""
    if maker == "twin":
        return scan_by_twin(scene, where, towards, spec, seed)
    assert spec.aperture_m is not None
    return scan_by_optics(scene, where, towards, spec.aperture_m, seed)


def scan(scene: JudgedScene, maker: str, beam: str, level: str, seed: int, keep: Path | None = None) -> ScanLog:
    """One scan, as a log with sensors, frame and outline would be read. `maker`: twin or optics."""
    grip, rows, places = raster(scene)
    axis = np.repeat(grip[:, :3, 2], 4, axis=0)
    single, back = np.unique(np.round(places / SAME_M).astype(np.int64), axis=0, return_inverse=True)
    where, towards = single * SAME_M, np.tile(axis[0], (len(single), 1))
    spec = replace((TWIN_SPECS if maker == "twin" else OPTICS_SPECS)[beam], sigma_m=NOISE[level][0])
    kept = keep / f"{scene.name}-{scene.half_m}-{maker}-{beam}-{seed}.npy" if keep else None
    if kept is not None and kept.is_file():
        range_m, amplitude = np.load(kept)
    else:
        range_m, amplitude = echoes(scene, maker, where, towards, spec, seed)
        if kept is not None:
            np.save(kept, np.array([range_m, amplitude]))
    rng = np.random.default_rng([seed, zlib.crc32(f"{scene.name}{maker}{beam}{level}".encode())])
    range_m, amplitude = with_noise(range_m[back.ravel()], amplitude[back.ravel()], level, spec, rng)
    m = len(grip)
    specs = tuple(replace(spec, name=f"us{k}") for k in range(4))
    readings = Readings(
        specs=specs, t_s=np.arange(4 * m) * 0.05, sensor=np.tile(np.arange(4), m), position_m=places, axis=axis,
        range_m=range_m, status=np.where(np.isfinite(range_m), 0, 1), amplitude=amplitude,
        sigma_m=np.full(4 * m, np.nan), count=np.ones(4 * m, dtype=np.int64), start=np.arange(m + 1) * 4,
        stop=np.arange(m), row=rows, world_from_grip=grip,
    )  # fmt: skip
    return ScanLog(readings, np.eye(4), False, Outline(scene.outline(), np.eye(4)))
