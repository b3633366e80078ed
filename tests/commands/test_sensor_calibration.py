from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from surfuse.commands.calibrate.sensor_calibration import calibrate_sensor, fit_model, model_toml
from surfuse.errors import ConfigError, DataError, StorageError
from surfuse.records import Readings, SensorSpec
from surfuse.runs.readings_csv import write_readings_csv
from surfuse.runs.scan_log import ScanLog
from surfuse.runs.scan_source import load_scan
from surfuse.runs.side_files import read_sensors, sensors_toml

OFFSET_M = np.array([0.004, -0.002])
SCALE, SIGMA_M, CAPTURE_DEG = 1.006, 0.0005, 6.75
PLATE = np.array([[-0.4, -0.4, 0.0], [0.4, -0.4, 0.0], [0.4, 0.4, 0.0], [-0.4, 0.4, 0.0]])
TWO = np.array([[0, 1, 2], [0, 2, 3]])
Mesh = tuple[np.ndarray, np.ndarray]


def scan_of(height_m: float, truth_m: np.ndarray, seed: int) -> ScanLog:
    """Two sensors look down from a height at what is `truth_m` (N, 2) away; their ranges as they would report them."""
    rng = np.random.default_rng(seed)
    n = len(truth_m)
    position = np.zeros((n, 2, 3))
    position[:, :, 0] = np.linspace(-0.1, 0.1, n)[:, None] + [-0.02, 0.02]
    position[:, :, 2] = height_m
    ranges = OFFSET_M + SCALE * truth_m + rng.normal(size=truth_m.shape) * SIGMA_M
    grip = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (n, 1, 1))
    grip[:, :3, 3] = position.mean(axis=1)
    spec = [SensorSpec(f"us{k}", "ultrasonic", 0.1, 2.0, np.radians(20.0), 0.003) for k in range(2)]
    readings = Readings(
        specs=tuple(spec),
        t_s=np.arange(2 * n) * 0.05,
        sensor=np.tile([0, 1], n),
        position_m=position.reshape(-1, 3),
        axis=np.tile([0.0, 0.0, -1.0], (2 * n, 1)),
        range_m=ranges.ravel(),
        status=np.zeros(2 * n),
        amplitude=np.full(2 * n, np.nan),
        sigma_m=np.full(2 * n, np.nan),
        count=np.ones(2 * n),
        start=np.arange(n + 1) * 2,
        stop=np.arange(n),
        row=np.zeros(n),
        world_from_grip=grip,
    )
    return ScanLog(readings, np.eye(4), frame_estimated=False)


def places(n: int) -> np.ndarray:
    return np.linspace(-0.1, 0.1, n)[:, None] + [-0.02, 0.02]


def facing(height_m: float = 0.43, n: int = 200, seed: int = 1) -> tuple[ScanLog, Mesh]:
    return scan_of(height_m, np.full((n, 2), height_m), seed), (PLATE, TWO)


def tilted(degrees: float = 20.0, late_m: float = 0.006, n: int = 200) -> tuple[ScanLog, Mesh]:
    slope = np.tan(np.radians(degrees))
    vertices = PLATE + np.column_stack([0 * PLATE[:, 0], 0 * PLATE[:, 0], slope * PLATE[:, 0]])
    return scan_of(0.5, 0.5 - slope * places(n) + late_m, 2), (vertices, TWO)


def step(n: int = 400) -> tuple[ScanLog, Mesh]:
    """A block 9 cm high over x < 0: whoever has its edge within the capture angle hears it."""
    block = np.array([[-0.4, -0.4, 0.09], [0.0, -0.4, 0.09], [0.0, 0.4, 0.09], [-0.4, 0.4, 0.09]])
    vertices, faces = np.vstack([PLATE, block]), np.vstack([TWO, TWO + 4])
    x = places(n)
    to_edge = np.degrees(np.arctan2(x, 0.43 - 0.09))
    near = np.where(x < 0.0, 0.34, np.hypot(x, 0.34))
    return scan_of(0.43, np.where(to_edge <= CAPTURE_DEG, near, 0.43), 3), (vertices, faces)


def test_all_constants_come_back_from_plate_tilt_and_step() -> None:
    logs = [facing(), facing(0.8, seed=5), tilted(), step()]
    model = fit_model([log for log, _ in logs], [mesh for _, mesh in logs])
    assert model.facing.scale == pytest.approx(SCALE, abs=4.0 * model.facing.scale_sigma)
    assert model.facing.scale_sigma < 5e-4
    assert model.facing.offset_m == pytest.approx(OFFSET_M, abs=5e-4)
    assert model.facing.sigma_m == pytest.approx(SIGMA_M, rel=0.15)
    assert model.open_questions == ()
    late = dict(zip(np.degrees(model.late.tilt_rad).round(), model.late.bias_m, strict=True))
    assert late[20.0] == pytest.approx(0.006, abs=5e-4)
    assert model.capture.low_rad <= np.radians(CAPTURE_DEG) <= model.capture.high_rad
    assert np.degrees(model.capture.angle_rad) == pytest.approx(CAPTURE_DEG, abs=0.5)
    assert np.degrees(model.capture.high_rad - model.capture.low_rad) < 1.5


def test_what_the_logs_cannot_determine_stays_open_with_the_reason() -> None:
    model = fit_model([facing()[0]], [facing()[1]])
    text = " | ".join(model.open_questions)
    assert "scale stays open" in text
    assert "late bias and scatter stay open" in text
    assert "capture angle stays open" in text
    assert np.isnan(model.facing.scale)
    # Without a scale the offset holds at the distance of the plate.
    assert model.facing.offset_m == pytest.approx(OFFSET_M + (SCALE - 1.0) * 0.43, abs=2e-4)
    written = tomllib.loads(model_toml(model))
    assert written["us0"]["range_correction"] == "reading_to_true"
    assert written["us0"]["offset_m"] == -model.facing.offset_m[0]
    assert set(written) == {"us0", "us1"}
    assert "scale" not in written["us0"]
    with pytest.raises(DataError, match="0 echoes of a facing plate"):
        fit_model([tilted()[0]], [tilted()[1]])


def test_the_written_model_corrects_the_ranges_of_a_log(tmp_path: Path) -> None:
    logs = [facing(), facing(0.8, seed=5)]
    files, meshes = [], []
    for k, (scan, (vertices, faces)) in enumerate(logs):
        folder = tmp_path / f"log{k}"
        folder.mkdir()
        write_readings_csv(folder / "readings.csv", scan.readings, scan.scene())
        rows = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
        (folder / "plate.obj").write_text("\n".join(rows) + "\n", "utf-8")
        files.append(folder / "readings.csv")
        meshes.append(folder / "plate.obj")
    model = tmp_path / "model.toml"
    told = calibrate_sensor(files, meshes, model, force=False)
    assert told.summary["scale"] == pytest.approx(SCALE, abs=1e-3)
    scan = load_scan(files[1], sensors=model)
    assert np.median(scan.readings.range_m) == pytest.approx(0.8, abs=2e-4)
    assert scan.readings.specs[0].sigma_m == pytest.approx(SIGMA_M, rel=0.2)
    assert any("calibration" in warning for warning in scan.warnings)
    with pytest.raises(StorageError):
        calibrate_sensor(files, meshes, model, force=False)
    (files[0].parent / "sensors.toml").write_text(model.read_text("utf-8"), "utf-8")
    with pytest.raises(DataError, match="holds a calibration already"):
        calibrate_sensor(files, meshes, model, force=True)


def test_fusion_reads_the_lateness_that_was_written(tmp_path: Path) -> None:
    logs = [facing(), facing(0.8, seed=5), tilted()]
    model = fit_model([log for log, _ in logs], [mesh for _, mesh in logs])
    (tmp_path / "model.toml").write_text(model_toml(model), "utf-8")
    spec = read_sensors(tmp_path / "model.toml")[0]
    assert spec.late is not None
    assert spec.late.tilt_rad == pytest.approx(model.late.tilt_rad)
    assert spec.late.bias_m == pytest.approx(model.late.bias_m)
    assert read_sensors_text(sensors_toml((spec,)), tmp_path) == (spec,)


def read_sensors_text(text: str, folder: Path) -> tuple[SensorSpec, ...]:
    (folder / "again.toml").write_text(text, "utf-8")
    return read_sensors(folder / "again.toml")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("late_tilt_deg = [20.0]", "late_bias_m = None"),
        ("late_tilt_deg = [20.0, 10.0]\nlate_bias_m = [0.0, 0.0]\nlate_scatter_m = [0.0, 0.0]", "late tilts of"),
        ("late_tilt_deg = [20.0]\nlate_bias_m = [0.0, 0.0]\nlate_scatter_m = [0.0]", "1 tilts, 2 biases"),
        ('late_tilt_deg = ["a"]\nlate_bias_m = [0.0]\nlate_scatter_m = [0.0]', "late_tilt_deg = "),
    ],
)
def test_a_damaged_lateness_is_refused(tmp_path: Path, line: str, words: str) -> None:
    spec = SensorSpec("us0", "ultrasonic", 0.1, 2.0, 0.2, 0.003)
    with pytest.raises((ConfigError, DataError), match=words):
        read_sensors_text(sensors_toml((spec,)) + line + "\n", tmp_path)
