"""The time of frames on the bus: bits as the standard builds them, counted by another way."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surfuse.node.bus_time import frame_bits, sweep_bus_s


def bits_with_stuffing(identifier: int, data: bytes, check: int) -> int:
    """Bits of one real frame: start, identifier, RTR, IDE, r0, length, data, check sum; then what is never stuffed."""
    text = f"0{identifier:011b}000{len(data):04b}" + "".join(f"{byte:08b}" for byte in data) + f"{check:015b}"
    stuffed, run, last = 0, 0, ""
    for bit in text:
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:  # a stuff bit of the other value begins a run of its own
            stuffed, last, run = stuffed + 1, "10"[int(bit)], 1
    return len(text) + stuffed + len("1011111111111")


@given(st.integers(0, 0x7FF), st.binary(max_size=8), st.integers(0, 0x7FFF))
def test_no_frame_is_longer(identifier, data, check):
    assert bits_with_stuffing(identifier, data, check) <= frame_bits(len(data))


def test_the_longest_frame_of_eight_bytes_has_135_bits():
    assert frame_bits() == 135


@pytest.mark.parametrize("sensors", [1, 4, 8])
def test_a_sweep_takes_longer_the_slower_the_bus_and_the_more_sensors(sensors):
    assert sweep_bus_s(sensors, 10_000) == pytest.approx(100.0 * sweep_bus_s(sensors, 1_000_000))
    assert sweep_bus_s(sensors + 1, 10_000) - sweep_bus_s(sensors, 10_000) == pytest.approx(2 * 135 / 10_000)


def test_the_frames_are_those_that_a_node_sends():
    from surfuse.interfaces import MonotonicClock
    from surfuse.node.catalogue import Catalogue
    from surfuse.node.messages import Trigger
    from surfuse.node.responder import NodeIdentity, Responder
    from surfuse.records import Echo, Status

    class Ranger:
        def fire(self):
            return Echo(1.0, Status.OK, MonotonicClock().now_s())

    catalogue = Catalogue()
    for sensors in (1, 4):
        node = Responder([Ranger()] * sensors, MonotonicClock(), NodeIdentity(), catalogue)
        asked = catalogue.encode(Trigger(1, 1, 0, (1 << sensors) - 1, 7, 0))
        frames = list(itertools.chain([asked], node.answer(asked)))
        assert sum(frame_bits(len(frame.data)) for frame in frames) * 1e-6 == pytest.approx(sweep_bus_s(sensors, 10**6))
