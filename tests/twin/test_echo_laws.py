"""What any echo must obey, whatever the code that makes it."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import trimesh

from surfuse.errors import ConfigError
from surfuse.geometry.poses import pose, rotation_about
from surfuse.twin.acoustics.air import AirParameters
from surfuse.twin.acoustics.beam import BundleParameters
from surfuse.twin.acoustics.kit import BARE, TUBE, KitParameters, TransducerParameters
from surfuse.twin.acoustics.noise import SILENT, AcousticNoise
from surfuse.twin.acoustics.sounder import Sounder
from surfuse.twin.materials import Material
from surfuse.twin.scene import Scene, SceneBody

FINE = KitParameters(sample_rate_hz=1e8)
LOOK = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # beam along +x
SMOOTH, MATTE = Material.PART_SMOOTH, Material.PART


def plane(tilt_deg: float = 0.0, material: Material = MATTE, half: float = 0.4, there: tuple[float, ...] = (0, 0, 0)):
    """A square sheet through the origin, facing -x, turned about z."""
    corners = np.array([[0, -half, -half], [0, half, -half], [0, half, half], [0, -half, half]])
    turn = pose(rotation_about([0, 0, 1], np.radians(tilt_deg)), there)
    return Scene([SceneBody(corners, np.array([[0, 2, 1], [0, 3, 2]]), material, turn)])


def step(height: float = 0.09, material: Material = MATTE) -> Scene:
    """Near surface x = 0 for y < 0, far surface x = height for y > 0, with the wall between."""
    h, d = 0.4, height
    corners = [[0, -h, -h], [0, 0, -h], [0, 0, h], [0, -h, h], [d, 0, -h], [d, h, -h], [d, h, h], [d, 0, h]]
    faces = [[0, 2, 1], [0, 3, 2], [4, 6, 5], [4, 7, 6], [1, 2, 7], [1, 7, 4]]
    return Scene([SceneBody(np.array(corners, dtype=np.float64), np.array(faces), material, np.eye(4))])


def at(distance: float, y: float = 0.0, z: float = 0.0, yaw_deg: float = 0.0) -> np.ndarray:
    return pose(rotation_about([0, 0, 1], np.radians(yaw_deg)) @ LOOK, [-distance, y, z])


def read(sounder: Sounder, world_from_sensor: np.ndarray) -> tuple[float, float]:
    ranges, amplitudes = sounder.ping(world_from_sensor, 1, SILENT, np.random.default_rng(0), 0.0)
    return float(ranges[0]), float(amplitudes[0])


def mirror_energy(sounder: Sounder, world_from_sensor: np.ndarray) -> float:
    return float(sounder.arrivals(world_from_sensor).mirror.sum())


@pytest.mark.parametrize("transducer", [TUBE, BARE])
@pytest.mark.parametrize("distance", [0.2, 0.43, 1.0, 2.0])
def test_a_facing_plate_echoes_like_one_over_twice_its_distance(transducer: TransducerParameters, distance: float):
    sounder = Sounder(plane(material=SMOOTH, half=1.0), transducer)
    energy = mirror_energy(sounder, at(distance + transducer.tube_length_m))
    lost = np.exp(-4.0 * sounder.absorption * distance) * 0.99
    assert np.sqrt(energy / lost) == pytest.approx(1.0 / (2.0 * distance), rel=0.03)


@pytest.mark.parametrize(("radius", "tolerance"), [(0.10, 0.05), (0.20, 0.05), (0.40, 0.05)])
def test_a_ball_echoes_like_its_radius_over_radius_plus_distance(radius: float, tolerance: float) -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    scene = Scene(
        [SceneBody(np.asarray(ball.vertices), np.asarray(ball.faces), SMOOTH, pose(np.eye(3), [radius, 0, 0]))]
    )
    sounder = Sounder(scene, TUBE, bundle=BundleParameters(rays=2048))
    distance = 0.3
    amplitude = np.sqrt(mirror_energy(sounder, at(distance + TUBE.tube_length_m)) / 0.99)
    amplitude *= np.exp(2.0 * sounder.absorption * distance)
    assert amplitude == pytest.approx(radius / (2.0 * distance * (distance + radius)), rel=tolerance)


@pytest.mark.parametrize("tilt", [0.0, 2.0, 4.0, 6.0, 8.0])
def test_the_loss_with_tilt_is_the_directivity_at_the_mirror_point(tilt: float) -> None:
    sounder = Sounder(plane(tilt, SMOOTH), TUBE)
    facing = mirror_energy(Sounder(plane(0.0, SMOOTH), TUBE), at(0.43))
    x = 0.5 * TUBE.aperture_m * sounder.wave_number * np.sin(np.radians(tilt))
    from scipy.special import j1

    expected = (2 * j1(x) / x) ** 2 if x else 1.0
    near = 0.43 - TUBE.tube_length_m
    shorter = 1.0 / np.cos(np.radians(tilt)) * np.exp(2 * sounder.absorption * near * (1 - np.cos(np.radians(tilt))))
    got = np.sqrt(mirror_energy(sounder, at(0.43)) / facing)
    assert got == pytest.approx(expected * shorter, rel=0.06, abs=0.002)


@pytest.mark.parametrize("transducer", [TUBE, BARE])
def test_a_mirror_is_silent_at_the_null_of_the_beam_and_heard_again_in_the_side_lobe(transducer) -> None:
    def share(sine: float) -> float:
        tilt = float(np.degrees(np.arcsin(sine)))
        return mirror_energy(Sounder(plane(tilt, SMOOTH, half=2.0), transducer), at(0.43)) / facing

    facing = mirror_energy(Sounder(plane(0.0, SMOOTH, half=2.0), transducer), at(0.43))
    ka = 0.5 * transducer.aperture_m * Sounder(plane(), transducer).wave_number
    null, lobe = 3.8317 / ka, 5.1356 / ka
    assert share(null) < 1e-8
    # -17.57 dB one way; the perpendicular of a tilted plate is shorter, and its echo stronger, by the cosine.
    assert 10.0 * np.log10(share(lobe) * (1.0 - lobe**2)) == pytest.approx(-2 * 17.57, abs=0.8)


@pytest.mark.parametrize("transducer", [TUBE, BARE])
def test_a_facing_plate_is_read_to_half_a_millimetre(transducer: TransducerParameters) -> None:
    sounder = Sounder(plane(), transducer)
    generator = np.random.default_rng(5)
    for distance in np.linspace(0.35, 1.2, 18):
        ranges, _ = sounder.ping(at(distance), 200, AcousticNoise(), generator, 0.0)
        assert ranges.mean() == pytest.approx(distance, abs=0.5e-3)
        assert ranges.std() == pytest.approx(0.3e-3, rel=0.3)


@pytest.mark.parametrize(("transducer", "limit", "error"), [(TUBE, 7.0, 1.5e-3), (BARE, 15.0, 1.5e-3)])
def test_within_the_beam_the_reading_is_the_perpendicular_distance(transducer, limit: float, error: float) -> None:
    away = 0.43 - transducer.tube_length_m
    for tilt in np.linspace(0.0, limit, 6):
        got, _ = read(Sounder(plane(tilt), transducer, FINE), at(0.43))
        # The beam starts at the tube's mouth, so that only the way from there is shortened.
        assert got == pytest.approx(0.43 - away * (1.0 - np.cos(np.radians(tilt))), abs=error)


def test_smooth_plates_vanish_beyond_their_limit_and_the_tube_s_comes_first() -> None:
    def answers(transducer: TransducerParameters, tilt: float) -> bool:
        return bool(np.isfinite(read(Sounder(plane(tilt, SMOOTH), transducer), at(0.43))[0]))

    assert all(answers(TUBE, tilt) for tilt in (0.0, 4.0, 7.5))
    assert not any(answers(TUBE, tilt) for tilt in (9.5, 10.5, 16.0, 20.0, 25.0, 30.0))
    assert all(answers(BARE, tilt) for tilt in (0.0, 8.0, 16.0))
    assert not any(answers(BARE, tilt) for tilt in (25.0, 30.0, 40.0))


@pytest.fixture(scope="module")
def speckle() -> np.ndarray:
    """Errors against the axis distance over a matte plate at 20 degrees, (seeds, places) every 2 mm."""
    slope = np.tan(np.radians(20.0))
    places = np.arange(-0.08, 0.08, 0.002)
    rows = []
    for seed in range(6):
        sounder = Sounder(plane(20.0), TUBE, FINE, seed=seed)
        rows.append([read(sounder, at(0.43 + y * slope, y, 0.02))[0] - 0.43 for y in places])
    return np.array(rows)


def test_a_matte_plate_at_twenty_degrees_still_answers_late_and_one_sided(speckle: np.ndarray) -> None:
    heard = speckle[np.isfinite(speckle)]
    assert len(heard) > 0.85 * speckle.size
    perpendicular = -0.23 * (1.0 - np.cos(np.radians(20.0)))
    assert heard.min() > perpendicular
    assert 0.001 < heard.mean() < 0.012
    assert 0.002 < heard.std() < 0.015
    late, early = np.percentile(heard, 98) - np.median(heard), np.median(heard) - np.percentile(heard, 2)
    assert late > 1.5 * early


def test_speckle_is_correlated_over_millimetres_and_forgotten_over_centimetres(speckle: np.ndarray) -> None:
    filled = np.where(np.isfinite(speckle), speckle, np.nanmedian(speckle[np.isfinite(speckle)]))
    ranked = np.argsort(np.argsort(filled, axis=1), axis=1).astype(float)
    ranked -= ranked.mean(axis=1, keepdims=True)

    def correlation(lag: int) -> float:
        return float(np.mean(ranked[:, lag:] * ranked[:, : ranked.shape[1] - lag]) / np.mean(ranked**2))

    assert correlation(1) > 0.7
    assert abs(correlation(20)) < 0.4


def test_the_speckle_of_a_matte_plate_is_correlated_over_one_to_two_centimetres() -> None:
    slope, step_m = np.tan(np.radians(20.0)), 0.002
    places = np.arange(-0.08, 0.08, step_m)
    rows = []
    for seed in range(6):
        sounder = Sounder(plane(20.0), TUBE, FINE, seed=seed)
        heard = []
        for y in places:
            found = sounder.arrivals(at(0.43 + y * slope, y, 0.02))
            heard.append(complex(found.real.sum(), found.imag.sum()))
        rows.append(heard)
    field = np.array(rows)

    def correlation(lag: int) -> float:
        return float(np.abs(np.mean(field[:, lag:] * np.conj(field[:, :-lag]))) / np.mean(np.abs(field) ** 2))

    fallen = next(lag for lag in range(1, 40) if correlation(lag) < 1.0 / np.e)
    assert 0.010 <= fallen * step_m <= 0.020


def test_speckle_moves_with_the_surface_and_differs_between_surfaces() -> None:
    shift = np.array([0.3, -0.2, 0.5])
    here = Sounder(plane(20.0), TUBE, FINE)
    there = Sounder(plane(20.0, there=tuple(shift)), TUBE, FINE)
    other = Sounder(plane(20.0), TUBE, FINE, seed=1)
    moved = at(0.43)
    moved[:3, 3] += shift
    assert read(there, moved)[0] == pytest.approx(read(here, at(0.43))[0], abs=1e-5)
    assert abs(read(other, at(0.43))[0] - read(here, at(0.43))[0]) > 1e-4


def capture_radius(transducer: TransducerParameters, distance: float) -> float:
    """How far beyond the near surface's edge it is still heard."""
    sounder = Sounder(step(), transducer)
    for y in np.arange(0.0, 0.15, 0.002):
        if abs(read(sounder, at(distance, y))[0] - (distance + 0.09)) < 0.002:
            return float(y)
    return np.inf


def test_a_step_is_heard_early_within_a_capture_radius_that_follows_the_beam() -> None:
    away = 0.34
    tube = capture_radius(TUBE, away + TUBE.tube_length_m)
    bare = capture_radius(BARE, away)
    assert 0.02 < tube < 0.05
    assert 0.04 < bare < 0.10
    assert bare > 1.3 * tube


def test_the_capture_radius_shrinks_with_a_higher_threshold() -> None:
    def radius(threshold: float) -> float:
        sounder = Sounder(step(), TUBE, replace(FINE, threshold=threshold))
        return next(y for y in np.arange(0.0, 0.15, 0.002) if abs(read(sounder, at(0.54, y))[0] - 0.63) < 0.002)

    found = [radius(threshold) for threshold in (0.03, 0.06, 0.12, 0.24, 0.5)]
    assert all(smaller <= larger for larger, smaller in pairwise(found))
    assert found[-1] < 0.6 * found[0]


def test_a_weak_echo_is_detected_later_by_up_to_a_few_periods_and_then_not_at_all() -> None:
    half_wave = 0.5 * 343.2 / FINE.frequency_hz
    strong = Sounder(plane(), TUBE, FINE)
    late = []
    for gain in (1.0, 0.3, 0.1, 0.05, 0.03, 0.02, 0.01):
        weak = Sounder(plane(), TUBE, replace(FINE, gain=gain))
        weak._delay_s = strong._delay_s  # calibrated with the strong echo, as the kit is
        late.append((read(weak, at(0.43))[0] - 0.43) / half_wave)
    assert all(later > earlier for earlier, later in pairwise(late))
    assert abs(late[0]) < 0.05
    assert 0.5 < late[3] < 1.5
    assert 2.0 < late[5] < 5.0
    assert late[6] == np.inf


def test_both_levels_of_a_step_are_read_right_away_from_it() -> None:
    sounder = Sounder(step(), TUBE)
    assert read(sounder, at(0.40, -0.06))[0] == pytest.approx(0.40, abs=1e-3)
    assert read(sounder, at(0.40, 0.06))[0] == pytest.approx(0.49, abs=1e-3)


def test_a_smooth_corner_returns_the_two_bounce_distance() -> None:
    leg = 0.3
    corners = np.array(
        [[0, 0, -leg], [-leg, leg, -leg], [-leg, leg, leg], [0, 0, leg], [-leg, -leg, -leg], [-leg, -leg, leg]]
    )
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 5], [0, 5, 4]])
    scene = Scene([SceneBody(corners, faces, SMOOTH, np.eye(4))])
    bundle = BundleParameters(edge_strength=0.0)
    for y in (0.0, 0.01):
        got, _ = read(Sounder(scene, TUBE, FINE, bundle=bundle), at(0.45, y))
        assert got == pytest.approx(0.45, abs=3e-3)
    deaf = Sounder(scene, TUBE, FINE, bundle=replace(bundle, bounces=1))
    assert not np.isfinite(read(deaf, at(0.45))[0])


@pytest.mark.parametrize("scene", [plane(4.0), step()])
def test_results_converge_with_more_rays(scene: Scene) -> None:
    def readings(rays: int) -> np.ndarray:
        sounder = Sounder(scene, TUBE, FINE, bundle=BundleParameters(rays=rays))
        return np.array([read(sounder, at(0.43, y, z))[0] for y in (-0.05, 0.0, 0.005, 0.05) for z in (0.0, 0.03)])

    best = readings(16384)
    coarse, usual = np.abs(readings(64) - best).max(), np.abs(readings(512) - best).max()
    assert usual < 0.5e-3
    assert np.abs(readings(4096) - best).max() <= max(usual, 1e-4)
    assert coarse < 0.01


def test_results_converge_with_finer_patches_of_edges_surfaces_and_roughness() -> None:
    places = [(y, z) for y in (-0.01, 0.0, 0.005, 0.02) for z in (0.0, 0.03)]

    def over_the_step(spacing_m: float) -> np.ndarray:
        sounder = Sounder(step(), TUBE, FINE, bundle=BundleParameters(edge_spacing_m=spacing_m))
        return np.array([read(sounder, at(0.43, y, z))[0] for y, z in places])

    best = over_the_step(0.002)
    assert np.abs(over_the_step(0.016) - best).max() < 1e-4
    assert np.abs(over_the_step(0.008) - best).max() < 2e-5

    # The same plate in two and in 2,048 triangles.
    corners = np.array([[0, -0.4, -0.4], [0, 0.4, -0.4], [0, 0.4, 0.4], [0, -0.4, 0.4]])
    fine = trimesh.Trimesh(corners, [[0, 2, 1], [0, 3, 2]]).subdivide().subdivide().subdivide().subdivide().subdivide()
    turned = pose(rotation_about([0, 0, 1], np.radians(4.0)), [0, 0, 0])
    many = Scene([SceneBody(np.asarray(fine.vertices), np.asarray(fine.faces), MATTE, turned)])
    for y in (-0.05, 0.0, 0.03):
        assert read(Sounder(many, TUBE, FINE), at(0.43, y))[0] == pytest.approx(
            read(Sounder(plane(4.0), TUBE, FINE), at(0.43, y))[0], abs=2e-5
        )

    def diffuse_energy(cell_m: float) -> float:
        sounder, found = Sounder(plane(20.0), TUBE, FINE, bundle=BundleParameters(speckle_cell_m=cell_m)), []
        for seed in range(600):
            sounder.seed = seed
            heard = sounder.arrivals(at(0.43))
            found.append(heard.real.sum() ** 2 + heard.imag.sum() ** 2)
        return float(np.mean(found))

    assert diffuse_energy(0.006) == pytest.approx(diffuse_energy(0.003), rel=0.2)


def test_warm_air_shortens_every_range_by_the_speed_s_share() -> None:
    kit_believes_20 = [Sounder(plane(), TUBE, FINE, AirParameters(temperature_c=t)) for t in (20.0, 21.0, 30.0)]
    cold, warm, hot = (read(sounder, at(0.8))[0] for sounder in kit_believes_20)
    assert (cold - warm) / cold == pytest.approx(1.7e-3, abs=1.5e-4)
    assert (cold - hot) / cold == pytest.approx(1.0 - 1.0 / np.sqrt(303.15 / 293.15), abs=6e-4)
    aware = Sounder(plane(), TUBE, FINE, AirParameters(temperature_c=30.0, assumed_temperature_c=30.0))
    assert read(aware, at(0.8))[0] == pytest.approx(0.8, abs=5e-4)


def test_the_blanking_sets_the_nearest_range() -> None:
    sounder = Sounder(plane(), TUBE, FINE)
    assert sounder.nearest_m == pytest.approx(0.3255, abs=1e-3)
    assert read(sounder, at(0.335))[0] == pytest.approx(0.335, abs=5e-4)
    # The echo is still ringing as the detector opens: the kit knows that it is too close.
    assert read(sounder, at(0.30))[0] == -np.inf
    longer = Sounder(plane(), TUBE, replace(FINE, blanking_s=2.38e-3))
    assert read(longer, at(0.40))[0] == -np.inf
    # The whole echo is over: the kit hears nothing of it.
    assert read(Sounder(plane(), TUBE, replace(FINE, blanking_s=4e-3)), at(0.40))[0] == np.inf


def test_the_transducer_s_own_ringing_is_heard_when_the_blanking_is_too_short() -> None:
    short = Sounder(plane(), BARE, replace(FINE, blanking_s=0.5e-3))
    assert read(short, at(0.43))[0] == -np.inf
    more_cycles = Sounder(plane(), BARE, replace(FINE, blanking_s=1.8e-3, cycles=56))
    assert read(more_cycles, at(0.43))[0] == -np.inf


def test_every_kit_parameter_has_its_effect() -> None:
    tilted, there = plane(20.0), at(0.43)
    usual = read(Sounder(tilted, TUBE, FINE), there)[0]
    assert read(Sounder(tilted, TUBE, replace(FINE, gain=0.01)), there)[0] == np.inf
    assert read(Sounder(tilted, TUBE, replace(FINE, gain=2.0)), there)[0] < usual
    assert read(Sounder(tilted, TUBE, replace(FINE, threshold=0.12)), there)[0] > usual
    few = Sounder(plane(), TUBE, replace(FINE, cycles=2))
    assert read(few, there)[1] < 0.9 * read(Sounder(plane(), TUBE, FINE), there)[1]
    low = Sounder(plane(), TUBE, replace(FINE, frequency_hz=49.4e3))
    assert low.absorption < Sounder(plane(), TUBE).absorption
    assert low.beam.edge_sine > Sounder(plane(), TUBE).beam.edge_sine
    slow = Sounder(plane(), TUBE, KitParameters(sample_rate_hz=50e3))
    ranges, _ = slow.ping(there, 400, SILENT, np.random.default_rng(0), 0.0)
    assert ranges.std() == pytest.approx(0.5 * 343.2 / 50e3 / np.sqrt(12.0), rel=0.15)


def test_a_transducer_off_its_resonance_hears_less_the_further_the_less() -> None:
    for transducer in (TUBE, BARE):
        above = [transducer.response(f) for f in np.linspace(transducer.resonance_hz, 200e3, 40)]
        below = [transducer.response(f) for f in np.linspace(transducer.resonance_hz, 20e3, 40)]
        assert np.all(np.diff(above) < 0.0)
        assert np.all(np.diff(below) < 0.0)
        assert transducer.response(63e3) == 1.0
    # Half the power, one way, at the ends of the band: half the amplitude out and back.
    edge = TUBE.resonance_hz * (np.sqrt(1.0 + 0.25 / TUBE.quality**2) + 0.5 / TUBE.quality)
    assert TUBE.response(edge) == pytest.approx(0.5 * TUBE.response(TUBE.resonance_hz))
    assert replace(TUBE, resonance_hz=0.0).response(120e3) == 1.0


def test_the_response_scales_the_echo_and_silences_weak_ones() -> None:
    def heard(frequency_hz: float, resonance_hz: float, tilt: float = 0.0) -> tuple[float, float]:
        transducer = replace(TUBE, resonance_hz=resonance_hz)
        return read(Sounder(plane(tilt), transducer, replace(FINE, frequency_hz=frequency_hz)), at(0.43))

    usual = TUBE.resonance_hz
    assert heard(63e3, usual) == heard(63e3, 0.0)
    for frequency_hz in (45e3, 55e3, 75e3):
        ratio = heard(frequency_hz, usual)[1] / heard(frequency_hz, 0.0)[1]
        assert ratio == pytest.approx(TUBE.response(frequency_hz), rel=2e-3)
    # A plate at 20 degrees answers weakly: far from the resonance its echo stays below the level.
    assert np.isfinite(heard(63e3, usual, 20.0)[0])
    assert np.isfinite(heard(90e3, 0.0, 20.0)[0])
    assert heard(90e3, usual, 20.0)[0] == np.inf
    # The facing plate is still heard, later within its burst.
    assert heard(90e3, usual)[0] == pytest.approx(0.43, abs=2e-3)


def test_the_farthest_plate_that_is_heard_comes_nearer_off_the_resonance() -> None:
    def farthest(frequency_hz: float) -> float:
        sounder = Sounder(plane(half=2.0), BARE, replace(FINE, frequency_hz=frequency_hz, gain=0.05))
        heard = [d for d in np.arange(0.4, 4.0, 0.1) if np.isfinite(read(sounder, at(d))[0])]
        return max(heard, default=0.0)

    found = [farthest(f) for f in (55e3, 63e3, 75e3, 90e3, 120e3)]
    assert all(nearer <= farther for farther, nearer in pairwise(found))
    assert found[-1] < 0.6 * found[0]


def test_noise_is_what_it_says() -> None:
    sounder, generator = Sounder(plane(), TUBE, FINE), np.random.default_rng(3)

    def burst(**noise: float) -> np.ndarray:
        silent = {"timing_m": 0.0, "amplitude": 0.0, "receiver": 0.0}
        return sounder.ping(at(0.43), 4000, AcousticNoise(**{**silent, **noise}), generator, 60.0)[0]

    assert burst(timing_m=1e-3).std() == pytest.approx(1e-3, rel=0.05)
    assert np.isinf(burst(dropout=0.1)).mean() == pytest.approx(0.1, abs=0.02)
    late = burst(slip=0.2) - burst()
    assert (late > 1e-3).mean() == pytest.approx(0.2, abs=0.03)
    assert late.max() == pytest.approx(0.5 * 343.2 / 63e3, abs=1e-5)
    assert burst(drift_m=2e-3, drift_time_s=60.0).mean() - burst().mean() == pytest.approx(2e-3 / np.e, abs=1e-5)


def test_kits_on_their_own_clocks_hear_each_other_and_triggered_ones_do_not() -> None:
    free = Sounder(plane(), TUBE, replace(FINE, trigger="internal"))
    ranges, _ = free.ping(at(0.43), 5000, SILENT, np.random.default_rng(1), 0.0)
    early = ranges < 0.429
    window_s = 2 * 0.43 / 343.2 - FINE.blanking_s
    assert early.mean() == pytest.approx(3 * window_s / FINE.period_s, rel=0.2)
    assert ranges[early].min() > free.nearest_m - 1e-3
    ranges, _ = Sounder(plane(), TUBE, FINE).ping(at(0.43), 5000, SILENT, np.random.default_rng(1), 0.0)
    assert np.ptp(ranges) < 1e-5


def test_empty_space_is_no_echo() -> None:
    ranges, amplitudes = Sounder(plane(), TUBE).ping(
        at(0.43, yaw_deg=180.0), 3, AcousticNoise(), np.random.default_rng(0), 0.0
    )
    assert np.all(ranges == np.inf)
    assert np.all(np.isnan(amplitudes))


def test_the_answer_does_not_depend_on_what_was_asked_before() -> None:
    used, fresh = Sounder(step(), TUBE), Sounder(step(), TUBE)
    for y in (-0.05, 0.3, 0.0):
        read(used, at(0.36, y))
    assert read(used, at(0.40, 0.01)) == read(fresh, at(0.40, 0.01))


@pytest.mark.parametrize("wrong", [{"aperture_m": 0.0}, {"tube_length_m": -0.1}, {"rise_time_s": float("nan")}])
def test_impossible_transducers_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="give"):
        TransducerParameters(**wrong)


@pytest.mark.parametrize("wrong", [{"cycles": 0}, {"blanking_s": 0.09}, {"gain": 0.0}, {"trigger": "never"}])
def test_impossible_kits_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError):
        KitParameters(**wrong)


@pytest.mark.parametrize("wrong", [{"timing_m": -1.0}, {"dropout": 2.0}, {"drift_time_s": 0.0}])
def test_impossible_noise_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="give"):
        AcousticNoise(**wrong)
