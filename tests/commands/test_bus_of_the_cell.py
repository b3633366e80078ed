"""The main job's array behind its node: the same numbers as without a bus, nothing left behind, limits told early."""

import math
import threading
import time
from dataclasses import asdict, replace
from functools import partial

import numpy as np
import pytest

from surfuse.commands.acquire.results import bus_event
from surfuse.errors import ConfigError
from surfuse.node.counters import BusEvent, Tally
from surfuse.node.timeouts import NodeTimeouts
from surfuse.records import Status
from surfuse.rig import node_array as array_on_bus
from surfuse.rig.mounts import looking_outwards, world_from_shoulder
from surfuse.rig.simulated.assembly import simulated_rig
from surfuse.settings import load

STOPS = (0, 7, 3)


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """A node in a busy machine is slow; to ask it again would change no number, but it is counted."""
    timeouts = partial(NodeTimeouts, answer_timeout_s=300.0, connect_timeout_s=300.0, adapter_limit_s=300.0)
    monkeypatch.setattr(array_on_bus, "NodeTimeouts", timeouts)


def cell_with(*overrides):
    return simulated_rig(load(None, ["scene.name=tilted", "array.pings=3", "arm.driver=kinematic", *overrides]))


def facing_the_part(cell, forward_m=0.69, height_m=1.10):
    """Joints that bring the grip 0.43 m in front of the part of the usual cell, looking outwards."""
    grip = world_from_shoulder(math.radians(35.0)) @ looking_outwards(forward_m, height_m)
    joints, reached = cell.motion.arm.kinematics.inverse(grip[None])
    return joints[0][reached[0]][0]


def sweeps_of(cell):
    found = []
    with cell.opened():
        for stop in STOPS:
            cell.begin("stop", stop)
            cell.motion.arm.move_to(facing_the_part(cell, height_m=1.10 + 0.005 * stop))
            found.append(cell.array.sweep())
    return found


def numbers(sweeps):
    return np.array([[(e.range_m, e.spread_m, e.amplitude, int(e.status), e.count) for e in s] for s in sweeps])


BITS_OF_A_SWEEP = 11 * 135  # a trigger, two words of the node, two frames a sensor; longest frames of 8 bytes


@pytest.mark.parametrize("bitrate_bps", [1_000_000, 10_000])
def test_the_bus_changes_no_number_and_takes_the_time_of_its_bits_after_each_sweep(bitrate_bps):
    plain, bus = cell_with("bus.interface=none"), cell_with(f"bus.bitrate_bps={bitrate_bps}")
    over_none, over_bus = sweeps_of(plain), sweeps_of(bus)
    assert all(echo.status is Status.OK for sweep in over_none for echo in sweep)
    np.testing.assert_array_equal(numbers(over_none), numbers(over_bus))
    times = [[[echo.t_s for echo in sweep] for sweep in sweeps] for sweeps in (over_none, over_bus)]
    sweep_s = BITS_OF_A_SWEEP / bitrate_bps
    later_s = np.arange(len(STOPS))[:, None] * sweep_s
    np.testing.assert_allclose(times[0] + later_s, times[1], rtol=0.0, atol=1e-6)
    assert bus.clock.now_s() == pytest.approx(plain.clock.now_s() + len(STOPS) * sweep_s, abs=1e-9)


def test_fired_together_over_the_bus_is_the_same_as_without_it_and_not_the_same_as_in_turn():
    at_once = "array.trigger=simultaneous"
    plain, bus, in_turn = cell_with("bus.interface=none", at_once), cell_with(at_once), cell_with()
    over_none, over_bus = sweeps_of(plain), sweeps_of(bus)
    np.testing.assert_array_equal(numbers(over_none), numbers(over_bus))
    later_s = len(STOPS) * BITS_OF_A_SWEEP * 1e-6
    assert bus.clock.now_s() == pytest.approx(plain.clock.now_s() + later_s, abs=1e-9)
    for sweep in over_bus:
        assert {echo.t_s for echo in sweep} == {sweep[0].t_s}
    alone = sweeps_of(in_turn)
    assert np.all(numbers(over_bus)[..., 2] > 1.05 * numbers(alone)[..., 2])  # the neighbours' bursts are heard too
    assert asdict(bus.counters())["too_fast"] == 0


def test_counters_are_those_of_the_sweeps_and_a_clean_bus_is_no_event():
    cell = cell_with()
    sweeps_of(cell)
    counts = asdict(cell.counters())
    assert (counts["triggers"], counts["readings"]) == (len(STOPS), 4 * len(STOPS))
    assert counts["lost"] == counts["retriggers"] == counts["failed"] == 0
    assert bus_event(cell) is None
    assert cell_with("bus.interface=none").counters is None


def test_trouble_on_the_bus_is_told():
    tally = Tally()
    tally.add(BusEvent.LOST, 2)
    event = bus_event(replace(cell_with("bus.interface=none"), counters=tally.snapshot))
    assert event is not None
    assert event.text == "lost 2"


def test_no_thread_outlives_the_cell_even_after_an_error():
    before = set(threading.enumerate())

    def fails():
        with cell_with().opened():
            assert "surfuse-node" in {thread.name for thread in set(threading.enumerate()) - before}
            raise RuntimeError("on the way")

    with pytest.raises(RuntimeError, match="on the way"):
        fails()
    while set(threading.enumerate()) - before:  # a thread that was told to end may need a moment
        time.sleep(0.01)


def test_two_cells_at_once_do_not_hear_each_other():
    one, two = cell_with(), cell_with("seed=2")
    with one.opened(), two.opened():
        for cell in (one, two, one):
            cell.array.sweep()
    assert asdict(one.counters())["readings"] == 8
    assert asdict(one.counters())["unsolicited"] == asdict(two.counters())["unsolicited"] == 0


def test_what_the_bus_cannot_do_is_refused_with_a_cure():
    with pytest.raises(ConfigError, match=r"bus\.interface = 'none'"):
        load(None, ["array.pings=32"])
    load(None, ["array.pings=32", "bus.interface=none"])


def test_an_unknown_bus_is_refused_before_anything_moves():
    with pytest.raises(ConfigError, match="python-can knows"):
        cell_with("bus.interface=telepathy")
