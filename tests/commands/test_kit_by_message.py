"""The kit's parameters, told to a simulated node over the bus."""

import math
from dataclasses import replace

import numpy as np
import pytest

from surfuse.errors import DeviceError
from surfuse.node.array import CanArray, Parameters
from surfuse.node.catalogue import Catalogue
from surfuse.node.counters import Tally
from surfuse.node.disturbed_bus import DirectLink
from surfuse.node.messages import TriggerSource
from surfuse.node.responder import NodeAbilities, NodeIdentity, Responder
from surfuse.node.timeouts import NodeTimeouts
from surfuse.records import Status
from surfuse.rig.description import square_fixture
from surfuse.rig.mounts import looking_outwards, world_from_shoulder
from surfuse.rig.simulated.kit_by_message import kit_as_message, kit_from_message
from surfuse.rig.simulated.tethered_sensors import TetheredSensors
from surfuse.settings import load
from surfuse.twin.acoustics.kit import KitParameters
from surfuse.twin.tether import Place

GRIP = world_from_shoulder(math.radians(35.0)) @ looking_outwards(0.69, 1.11)


class Rig:
    """A simulated node without a thread, told by a host what its twin is and where the arm stands."""

    def __init__(self, *overrides):
        self.settings = load(None, ["scene.name=flat", *overrides])
        self.simulated = TetheredSensors()
        self.clock = self.simulated.clock
        abilities = NodeAbilities(configure=self.simulated.set_kit, fire_together=self.simulated.fire_together)
        node = Responder(self.simulated.sensors, self.clock, NodeIdentity(), Catalogue(), abilities)
        link = DirectLink(node, self.clock)
        parameters = Parameters(timeouts=NodeTimeouts(roll_call_s=0.0))
        fixture = square_fixture(self.settings)
        self.array = CanArray(fixture, parameters, link, self.clock, Tally(), link.monotonic_s)

    def stand(self):
        self.simulated.configure(self.settings.model_dump())
        self.simulated.move(Place("stop", 1, self.clock.now_s(), GRIP))


def test_what_is_told_of_a_kit_is_what_is_heeded():
    kit = KitParameters(frequency_hz=55e3, cycles=8, blanking_s=2.0e-3, gain=1.0, sample_rate_hz=2e5)
    again = kit_from_message(kit_as_message(kit, 5), KitParameters())
    assert again == kit
    assert kit_as_message(replace(kit, trigger="internal"), 5).trigger_source is TriggerSource.INTERNAL
    assert kit_from_message(kit_as_message(replace(kit, gain=2.0), 5), kit).gain == pytest.approx(
        2.0, rel=0.03
    )  # steps of 0.5 dB


def test_the_usual_kit_told_over_the_bus_changes_no_number():
    rig, plain = Rig(), Rig()
    rig.stand()
    plain.stand()
    with rig.array as array, plain.array as other:
        array.configure(kit_as_message(KitParameters(), 5))
        assert [e.range_m for e in array.sweep()] == [e.range_m for e in other.sweep()]


def test_every_told_parameter_acts():
    rig = Rig()
    rig.stand()
    usual = kit_as_message(KitParameters(), 5)
    with rig.array as array:
        strength = np.mean([echo.amplitude for echo in array.sweep()])
        array.configure(replace(usual, frequency_hz=80_000))
        assert np.mean([echo.amplitude for echo in array.sweep()]) < 0.5 * strength
        array.configure(replace(usual, pings=9))
        assert {echo.count for echo in array.sweep()} == {9}
        array.configure(replace(usual, gain_db=0.0), 2)
        assert [echo.status for echo in array.sweep()] == [Status.OK, Status.OK, Status.NO_ECHO, Status.OK]
        array.configure(replace(usual, blanking_us=2600))
        assert {echo.status for echo in array.sweep()} <= {Status.TOO_CLOSE, Status.NO_ECHO}
        array.configure(replace(usual, sample_rate_hz=20_000))
        spread = np.mean([echo.spread_m for echo in array.sweep()])
        assert spread > 1e-3
        array.configure(usual)
        assert np.mean([echo.spread_m for echo in array.sweep()]) < 1e-3


@pytest.mark.parametrize(("blanking_s", "nearest_m"), [(0.0, 0.2), (1e-3, 0.2), (1.9e-3, 0.3260)])
def test_the_nearest_range_is_behind_the_blanking_and_the_tube(blanking_s, nearest_m):
    rig = Rig(f"kit.blanking_s={blanking_s}")
    assert [spec.range_min_m for spec in rig.array.fixture.specs] == pytest.approx([nearest_m] * 4, abs=1e-4)
    rig.stand()
    with rig.array as array:
        array.configure(replace(kit_as_message(KitParameters(), 5), blanking_us=round(1e6 * blanking_s)))
        assert len(array.sweep()) == 4


def test_a_kit_that_cannot_be_is_refused_and_the_old_one_stays():
    rig = Rig()
    rig.stand()
    with rig.array as array:
        with pytest.raises(DeviceError, match="refuses"):
            array.configure(replace(kit_as_message(KitParameters(), 5), frequency_hz=2000))
        assert {echo.status for echo in array.sweep()} == {Status.OK}


def test_a_node_that_no_host_has_configured_refuses():
    with Rig().array as array, pytest.raises(DeviceError, match="refuses"):
        array.configure(kit_as_message(KitParameters(), 5))
