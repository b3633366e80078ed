"""Light and contact in the beam-aware method: their own sigma, their regime, and sound beside them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from surfuse.beam_model.light.contradiction import Contradiction, contradiction
from surfuse.beam_model.light.every_kind import together
from surfuse.beam_model.light.light_map import LightMap
from surfuse.beam_model.light.passed import seen_through
from surfuse.beam_model.light.zones import HeightField, predicted
from surfuse.fusion import beam
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import FusionScene, MapGrid, Readings, Regime, SensorSpec, SurfaceMap

HALF = float(np.radians(4.0))
SIDE = 3


def zone_scan(
    slope: float = 0.0, noise_m: float = 0.003, stated_m: float = 0.003, offset_m: float = 0.0, seed: int = 0
) -> tuple[FusionScene, Readings]:
    """A chip of 3 x 3 zones over the plane w = slope u, by rays through the middle of each zone."""
    rng = np.random.default_rng(seed)
    u, v = np.meshgrid((np.arange(9) - 4) * 0.012, (np.arange(7) - 3) * 0.012)
    m = u.size
    grip = np.tile(pose(rotation_about([1, 0, 0], np.pi), [0, 0, 0.3]), (m, 1, 1))
    grip[:, 0, 3], grip[:, 1, 3] = u.ravel(), v.ravel()
    t = np.tan((np.arange(SIDE) - 1) * 2.0 * HALF)
    a, b = (one.ravel() for one in np.meshgrid(t, t))
    zones = np.column_stack([a, b, np.ones(SIDE**2)])
    zones = zones / np.linalg.norm(zones, axis=1, keepdims=True)
    axis = np.einsum("mij,zj->mzi", grip[:, :3, :3], zones).reshape(-1, 3)
    place = np.repeat(grip[:, :3, 3], SIDE**2, axis=0)
    exact = (slope * place[:, 0] - place[:, 2]) / (axis[:, 2] - slope * axis[:, 0])
    range_m = exact + offset_m + noise_m * rng.normal(size=len(exact))
    specs = tuple(SensorSpec(f"zone{k}", "tof", 0.02, 2.0, 2.0 * HALF, stated_m) for k in range(SIDE**2))
    count = len(range_m)
    readings = Readings(
        specs=specs, t_s=np.arange(count) * 0.01, sensor=np.tile(np.arange(SIDE**2), m), position_m=place, axis=axis,
        range_m=range_m, status=np.zeros(count, dtype=int), amplitude=np.full(count, np.nan),
        sigma_m=np.full(count, np.nan), count=np.ones(count), start=np.arange(m + 1) * SIDE**2, stop=np.arange(m),
        row=np.repeat(np.arange(7), 9), world_from_grip=grip,
    )  # fmt: skip
    return FusionScene(specs, np.eye(4)), readings


GRID = MapGrid(np.arange(-4, 5) * 0.01, np.arange(-3, 4) * 0.01, np.eye(4))


def fused(scene: FusionScene, readings: Readings) -> SurfaceMap:
    surface = beam.create(beam.Parameters()).replay(scene, readings, GRID).surface
    assert surface is not None
    return surface


def test_cells_that_light_holds_are_named_for_it() -> None:
    surface = fused(*zone_scan())
    assert set(np.unique(surface.regime[surface.mask])) <= {int(Regime.RAY), int(Regime.PRIOR)}
    assert np.mean(surface.regime[surface.mask] == int(Regime.RAY)) > 0.8


@pytest.mark.parametrize(
    ("slope", "stated_m", "offset_m"), [(0.0, 0.003, 0.003), (0.3, 0.003, -0.003), (0.2, 0.001, 0)]
)
def test_the_interval_holds_also_with_an_offset_and_a_bold_sigma(
    slope: float, stated_m: float, offset_m: float
) -> None:
    surface = fused(*zone_scan(slope, 0.003, stated_m, offset_m))
    error = surface.height_m - slope * surface.grid.u_m[None, :]
    held = np.abs(error[surface.mask]) <= 2.576 * surface.sigma_m[surface.mask]
    assert np.mean(held) >= 0.97
    assert np.median(surface.sigma_m[surface.mask]) < 0.008


def plain(height_m: np.ndarray, sigma_m: float, regime: Regime) -> SurfaceMap:
    shape = height_m.shape
    grid = MapGrid(np.arange(shape[1]) * 0.005, np.arange(shape[0]) * 0.005, np.eye(4))
    return SurfaceMap(
        grid, height_m, np.full(shape, sigma_m), np.ones(shape), np.ones(shape, dtype=np.int64),
        np.ones(shape, dtype=bool), np.full(shape, int(regime), dtype=np.uint8), "beam",
    )  # fmt: skip


def light_of(surface: SurfaceMap) -> LightMap:
    return LightMap(surface, 0.004, 0.01, 0.003, zone_scan()[1])


def test_sound_that_light_does_not_contradict_stays_to_the_last_bit() -> None:
    rng = np.random.default_rng(0)
    sound = plain(np.zeros((40, 40)), 0.0003, Regime.MIRROR)
    light = plain(0.004 + 0.0015 * rng.normal(size=(40, 40)), 0.0015, Regime.RAY)
    chance = np.full((40, 40), 1e-6)
    both = together(sound, light_of(light), Contradiction(1.4 * chance, chance))
    assert np.array_equal(both.height_m, sound.height_m)
    assert np.all(both.regime == int(Regime.MIRROR))


def test_sound_that_light_contradicts_gives_way_there_and_only_there() -> None:
    rng = np.random.default_rng(0)
    wrong = np.zeros((40, 60))
    wrong[:, 45:] = 0.02
    light = plain(0.001 * rng.normal(size=(40, 60)), 0.001, Regime.RAY)
    chance = np.full((40, 60), 1e-6)
    both = together(plain(wrong, 0.0003, Regime.SPECKLE), light_of(light), Contradiction(wrong**2, chance))
    assert np.sqrt(np.mean(both.height_m[:, 45:] ** 2)) < 0.002
    assert np.all(both.height_m[:, :45] == 0.0)
    assert np.all(both.regime[:, 45:] == int(Regime.RAY))


def test_what_sound_did_not_hear_is_taken_from_light() -> None:
    sound = plain(np.zeros((30, 30)), 0.01, Regime.PRIOR)
    light = plain(np.zeros((30, 30)), 0.002, Regime.RAY)
    chance = np.full((30, 30), 1e-6)
    both = together(sound, light_of(light), Contradiction(0.0 * chance, chance))
    assert np.all(both.regime == int(Regime.RAY))


def test_readings_of_light_contradict_a_wrong_surface_and_not_the_right_one() -> None:
    scene, readings = zone_scan(0.2, offset_m=0.004)
    nodes = np.arange(-20, 21) * 0.003
    right = plain(0.2 * nodes[None, :] + np.zeros((41, 1)), 0.001, Regime.MIRROR)
    right = dataclasses.replace(right, grid=MapGrid(nodes, nodes, np.eye(4)))
    bent = dataclasses.replace(right, height_m=right.height_m + 4.0 * nodes[None, :] ** 2)
    told = [contradiction(scene, readings, one, 0.003, 0.02) for one in (right, bent)]
    assert np.median(told[0].square / told[0].noise) < 1.0
    assert np.median(told[1].square / told[1].noise) > 3.0


@pytest.mark.parametrize("slope", [0.0, 0.4])
def test_a_zone_reads_the_mean_over_its_solid_angle(slope: float) -> None:
    nodes = np.arange(-40, 41) * 0.005
    height = slope * nodes[None, :] + np.zeros((81, 1))
    empty = np.ones((81, 81))
    grid = MapGrid(nodes, nodes, np.eye(4))
    surface = SurfaceMap(
        grid, height, 0.001 * empty, empty, empty.astype(np.int64), empty > 0, empty.astype(np.uint8), "m"
    )
    place, axis, half = np.array([[0.0, 0.0, 0.4]]), np.array([[0.0, 0.0, -1.0]]), np.array([0.1])
    along, mean, _ = predicted(HeightField.of(surface), place, axis, half, np.array([0.43]))
    assert along[0] == pytest.approx(0.4, abs=1e-5)
    rng = np.random.default_rng(1)
    angle, turn = 0.1 * np.sqrt(rng.random(200_000)), rng.uniform(0.0, 2.0 * np.pi, 200_000)
    ray = np.column_stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), -np.cos(angle)])
    met = -0.4 / (ray[:, 2] - slope * ray[:, 0])
    share = (slope * ray[:, 0] - ray[:, 2]) / np.sqrt(1.0 + slope**2) / met**2
    assert mean[0] == pytest.approx(np.sum(share * met) / np.sum(share), abs=5e-5)


def test_readings_through_whose_place_many_rays_passed_are_left_out() -> None:
    scene, readings = zone_scan()
    assert not np.any(seen_through(scene, readings))
    range_m = readings.range_m.copy()
    floating = np.arange(4, len(range_m), 90)
    range_m[floating] = 0.1
    changed = Readings(**{**vars(readings), "range_m": range_m})
    gone = seen_through(scene, changed)
    assert np.all(gone[floating])
    assert np.count_nonzero(gone) == len(floating)
