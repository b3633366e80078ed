"""TFmini family: three conventions for a bad reading, damaged frames, fuzz, and the driver on a pseudo-terminal."""

import math
import os
import threading
import tty

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surfuse.errors import ConfigError
from surfuse.records import Status
from surfuse.sensors.tfmini import MODELS, Parameters, Parser, create


def frame(distance_cm, strength=1000, tail=b"\x00\x00"):
    head = b"\x59\x59" + (distance_cm & 0xFFFF).to_bytes(2, "little") + strength.to_bytes(2, "little") + tail
    return head + bytes([sum(head) & 0xFF])


OK, FAULT, NONE, CLOSE = Status.OK, Status.FAULT, Status.NO_ECHO, Status.TOO_CLOSE


@pytest.mark.parametrize(
    ("model", "distance_cm", "strength", "status", "range_m"),
    [
        ("tfmini", 150, 1000, OK, 1.5),
        ("tfmini", 150, 20, OK, 1.5),
        ("tfmini", 0xFFFF, 19, FAULT, math.nan),
        ("tfmini", 150, 19, FAULT, math.nan),
        ("tfmini", 1200, 500, NONE, math.inf),
        ("tfmini", 29, 500, CLOSE, -math.inf),
        ("tfmini-s", 150, 101, OK, 1.5),
        ("tfmini-s", -1, 100, FAULT, math.nan),
        ("tfmini-s", -2, 65535, FAULT, math.nan),
        ("tfmini-s", -4, 5000, FAULT, math.nan),
        ("tfmini-s", 150, 100, FAULT, math.nan),
        ("tfmini-s", 10, 500, OK, 0.1),
        ("tfmini-s", 9, 500, CLOSE, -math.inf),
        ("tfmini-plus", 150, 100, OK, 1.5),
        ("tfmini-plus", 0, 99, FAULT, math.nan),
        ("tfmini-plus", 0, 65535, FAULT, math.nan),
        ("tfmini-plus", 0, 500, FAULT, math.nan),
        ("tfmini-plus", 1200, 500, NONE, math.inf),
    ],
)
def test_each_model_has_its_own_bad_reading(model, distance_cm, strength, status, range_m):
    (reading,) = Parser(MODELS[model]).feed(frame(distance_cm, strength))
    assert reading.status is status
    assert reading.range_m == pytest.approx(range_m, nan_ok=True)


def test_a_frame_of_the_manual():
    # 59 59 | 96 00 = 150 cm | E8 03 = 1000 | 00 00 | sum
    assert frame(150) == bytes.fromhex("59 59 96 00 E8 03 00 00 33")


def test_a_header_inside_a_frame_does_not_confuse():
    data = frame(0x5959 % 1200, 0x5959)
    parser = Parser(MODELS["tfmini-s"])
    readings = parser.feed(data[3:] + frame(100) + frame(200) + frame(300))
    assert [reading.range_m for reading in readings] == [2.0, 3.0]


@given(st.lists(st.integers(10, 1199), min_size=1, max_size=20), st.data())
def test_portions_do_not_matter(numbers, data):
    stream = b"".join(map(frame, numbers))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    parser = Parser(MODELS["tfmini-s"])
    readings = []
    for start, stop in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        readings += parser.feed(stream[start:stop])
    assert [round(reading.range_m * 100) for reading in readings] == numbers


@given(st.lists(st.integers(10, 1199), min_size=3, max_size=10), st.integers(0, 89), st.integers(0, 7))
def test_one_flipped_bit_is_never_a_wrong_range(numbers, place, bit):
    stream = bytearray(b"".join(map(frame, numbers)))
    stream[place % len(stream)] ^= 1 << bit
    readings = Parser(MODELS["tfmini-s"]).feed(bytes(stream))
    assert {round(reading.range_m * 100) for reading in readings} <= set(numbers)


@given(st.sampled_from(sorted(MODELS)), st.lists(st.binary(max_size=30), max_size=20))
def test_no_bytes_break_it(model, portions):
    parser = Parser(MODELS[model])
    for portion in portions:
        for reading in parser.feed(portion):
            assert (reading.status is Status.OK) == math.isfinite(reading.range_m)
    assert len(parser._buffer) < 9


def test_the_driver_on_a_pseudo_terminal():
    controller, device = os.openpty()
    tty.setraw(controller)
    tty.setraw(device)
    stop = threading.Event()

    def talk():
        os.write(controller, frame(333)[4:])
        while not stop.wait(0.005):
            os.write(controller, frame(150))

    talker = threading.Thread(target=talk)
    try:
        with create(Parameters(os.ttyname(device), "tfmini-plus", timeout_s=60.0)) as sensor:
            talker.start()
            echo = sensor.fire()
            stop.set()
            talker.join()
            assert sensor.spec.kind == "tof"
    finally:
        stop.set()
        os.close(controller)
        os.close(device)
    assert (echo.status, echo.range_m) == (Status.OK, 1.5)


def test_the_model_is_not_optional():
    with pytest.raises(TypeError):
        Parameters("/dev/ttyUSB0")
    with pytest.raises(ConfigError, match="did you mean 'tfmini-plus'"):
        Parameters("/dev/ttyUSB0", "tfminiplus")
