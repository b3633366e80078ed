"""Errors of the simulated rig that nobody knows: each makes the map wrong by what it must, none is told to anyone."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import surfuse
from surfuse.commands.acquire.acquisition import acquire
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import ConfigError
from surfuse.exporters import nc
from surfuse.geometry.poses import transform_points
from surfuse.physics.air import speed_of_sound
from surfuse.records import SurfaceMap
from surfuse.rig.description import array_fixture, camera_mount
from surfuse.rig.simulated.hidden_errors import true_fixture
from surfuse.runs.scan_log import ScanLog
from surfuse.runs.scan_source import load_scan
from surfuse.settings import load
from surfuse.surface.score import error_map
from surfuse.surface.truth import read_truth_mesh, truth_around

HOW = ["scene.name=flat", "scan.step_m=0.04", "arm.driver=kinematic", "fusion.method=mean", "bus.interface=none"]
AZIMUTH = np.radians(35.0)
Run = Callable[..., Path]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    @cache
    def made(*hidden: str) -> Path:
        path = tmp_path_factory.mktemp("hidden") / "run"
        acquire(load(None, [*HOW, *(f"hidden.{one}" for one in hidden)]), path, SilentWatcher())
        return path

    return made


def errors(path: Path) -> tuple[SurfaceMap, np.ndarray]:
    """The map and its errors at the nodes, in m."""
    surface = nc.read(path / "surface.nc")
    return surface, error_map(surface, truth_around(*read_truth_mesh(path / "truth.ply"), surface.grid))


def bias_mm(path: Path) -> float:
    return 1e3 * float(np.nanmedian(errors(path)[1]))


def outline_place(path: Path) -> np.ndarray:
    """The middle of the outline (3,) in the world, where the camera found it."""
    outline = load_scan(path).outline
    assert outline is not None
    points = np.column_stack([outline.vertices_m, np.zeros(len(outline.vertices_m))])
    low, high = points.min(axis=0), points.max(axis=0)
    return transform_points(outline.world_from_part, 0.5 * (low + high)[None])[0]


def every(vector: Sequence[float]) -> str:
    return str([list(vector)] * 4)


def test_a_table_without_errors_changes_no_bit(run: Run) -> None:
    plain, empty = load_scan(run()), load_scan(run("speed_percent=0.0", f"sensor_mm={every((0, 0, 0))}"))
    for name in ("range_m", "amplitude", "position_m", "axis", "t_s", "world_from_grip"):
        np.testing.assert_array_equal(getattr(plain.readings, name), getattr(empty.readings, name))
    np.testing.assert_array_equal(nc.read(run() / "surface.nc").height_m, errors(run("speed_percent=0.0"))[0].height_m)
    assert "hidden" not in (run() / "run.toml").read_text("utf-8")


def test_sound_that_is_faster_than_believed_makes_the_part_seem_nearer(run: Run) -> None:
    found = bias_mm(run("speed_percent=0.5")) - bias_mm(run())
    assert found == pytest.approx(1e3 * 0.43 * (1.0 - 1.0 / 1.005), abs=0.1)


def test_air_that_is_warmer_than_told(run: Run) -> None:
    found = bias_mm(run("temperature_k=4.0")) - bias_mm(run())
    assert found == pytest.approx(1e3 * 0.43 * (1.0 - speed_of_sound(20.0) / speed_of_sound(24.0)), abs=0.1)


def test_a_base_that_stands_nearer_to_the_part(run: Run) -> None:
    towards = [5.0 * float(np.cos(AZIMUTH)), 5.0 * float(np.sin(AZIMUTH)), 0.0]
    assert bias_mm(run(f"base_mm={towards}")) - bias_mm(run()) == pytest.approx(5.0, abs=0.1)


def test_a_base_that_is_turned_tilts_the_map(run: Run) -> None:
    surface, turned = errors(run("base_deg=[0.0, 0.0, 0.6]"))
    known = np.isfinite(turned)
    u = np.broadcast_to(surface.grid.u_m, turned.shape)
    slope = np.polyfit(u[known], turned[known], 1)[0]
    assert abs(np.degrees(np.arctan(slope))) == pytest.approx(0.6, abs=0.05)


def test_sensors_that_sit_elsewhere_along_their_beams(run: Run) -> None:
    assert bias_mm(run(f"sensor_mm={every((0, 0, 2.0))}")) - bias_mm(run()) == pytest.approx(2.0, abs=0.05)
    # One of four, and the mean of all.
    assert bias_mm(run("sensor_mm=[[0.0, 0.0, 4.0]]")) - bias_mm(run()) == pytest.approx(1.0, abs=0.15)


def test_sensors_that_look_elsewhere_read_more_by_their_tubes_that_lean(run: Run) -> None:
    """The perpendicular from the mouth of the tube is heard, which is then farther away; the weaker echo comes late."""
    tilted = f"sensor_deg={every((0, 4.0, 0))}"
    assert bias_mm(run(tilted)) - bias_mm(run()) == pytest.approx(-200.0 * (1.0 - np.cos(np.radians(4.0))), abs=0.25)
    weaker = np.nanmedian(load_scan(run(tilted)).readings.amplitude) / np.nanmedian(load_scan(run()).readings.amplitude)
    assert weaker == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("key", ["camera_deg=[0.0, 0.6, 0.0]", "camera_mm=[8.0, 0.0, 0.0]"])
def test_a_camera_that_sits_or_looks_elsewhere_shifts_the_outline(run: Run, key: str) -> None:
    away = outline_place(run(key)) - outline_place(run())
    sideways = abs(away @ np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0]))
    distance_m = 1.12 - float(camera_mount(load()).shoulder_from_device[0, 3])
    wanted = 0.008 if "mm" in key else distance_m * np.tan(np.radians(0.6))
    assert sideways == pytest.approx(wanted, abs=0.0015)


def test_what_is_recorded_is_what_was_believed(run: Run) -> None:
    def believed(scan: ScanLog) -> tuple[object, ...]:
        return scan.readings.specs, scan.world_from_part.tolist(), scan.readings.position_m.tolist()

    plain, wrong = (load_scan(run(*one)) for one in ((), (f"sensor_mm={every((3.0, -2.0, 2.0))}",)))
    assert believed(plain) == believed(wrong)
    assert not np.array_equal(plain.readings.range_m, wrong.readings.range_m)


def test_nothing_but_the_simulated_rig_reads_the_table() -> None:
    root = Path(surfuse.__file__).parent
    readers = {
        str(file.relative_to(root))
        for file in root.rglob("*.py")
        if re.search(r"settings\.hidden\b(?!_)", file.read_text("utf-8").replace("settings.hidden_errors", ""))
    }
    assert readers == {"rig/simulated/hidden_errors.py"}


def test_a_sensor_alone_is_moved_and_turned_about_itself() -> None:
    sensors = ["hidden.sensor_mm=[[1.0, 0.0, 0.0]]", "hidden.sensor_deg=[[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]]"]
    settings = load(None, sensors)
    told = array_fixture(settings)
    true = true_fixture(settings, told)
    moved = true.grip_from_sensor - told.grip_from_sensor
    np.testing.assert_allclose(moved[0, :3, 3], [0.001, 0.0, 0.0])
    np.testing.assert_allclose(moved[1:, :3, 3], 0.0)
    np.testing.assert_allclose(true.grip_from_sensor[1, :3, 2], [0.0, -np.sin(np.radians(10)), np.cos(np.radians(10))])
    assert true.specs == told.specs


@pytest.mark.parametrize(
    ("assignments", "words"),
    [
        (["hidden.base_mm=[500.0, 0.0, 0.0]"], "limit 200"),
        (["hidden.camera_deg=[0.0, 90.0, 0.0]"], "limit 30"),
        (["hidden.speed_percent=50.0"], "speed_percent"),
        (["hidden.air_k=1.0"], "air_k"),
        (["hidden.speed_percent=1.0", "arm.driver=bridge", "arm.port=1"], "simulated cell only"),
    ],
)
def test_what_cannot_be_planted_is_refused(assignments: list[str], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load(None, assignments)


def test_more_sensors_than_there_are_are_refused() -> None:
    settings = load(None, [f"hidden.sensor_mm={[[0.0, 0.0, 1.0]] * 5}"])
    with pytest.raises(ConfigError, match="at most 4"):
        true_fixture(settings, array_fixture(settings))
