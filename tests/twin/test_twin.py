from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from surfuse.errors import ConfigError
from surfuse.geometry.poses import pose
from surfuse.interfaces import World
from surfuse.records import CameraModel, SensorSpec
from surfuse.rig.description import array_spec
from surfuse.rig.simulated.assembly import build_world
from surfuse.rig.simulated.ranger_bench import Bench
from surfuse.sensors.polaroid import SPEC
from surfuse.settings import SceneSettings, load
from surfuse.twin.acoustics.kit import BARE, TUBE, KitParameters
from surfuse.twin.materials import MATERIALS, PARTS, Material, Surface, with_material, with_roughness
from surfuse.twin.parts import make_part
from surfuse.twin.scene import Scene, table_bodies
from surfuse.twin.world import Twin, TwinParameters, transducer_of

TUBE_SPEC = SensorSpec("us0", "ultrasonic", 0.33, 4.0, 0.2, 3e-4, frequency_hz=63e3, aperture_m=0.04, dead_length_m=0.2)
BARE_SPEC = SensorSpec("shoulder", "ultrasonic", 0.33, 4.0, 0.4, 3e-4, frequency_hz=63e3, aperture_m=0.017)
LOOK = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
THERE = pose(LOOK, [0.67, 0.01, 1.14])


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene([*table_bodies(), make_part("relief").body])


def test_the_twin_is_a_world(scene: Scene) -> None:
    assert isinstance(Twin(scene), World)
    assert Twin(scene).scene is scene


def test_a_stop_is_the_same_whatever_ran_before(scene: Scene) -> None:
    fresh, used = Twin(scene, seed=4), Twin(scene, seed=4)
    camera = CameraModel(20, 20, 30.0, 30.0, 10.0, 10.0)
    for index in range(3):
        used.begin("scan", index)
        used.ping(THERE, TUBE_SPEC, 5, 0.0)
        used.image(camera, THERE)
        used.repeatability(6)
    fresh.begin("scan", 7)
    used.begin("scan", 7)
    # Other devices at the same stop do not disturb a sensor's stream either.
    used.image(camera, THERE)
    used.ping(THERE, BARE_SPEC, 5, 0.0)
    for _ in range(2):
        one, other = fresh.ping(THERE, TUBE_SPEC, 5, 0.0), used.ping(THERE, TUBE_SPEC, 5, 0.0)
        assert np.array_equal(one[0], other[0])
        assert np.array_equal(one[1], other[1])
    assert np.array_equal(fresh.repeatability(6), used.repeatability(6))


def test_another_kit_drives_the_sensor_from_its_next_ping_on(scene: Scene) -> None:
    twin = Twin(scene, seed=4)
    usual = twin.kit(TUBE_SPEC)
    twin.ping(THERE, TUBE_SPEC, 1, 0.0)
    other = replace(usual, cycles=usual.cycles + 4)
    twin.set_kit(TUBE_SPEC.name, other)
    assert twin.kit(TUBE_SPEC) == other
    assert twin.sounder(TUBE_SPEC).kit == other
    # Other sensors keep theirs.
    assert twin.kit(BARE_SPEC).cycles == usual.cycles


def test_stops_stages_and_seeds_differ(scene: Scene) -> None:
    def noise(seed: int, stage: str, index: int) -> tuple[float, ...]:
        twin = Twin(scene, seed=seed)
        twin.begin(stage, index)
        return tuple(twin.repeatability(3))

    draws = {noise(1, "scan", 0), noise(2, "scan", 0), noise(1, "search", 0), noise(1, "scan", 1)}
    assert len(draws) == 4
    # Fixed over processes and versions: a resumed run must repeat an old one.
    assert noise(1, "scan", 0) == pytest.approx(STOP_ZERO, rel=1e-12)


STOP_ZERO = tuple(
    5e-5
    * np.random.Generator(np.random.PCG64(np.random.SeedSequence(1, spawn_key=(3300111278, 0, 2, 0)))).normal(size=3)
)


def test_shoulder_and_wrist_hear_differently(scene: Scene) -> None:
    twin = Twin(scene)
    wrist = twin.ping(THERE, TUBE_SPEC, 5, 0.0)[0].mean()
    shoulder = twin.ping(THERE, BARE_SPEC, 5, 0.0)[0].mean()
    assert wrist == pytest.approx(0.52, abs=2e-3)  # the plate, over the block
    assert shoulder < 0.47  # the wide beam hears the block's edge
    assert twin.sounder(TUBE_SPEC) is twin.sounder(replace(TUBE_SPEC, name="us1"))


def test_acoustics_come_by_name_or_from_the_spec(scene: Scene) -> None:
    # A spec says no more of the response than that its sensor is made for its frequency.
    assert transducer_of(TUBE_SPEC) == replace(TUBE, resonance_hz=0.0)
    assert transducer_of(BARE_SPEC) == replace(BARE, resonance_hz=0.0)
    twin = Twin(scene, TwinParameters(transducers={"us0": BARE}, kit=KitParameters(frequency_hz=50e3)))
    assert twin.sounder(TUBE_SPEC).transducer == BARE
    assert twin.sounder(TUBE_SPEC).kit.frequency_hz == 50e3
    assert twin.sounder(BARE_SPEC).kit.frequency_hz == 63e3


def test_the_cell_s_transducers_answer_less_when_the_kit_leaves_their_band() -> None:
    def strength(frequency_khz: int) -> float:
        settings = load(None, ["scene.name=flat", "scene.azimuth_deg=0.0", f"kit.frequency_hz={frequency_khz}e3"])
        twin, _ = build_world(settings)
        return float(twin.ping(THERE, array_spec(settings, "us0"), 5, 0.0)[1].mean())

    assert strength(55) > strength(63) > strength(75) > strength(90)


def test_an_optical_ranger_measures_along_its_axis(scene: Scene) -> None:
    laser = SensorSpec("ir0", "infrared", 0.05, 2.0, 0.02, 1e-3)
    ranges, amplitudes = Twin(scene).ping(THERE, laser, 400, 0.0)
    assert ranges.mean() == pytest.approx(0.52, abs=3e-4)
    assert ranges.std() == pytest.approx(1e-3, rel=0.2)
    assert np.all(np.isnan(amplitudes))
    up = pose(np.eye(3), [0.0, 0.0, 2.0])
    assert np.all(np.isposinf(Twin(scene).ping(up, laser, 3, 0.0)[0]))


def test_repeatability_has_the_asked_width(scene: Scene) -> None:
    twin = Twin(scene, TwinParameters(repeatability_rad=1e-3))
    assert twin.repeatability(5000).std() == pytest.approx(1e-3, rel=0.05)


def heard_share(material: str, tilt_deg: float) -> float:
    """Share of readings through the tube that a tilted plate 0.43 m away answers."""
    return Bench(SPEC, material=material, seed=4).measure(0.43, np.radians(tilt_deg), 100).heard


def test_the_usual_part_has_the_limit_of_the_paper() -> None:
    assert SceneSettings().material == "painted"
    assert heard_share("painted", 20.0) > 0.85
    assert 0.25 < heard_share("painted", 27.5) < 0.75
    assert heard_share("painted", 32.5) < 0.10


def test_materials_do_what_they_are_described_to_do() -> None:
    assert heard_share("matte", 45.0) > 0.9
    assert heard_share("metal", 6.0) == 1.0
    assert heard_share("metal", 9.0) == 0.0
    facing = {name: Bench(SPEC, material=name).measure(0.43, 0.0, 20).amplitude.mean() for name in PARTS}
    assert facing["foam"] < 0.4 < 0.9 < min(facing[name] for name in ("painted", "matte", "metal"))
    assert with_material("matte") == with_roughness(0.35) == MATERIALS
    with pytest.raises(ConfigError, match="did you mean 'metal'"):
        with_material("metall")


def test_roughness_runs_from_mirror_to_diffuse() -> None:
    mirror, usual, rough = (with_roughness(value)[Material.PART] for value in (0.0, 0.35, 1.0))
    assert (mirror.roughness_m, mirror.diffuse) == (0.0, 0.0)
    assert usual.diffuse == pytest.approx(0.20)
    assert rough.diffuse > 0.9
    with pytest.raises(ConfigError, match="roughness"):
        with_roughness(1.5)


def test_impossible_twins_are_refused(scene: Scene) -> None:
    with pytest.raises(ConfigError, match="seed"):
        Twin(scene, seed=-1)
    with pytest.raises(ConfigError, match="repeatability"):
        TwinParameters(repeatability_rad=-1.0)


def test_the_configuration_names_the_material_and_files_of_version_0_1_keep_their_part() -> None:
    def part(assignments: list[str], file: Path | None = None) -> Surface:
        world, _ = build_world(load(file, assignments))
        return world.parameters.surfaces[Material.PART]

    golden = Path(__file__).parents[1] / "data" / "golden" / "v0.1.0" / "relief_paper" / "run.toml"
    assert part([]) == PARTS["painted"]
    assert part(["scene.material=foam"]) == PARTS["foam"]
    assert part(["scene.roughness=0.0"]).diffuse == 0.0
    assert "roughness = 0.35" in golden.read_text("utf-8")
    assert part([], golden) == PARTS["matte"]
    with pytest.raises(ConfigError, match=r"scene\.material"):
        load(None, ["scene.material=wood"])
