import json
from pathlib import Path

import numpy as np
import pytest

from surfuse.errors import ConfigError
from surfuse.twin.acoustics.beam import BundleParameters, directivity, sample_beam

REFERENCE = json.loads((Path(__file__).parents[1] / "data" / "acoustics_reference.json").read_text())
WAVE_NUMBER = 2.0 * np.pi * 63e3 / 343.2


def test_directivity_has_the_piston_s_known_points() -> None:
    ka = 0.5 * 0.04 * WAVE_NUMBER
    at = directivity(0.04, WAVE_NUMBER, np.array([0.0, 1.6163, 2.2151, 3.8317, 5.1356]) / np.array([1, ka, ka, ka, ka]))
    assert at[0] == 1.0
    assert 20 * np.log10(np.abs(at[[1, 2, 4]])) == pytest.approx([-3.01, -6.02, -17.57], abs=0.01)
    assert at[3] == pytest.approx(0.0, abs=1e-4)


def test_directivity_agrees_with_the_reference_table() -> None:
    for row in REFERENCE["piston"]:
        k = row["ka"] / row["a"]
        half = np.radians(row["minus3dB_oneway_halfangle_deg"])
        level = 20 * np.log10(directivity(2 * row["a"], k, np.sin(half)))
        assert level == pytest.approx(-3.0103, abs=1e-3)


@pytest.mark.parametrize(("aperture", "rays"), [(0.04, 512), (0.017, 512), (0.04, 4096)])
def test_the_bundle_integrates_over_the_solid_angle(aperture: float, rays: int) -> None:
    beam = sample_beam(aperture, WAVE_NUMBER, BundleParameters(rays=rays))
    assert np.linalg.norm(beam.directions, axis=1) == pytest.approx(1.0)
    cap = 2.0 * np.pi * (1.0 - np.sqrt(1.0 - beam.edge_sine**2))
    assert beam.weight_sr.sum() == pytest.approx(cap, rel=0.03)
    # Two-way energy of a narrow piston beam: 5.78 / (ka)^2 steradian (Urick).
    sine = np.hypot(beam.directions[:, 0], beam.directions[:, 1])
    energy = beam.weight_sr @ directivity(aperture, WAVE_NUMBER, sine) ** 4
    assert energy == pytest.approx(5.78 / (0.5 * aperture * WAVE_NUMBER) ** 2, rel=0.03)


def test_the_rim_is_where_the_side_lobes_have_fallen_to_the_floor() -> None:
    beam = sample_beam(0.04, WAVE_NUMBER, BundleParameters(floor_db=-45.0))
    beyond = directivity(0.04, WAVE_NUMBER, np.linspace(beam.edge_sine, 1.0, 2000)) ** 2
    assert 20 * np.log10(beyond.max()) == pytest.approx(-45.0, abs=3.0)


def test_nearest_rays_are_the_nearest() -> None:
    beam = sample_beam(0.04, WAVE_NUMBER, BundleParameters(rays=64))
    nodes = np.linspace(-beam.edge_sine, beam.edge_sine, len(beam.nearest))
    for i, j in ((0, 0), (13, 40), (32, 32), (63, 5)):
        gap = np.hypot(beam.directions[:, 0] - nodes[i], beam.directions[:, 1] - nodes[j])
        assert gap[beam.nearest[i, j]] == gap.min()


@pytest.mark.parametrize("wrong", [{"rays": 3}, {"floor_db": 0.0}, {"speckle_cell_m": 0.0}, {"bounces": 3}])
def test_impossible_bundles_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="give"):
        BundleParameters(**wrong)
