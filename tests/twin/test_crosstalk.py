"""Sensors that fire together hear each other's bursts; sensors that fire in turn do not."""

import math

import numpy as np
import pytest

from surfuse.errors import ConfigError
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import FloatArray, Status
from surfuse.rig.devices import Rig
from surfuse.rig.mounts import looking_outwards, world_from_shoulder
from surfuse.rig.simulated.assembly import simulated_rig
from surfuse.settings import load
from surfuse.twin.acoustics.crosstalk import ping_together
from surfuse.twin.acoustics.noise import SILENT
from surfuse.twin.acoustics.sounder import Sounder
from surfuse.twin.materials import Material
from surfuse.twin.scene import Scene, SceneBody

LOOK = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # beam along +x


def sheet(x: float, y_low: float, y_high: float) -> SceneBody:
    corners = np.array([[x, y_low, -0.4], [x, y_high, -0.4], [x, y_high, 0.4], [x, y_low, 0.4]])
    return SceneBody(corners, np.array([[0, 2, 1], [0, 3, 2]]), Material.PART_SMOOTH, np.eye(4))


def at(y: float, distance: float = 0.45) -> np.ndarray:
    return pose(LOOK, [-distance, y, 0.0])


def quiet(count: int) -> list[np.random.Generator]:
    return [np.random.default_rng(i) for i in range(count)]


def alone(sounder: Sounder, place: np.ndarray) -> float:
    return float(sounder.ping(place, 1, SILENT, np.random.default_rng(0), 0.0)[0][0])


def test_one_transducer_is_the_same_as_an_ordinary_ping() -> None:
    sounder = Sounder(Scene([sheet(0.0, -0.4, 0.4)]))
    ranges, strengths = ping_together(sounder, at(0.0)[None], 3, SILENT, quiet(1), 0.0)
    plain = sounder.ping(at(0.0), 3, SILENT, np.random.default_rng(0), 0.0)
    np.testing.assert_array_equal(ranges[0], plain[0])
    np.testing.assert_array_equal(strengths[0], plain[1])


def test_over_a_facing_plate_the_own_echo_is_first_and_the_neighbours_make_it_louder() -> None:
    sounder = Sounder(Scene([sheet(0.0, -0.4, 0.4)]))
    places = np.stack([at(-0.025), at(0.025)])
    ranges, strengths = ping_together(sounder, places, 1, SILENT, quiet(2), 0.0)
    single = sounder.ping(places[0], 1, SILENT, np.random.default_rng(0), 0.0)
    np.testing.assert_allclose(ranges[:, 0], single[0][0], atol=1e-3)
    assert np.all(strengths[:, 0] > 1.1 * single[1][0])


def test_the_path_of_a_pair_over_a_mirror_is_the_reflected_one() -> None:
    """Sender and receiver a baseline b apart, d in front of a plate: half the path is sqrt(d^2 + (b / 2)^2)."""
    sounder = Sounder(Scene([sheet(0.0, -0.4, 0.4)]))
    mouth = sounder.transducer.tube_length_m
    for baseline in (0.05, 0.10):
        places = np.stack([at(-0.5 * baseline), at(0.5 * baseline)])
        sounder.arrivals(places[0])
        from surfuse.twin.acoustics import crosstalk

        pair = crosstalk._added(crosstalk._nothing(sounder), sounder.arrivals(at(0.0)), 0.5 * baseline)
        centre = float(np.average(np.arange(sounder.bins) * 5e-4, weights=pair.mirror))
        assert centre == pytest.approx(math.hypot(0.45 - mouth, 0.5 * baseline), abs=1e-3)


def test_beside_a_step_a_neighbour_over_the_near_part_makes_the_reading_short() -> None:
    """The far sensor hears the near surface 9 cm too early, but only through its neighbour's burst."""
    sounder = Sounder(Scene([sheet(0.0, -0.4, 0.0), sheet(0.09, 0.0, 0.4)]))
    places = np.stack([at(-0.012), at(0.038)])
    far = alone(sounder, places[1])
    together, _ = ping_together(sounder, places, 1, SILENT, quiet(2), 0.0)
    assert far == pytest.approx(0.54, abs=3e-3)
    assert together[1, 0] < far - 0.05
    assert together[0, 0] == pytest.approx(alone(sounder, places[0]), abs=1e-3)


def test_beams_that_are_not_parallel_are_refused() -> None:
    turned = pose(rotation_about([0, 0, 1], math.radians(10.0)) @ LOOK, [-0.45, 0.05, 0.0])
    with pytest.raises(ConfigError, match="10 degrees apart"):
        ping_together(Sounder(Scene([sheet(0.0, -0.4, 0.4)])), np.stack([at(0.0), turned]), 1, SILENT, quiet(2), 0.0)


def facing_the_part(cell: Rig, forward_m: float = 0.69, height_m: float = 1.10) -> FloatArray:
    """Joints that bring the grip 0.43 m in front of the part of the usual cell, looking outwards."""
    grip = world_from_shoulder(math.radians(35.0)) @ looking_outwards(forward_m, height_m)
    joints, reached = cell.motion.arm.kinematics.inverse(grip[None])
    return joints[0][reached[0]][0]


def test_the_trigger_of_the_array_decides_in_the_cell() -> None:
    sweeps, seconds = {}, {}
    for trigger in ("sequential", "simultaneous"):
        cell = simulated_rig(
            load(None, ["scene.name=flat", "bus.interface=none", "arm.driver=kinematic", f"array.trigger={trigger}"])
        )
        cell.begin("stop", 0)
        cell.motion.arm.move_to(facing_the_part(cell))
        began_s = cell.clock.now_s()
        with cell.opened():
            sweeps[trigger] = cell.array.sweep()
        seconds[trigger] = cell.clock.now_s() - began_s
    assert seconds["sequential"] == pytest.approx(4.0 * seconds["simultaneous"])
    times = {echo.t_s for echo in sweeps["simultaneous"]}
    assert len(times) == 1
    assert all(echo.status is Status.OK for sweep in sweeps.values() for echo in sweep)
    pairs = zip(sweeps["simultaneous"], sweeps["sequential"], strict=True)
    assert all(together.amplitude > 1.1 * in_turn.amplitude for together, in_turn in pairs)
