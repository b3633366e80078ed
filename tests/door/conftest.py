"""A log of a plate as a file and as arrays."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

HEADER = "t,sensor,px,py,pz,ax,ay,az,range_m,status,sigma_m,amplitude,stop"
SENSORS = """\
[a]
kind = "ultrasonic"
beam_full_angle_deg = 13.0
range_min_m = 0.2
range_max_m = 1.2
sigma_m = 0.0005

["b b"]
kind = "ultrasonic"
beam_full_angle_deg = 22.5
range_min_m = 0.1
range_max_m = 2.0
sigma_m = 0.001
frequency_hz = 63000
aperture_m = 0.04
incidence_limit_deg = 30.0
dead_length_m = 0.01
firing_time_s = 0.02
range_correction = "reading_to_true"
offset_m = 0.003
scale = 1.01
late_tilt_deg = [0.0, 10.0]
late_bias_m = [0.0, 0.001]
late_scatter_m = [0.0, 0.0005]
"""
FRAME = "origin = [0.01, 0.02, 0.0]\nu = [1.0, 0.1, 0.0]\nv = [0.0, 1.0, 0.0]\n"
OUTLINE = "u,v\n-0.08,-0.05\n0.08,-0.05\n0.08,0.09\n-0.08,0.09\n"


@dataclass(frozen=True)
class Arrays:
    """The columns of a readings CSV."""

    t_s: np.ndarray
    sensor: list[str]
    position_m: np.ndarray
    axis: np.ndarray
    range_m: np.ndarray
    status: list[str]
    sigma_m: np.ndarray
    amplitude: np.ndarray
    stop: np.ndarray

    @property
    def required(self) -> tuple[object, ...]:
        return self.t_s, self.sensor, self.position_m, self.axis, self.range_m

    @property
    def optional(self) -> dict[str, object]:
        return {name: getattr(self, name) for name in ("status", "sigma_m", "amplitude", "stop")}


def write_log(folder: Path, seed: int = 0) -> Path:
    """A plate seen by two rangers: rows out of order and repeated, odd readings, axes not quite of unit length."""
    rng = np.random.default_rng(seed)
    rows = []
    for j, (u, v) in enumerate((u, v) for v in np.arange(7) * 0.01 for u in np.arange(-5, 6) * 0.01):
        for k, name in enumerate(("a", "b b")):
            i = 2 * j + k
            axis = np.array([0.02 * k, 0.0, -1.0])
            axis /= np.linalg.norm(axis) * (1.0 + 1e-4 * (i % 3))
            r = 0.43 + 5e-4 * rng.normal()
            status = ["", "ok", "0"][i % 3]
            if i % 41 == 5:
                r, status = np.inf, ["", "no_echo"][i % 2]
            if i % 53 == 7:
                r = [np.nan, -np.inf][i % 2]
            sigma = "" if i % 2 else repr(float(rng.uniform(2e-4, 2e-3)))
            amplitude = "" if i % 5 else repr(float(rng.uniform(0.1, 1.0)))
            place = [float(u) + 0.02 * k, float(v), 0.43]
            numbers = [*place, *axis.tolist(), float(r)]
            rows.append([repr(0.05 * i), name, *map(repr, numbers), status, sigma, amplitude, str(j)])
    rows[10], rows[30] = rows[30], rows[10]
    rows.append(rows[4])
    lines = [HEADER, *(",".join(row) for row in rows)]
    (folder / "readings.csv").write_text("\n".join(lines) + "\n", "utf-8")
    for name, text in (("sensors.toml", SENSORS), ("frame.toml", FRAME), ("outline.csv", OUTLINE)):
        (folder / name).write_text(text, "utf-8")
    return folder / "readings.csv"


def arrays_of(path: Path) -> Arrays:
    """The columns of a readings CSV that has all of them, without any code of surfuse."""
    rows = list(csv.DictReader(path.read_text("utf-8").splitlines()))

    def column(name: str, empty: str = "nan") -> np.ndarray:
        return np.array([float(row[name] or empty) for row in rows])

    return Arrays(
        t_s=column("t"),
        sensor=[row["sensor"] for row in rows],
        position_m=np.column_stack([column(f"p{axis}") for axis in "xyz"]),
        axis=np.column_stack([column(f"a{axis}") for axis in "xyz"]),
        range_m=column("range_m", "inf"),
        status=[row["status"] for row in rows],
        sigma_m=column("sigma_m"),
        amplitude=column("amplitude"),
        stop=column("stop").astype(int),
    )


@pytest.fixture
def plate_csv(tmp_path: Path) -> Path:
    return write_log(tmp_path)


@pytest.fixture
def arrays(plate_csv: Path) -> Arrays:
    return arrays_of(plate_csv)


@pytest.fixture(scope="session")
def log_writer() -> Callable[..., Path]:
    return write_log


@pytest.fixture(scope="session")
def array_reader() -> Callable[[Path], Arrays]:
    return arrays_of
