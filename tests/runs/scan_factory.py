"""Small scans made up for the tests of the run folder: sweeps with every kind of reading, scene, plan, camera frame."""

from __future__ import annotations

import numpy as np

from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import (
    CameraFrame,
    CameraModel,
    FusionScene,
    LateTable,
    Outline,
    ScanPlan,
    SensorSpec,
    SkippedStop,
    Status,
    Sweep,
)

SPECS = tuple(
    SensorSpec(
        name=name,
        kind="ultrasonic",
        range_min_m=0.25,
        range_max_m=1.2,
        beam_full_angle_rad=0.3,
        sigma_m=0.001,
        frequency_hz=63000.0 if i else None,
        aperture_m=None if i else 0.04,
        incidence_limit_rad=0.4 + i / 7,
        firing_time_s=0.06,
        dead_length_m=i / 13,
        late=LateTable((0.0, 1 / 3), (-1e-17, 0.1 / 3), (0.0, 1e-3)) if i % 2 else None,
    )
    for i, name in enumerate(("us0", "us 1", "us-1", "links oben"))
)
_ODD = {Status.NO_ECHO: np.inf, Status.TOO_CLOSE: -np.inf, Status.FAULT: np.nan}


def outline(margin_m: float = 0.0) -> Outline:
    return Outline(
        vertices_m=[[-0.1 / 3, 0.0], [0.1, 1e-17], [0.1, 0.2], [-0.1, np.pi / 15]],
        world_from_part=pose(rotation_about([1, 2, 3], 0.3), [1.1, 0.0, 1.0]),
        margin_m=margin_m,
        viewpoint_m=None if margin_m else [0.1, 1 / 3, 1.7],
        sigma_m=[0.001, 0.002, 0.003, 1 / 3],
        holes_m=(np.array([[0.0, 0.1], [0.01, 0.1], [0.0, 0.11]]), np.array([[0.05, 0.1], [0.06, 0.1], [0.05, 0.12]])),
    )


def scene() -> FusionScene:
    return FusionScene(
        specs=SPECS, world_from_part=outline().world_from_part, outline=outline(), depth_max_m=float("inf")
    )


def plan(stops: int = 6) -> ScanPlan:
    rng = np.random.default_rng(8)
    grips = np.array([pose(rotation_about(rng.normal(size=3), 1.0), rng.normal(size=3)) for _ in range(stops)])
    return ScanPlan(
        world_from_grip=grips,
        uv_m=rng.normal(size=(stops, 2)),
        row=np.arange(stops) // 3,
        joints_rad=rng.normal(size=(stops, 6)),
        outline=outline(0.02),
        step_m=0.01,
        standoff_m=0.43,
        skipped=(SkippedStop(0.1, 0.2, "out of reach: 1,02 m > 0.86 m"), SkippedStop(1 / 3, -0.2, "")),
    )


def frame(seed: int = 4) -> CameraFrame:
    rng = np.random.default_rng(seed)
    camera = CameraModel(50, 58, 600.1, 700.2, 25.3, 29.4, (0.1, -0.02, 1e-3, 2e-4, 1 / 3))
    return CameraFrame(
        image=rng.integers(0, 256, (58, 50), dtype=np.uint8),
        t_s=1 / 3,
        camera=camera,
        world_from_camera=pose(rotation_about(rng.normal(size=3), 1.0), rng.normal(size=3)),
    )


def sweep(stop: int, seed: int = 0) -> Sweep:
    rng = np.random.default_rng([seed, stop])
    used = np.flatnonzero(rng.uniform(size=4) < 0.9)
    s = len(used)
    axis = rng.normal(size=(s, 3))
    status = rng.integers(0, 4, s)
    ranges = rng.uniform(0.3, 1.0, s)
    for kind, value in _ODD.items():
        ranges[status == int(kind)] = value
    return Sweep(
        stop=stop,
        row=stop // 10,
        world_from_grip=pose(rotation_about(rng.normal(size=3), 1.0), rng.normal(size=3)),
        t_s=0.7 * stop + 0.05 * np.arange(s),
        sensor=used,
        position_m=rng.normal(size=(s, 3)),
        axis=axis / np.linalg.norm(axis, axis=1, keepdims=True),
        range_m=ranges,
        status=status,
        amplitude=np.where(rng.uniform(size=s) < 0.5, np.nan, rng.uniform(size=s)),
        spread_m=np.where(rng.uniform(size=s) < 0.5, np.nan, rng.uniform(size=s)),
        count=rng.integers(0, 9, s),
        joints_rad=rng.normal(size=6),
        sigma_m=np.where(rng.uniform(size=s) < 0.5, np.nan, rng.uniform(size=s)),
    )


def same(a: object, b: object) -> bool:
    """Equality of records to the last bit; nan equals nan."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, n), getattr(b, n)) for n in a.__dataclass_fields__)
    return a == b or (a != a and b != b)
