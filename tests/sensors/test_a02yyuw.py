"""A02YYUW: byte pairs, damaged frames, fuzz, and the whole driver on a pseudo-terminal."""

import math
import os
import threading
import tty

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surfuse.errors import ConfigError
from surfuse.records import Status
from surfuse.sensors.a02yyuw import Parameters, Parser, create


def frame(number):
    head = bytes([0xFF, number >> 8, number & 0xFF])
    return head + bytes([sum(head) & 0xFF])


@pytest.mark.parametrize(
    ("data", "status", "range_m"),
    [
        (bytes.fromhex("FF 07 A1 A7"), Status.OK, 1.953),
        (frame(31), Status.OK, 0.031),
        (frame(4499), Status.OK, 4.499),
        (frame(30), Status.TOO_CLOSE, -math.inf),
        (frame(0), Status.TOO_CLOSE, -math.inf),
        (frame(4500), Status.NO_ECHO, math.inf),
        (frame(0xFFFD), Status.NO_ECHO, math.inf),
        (frame(0xFFFE), Status.FAULT, math.nan),
    ],
)
def test_a_frame_is_its_range(data, status, range_m):
    (reading,) = Parser().feed(data)
    assert reading.status is status
    assert reading.range_m == pytest.approx(range_m, nan_ok=True)


def test_a_wrong_sum_is_refused_and_the_frame_after_the_next_counts():
    parser = Parser()
    assert parser.feed(bytes.fromhex("FF 07 A1 A8") + frame(500)) == []
    assert [reading.range_m for reading in parser.feed(frame(600) + frame(700))] == [0.6, 0.7]
    assert parser.rejected == 1


def test_a_piece_of_a_frame_before_the_first_does_not_matter():
    parser = Parser()
    readings = parser.feed(b"\xa1\xa7" + frame(500) + frame(600))
    assert [reading.range_m for reading in readings] == [0.6]


def test_reset_forgets_half_a_frame():
    parser = Parser()
    parser.feed(frame(1000)[:2])
    parser.reset()
    assert [reading.range_m for reading in parser.feed(frame(2000))] == [2.0]


@given(st.lists(st.integers(31, 4499), min_size=1, max_size=20), st.data())
def test_portions_do_not_matter(numbers, data):
    stream = b"".join(map(frame, numbers))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    parser = Parser()
    readings = []
    for start, stop in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        readings += parser.feed(stream[start:stop])
    assert [round(reading.range_m * 1000) for reading in readings] == numbers
    assert parser.rejected == 0


@given(st.lists(st.integers(31, 4499), min_size=3, max_size=10), st.integers(0, 39), st.integers(0, 7))
def test_one_flipped_bit_is_never_a_wrong_range(numbers, place, bit):
    stream = bytearray(b"".join(map(frame, numbers)))
    stream[place % len(stream)] ^= 1 << bit
    readings = Parser().feed(bytes(stream))
    assert {round(reading.range_m * 1000) for reading in readings} <= set(numbers)


@given(st.lists(st.binary(max_size=20), max_size=20))
def test_no_bytes_break_it(portions):
    parser = Parser()
    for portion in portions:
        for reading in parser.feed(portion):
            assert (reading.status is Status.OK) == math.isfinite(reading.range_m)
    assert len(parser._buffer) < 4


def test_the_driver_on_a_pseudo_terminal():
    controller, device = os.openpty()
    tty.setraw(controller)
    tty.setraw(device)
    stop = threading.Event()

    def talk():
        while not stop.wait(0.01):
            os.write(controller, frame(1953))

    talker = threading.Thread(target=talk)
    try:
        with create(Parameters(os.ttyname(device), timeout_s=60.0)) as sensor:
            talker.start()
            echo = sensor.fire()
            stop.set()
            talker.join()
            assert sensor.spec.name == "a02yyuw"
    finally:
        stop.set()
        os.close(controller)
        os.close(device)
    assert (echo.status, echo.range_m) == (Status.OK, 1.953)


def test_the_timeout_has_limits():
    with pytest.raises(ConfigError, match="timeout_s"):
        Parameters("/dev/ttyUSB0", timeout_s=math.nan)
