"""The kernels against plain NumPy over the same rays."""

import numpy as np
import pytest

from surfuse.geometry.poses import pose, rotation_about
from surfuse.twin.acoustics import arrivals
from surfuse.twin.acoustics.beam import BundleParameters
from surfuse.twin.acoustics.kit import BARE
from surfuse.twin.acoustics.sounder import BIN_M, Sounder
from surfuse.twin.materials import MATERIALS, Material, Surface
from surfuse.twin.scene import Scene, SceneBody

LOOK = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def scene(tilt_deg: float) -> Scene:
    corners = np.array([[0, -2, -2], [0, 2, -2], [0, 2, 2], [0, -2, 2]], dtype=np.float64)
    turn = pose(rotation_about([0, 1, 1], np.radians(tilt_deg)), [0, 0, 0])
    return Scene([SceneBody(corners, np.array([[0, 2, 1], [0, 3, 2]]), Material.PART, turn)])


def hits(sounder: Sounder, there: np.ndarray):
    rays = sounder.beam.directions @ there[:3, :3].T
    distance, triangle = sounder.scene.cast(np.tile(there[:3, 3], (len(rays), 1)), rays)
    cosine = np.abs(np.einsum("ij,ij->i", sounder.scene.normal[triangle], rays))
    return distance, cosine


@pytest.mark.parametrize("tilt", [0.0, 5.0, 12.0])
def test_the_mirror_energy_of_a_plane_is_the_sum_over_the_rays(tilt: float) -> None:
    sounder = Sounder(scene(tilt), BARE, bundle=BundleParameters(edge_strength=0.0, bounces=1))
    there = pose(LOOK, [-0.5, 0.0, 0.0])
    found = sounder.arrivals(there)
    r, c = hits(sounder, there)
    surface, k = MATERIALS[Material.PART], sounder.wave_number
    height = r * c
    s2 = arrivals.LOBE**2 * (2 * np.pi / k) / (2 * height)
    tan2 = (1 - c**2) / c**2
    lobe = np.where(tan2 < 25 * s2, np.exp(-tan2 / s2) / (4 * np.pi * s2 * c**5 * r**2), 0.0)
    rough = surface.reflectivity * np.exp(-((2 * k * surface.roughness_m * c) ** 2))
    foot = np.arccos(abs(sounder.scene.normal[0] @ there[:3, 2]))
    two_way = np.interp(np.sin(foot), np.linspace(0, 1, len(sounder.beam.two_way)), sounder.beam.two_way)
    expected = np.sum(sounder.beam.weight_sr * lobe * rough * np.exp(-4 * sounder.absorption * height)) * two_way
    assert found.mirror.sum() == pytest.approx(expected, rel=1e-9)
    mean = (np.arange(len(found.mirror)) * BIN_M) @ found.mirror / found.mirror.sum()
    assert mean == pytest.approx(height[0], abs=1e-9)


def test_the_diffuse_energy_follows_lambert_on_average() -> None:
    there = pose(LOOK, [-0.5, 0.0, 0.0])
    surfaces = {**MATERIALS, Material.PART: Surface(0.0, 0.0, 0.5, 0.5)}
    bundle = BundleParameters(edge_strength=0.0, bounces=1)
    sounder, energies = Sounder(scene(30.0), BARE, bundle=bundle, surfaces=surfaces), []
    for seed in range(400):
        sounder.seed = seed
        found = sounder.arrivals(there)
        energies.append(found.real.sum() ** 2 + found.imag.sum() ** 2)
    r, c = hits(sounder, there)
    gain = np.interp(np.hypot(*sounder.beam.directions[:, :2].T), np.linspace(0, 1, 4096), sounder.beam.two_way)
    expected = np.sum(sounder.beam.weight_sr * 0.5 / np.pi * c * gain / r**2 * np.exp(-4 * sounder.absorption * r))
    assert np.mean(energies) == pytest.approx(expected, rel=0.2)


def plain_phase(i: int, j: int, k: int, body: int, seed: int) -> float:
    mask = 2**64 - 1
    h = seed ^ ((body + 1) * 0x9E3779B97F4A7C15 & mask)
    for value in (i, j, k):
        h = (h ^ (value + 0x100000) & mask) * 0xBF58476D1CE4E5B9 & mask
        h ^= h >> 27
        h = h * 0x94D049BB133111EB & mask
        h ^= h >> 31
    return (h >> 11) * 2.0 * np.pi / 2**53


def test_phases_are_those_of_the_plain_hash_and_even_over_the_circle() -> None:
    cells = np.random.default_rng(0).integers(-500, 500, (3000, 3))
    phases = np.array([arrivals.hash_phase(int(i), int(j), int(k), 1, 7) for i, j, k in cells])
    expected = np.array([plain_phase(int(i), int(j), int(k), 1, 7) for i, j, k in cells])
    assert phases == pytest.approx(expected)
    assert abs(np.exp(1j * phases).mean()) < 0.05
    neighbours = np.array([arrivals.hash_phase(int(i) + 1, int(j), int(k), 1, 7) for i, j, k in cells])
    assert abs(np.exp(1j * (phases - neighbours)).mean()) < 0.05


def test_deposits_keep_sum_and_centre_and_ignore_what_is_out_of_range() -> None:
    bins, extent = np.zeros(10), np.array([10, -1])
    arrivals.deposit(0.00237, 3.0, 0.001, bins, extent)
    assert bins.sum() == pytest.approx(3.0)
    assert np.arange(10) @ bins / 3.0 == pytest.approx(2.37)
    assert extent.tolist() == [2, 3]
    for outside in (-0.001, 0.0095, 1.0):
        arrivals.deposit(outside, 5.0, 0.001, bins, extent)
    assert bins.sum() == pytest.approx(3.0)
