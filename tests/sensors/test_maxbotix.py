"""MaxBotix: byte pairs of the data sheets, damaged lines, fuzz, and the whole driver on a pseudo-terminal."""

import contextlib
import math
import os
import re
import threading
import time
import tty

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surfuse.errors import ConfigError, DeviceError
from surfuse.records import Status
from surfuse.sensors.maxbotix import MODELS, SPEC, Parameters, Parser, create
from surfuse.serial_line.ranger import SerialRanger


def feed(model, data):
    parser = Parser(MODELS[model])
    return [(reading.status, reading.range_m) for reading in parser.feed(data)], parser.rejected


OK = Status.OK


@pytest.mark.parametrize(
    ("model", "data", "expected"),
    [
        ("hrxl-5m", b"R1234\r", (OK, 1.234)),
        ("hrxl-5m", b"R0301\r", (OK, 0.301)),
        ("hrxl-5m", b"R0300\r", (Status.TOO_CLOSE, -math.inf)),
        ("hrxl-5m", b"R5000\r", (Status.NO_ECHO, math.inf)),
        ("hrxl-5m", b"R9999\r", (Status.NO_ECHO, math.inf)),
        ("hrxl-10m", b"R9998\r", (OK, 9.998)),
        ("hrxl-10m", b"R9999\r", (Status.NO_ECHO, math.inf)),
        ("hrxl-10m", b"R0500\r", (Status.TOO_CLOSE, -math.inf)),
        ("xl", b"R123\r", (OK, 1.23)),
        ("xl", b"R020\r", (Status.TOO_CLOSE, -math.inf)),
        ("xl", b"R765\r", (Status.NO_ECHO, math.inf)),
        ("lv", b"R100\r", (OK, 2.54)),
        ("usb", b"R008 P1\r", (OK, 0.2032)),
        ("usb", b"R254 P0\r", (Status.NO_ECHO, math.inf)),
    ],
)
def test_a_line_is_its_range(model, data, expected):
    readings, rejected = feed(model, data)
    assert rejected == 0
    assert len(readings) == 1
    assert readings[0][0] is expected[0]
    assert readings[0][1] == pytest.approx(expected[1], abs=1e-12)


@pytest.mark.parametrize(
    ("model", "data"),
    [
        ("hrxl-5m", b"R123\r"),
        ("hrxl-5m", b"R12345\r"),
        ("hrxl-5m", b"R12 4\r"),
        ("hrxl-5m", b"R12\xff34\r"),
        ("hrxl-5m", b"1234\r"),
        ("hrxl-5m", b"r1234\r"),
        ("hrxl-5m", b"R-123\r"),
        ("hrxl-5m", b"\r"),
        ("hrxl-5m", b"R008 P1\r"),
        ("hrxl-5m", "R１２３４\r".encode()),
        ("xl", b"R1234\r"),
        ("usb", b"R008\r"),
        ("usb", b"R008 P2\r"),
    ],
)
def test_a_line_that_is_not_exactly_of_the_model_is_refused(model, data):
    assert feed(model, data) == ([], 1)


def test_the_parser_begins_anew_at_the_next_r():
    assert feed("hrxl-5m", b"R12R0444\r") == ([(OK, pytest.approx(0.444))], 0)
    assert feed("hrxl-5m", b"34\rR0444\r") == ([(OK, pytest.approx(0.444))], 1)
    assert feed("hrxl-5m", b"\xff\xffR0444\r\n\xffR0555\r")[0] == [
        (OK, pytest.approx(0.444)),
        (OK, pytest.approx(0.555)),
    ]


def test_an_endless_line_is_refused_without_growing():
    parser = Parser(MODELS["hrxl-5m"])
    for _ in range(1000):
        assert parser.feed(b"9" * 100) == []
    assert len(parser._line) <= 64
    assert len(parser.feed(b"R1234\r")) == 1


@given(st.lists(st.integers(301, 4999), min_size=1, max_size=20), st.data())
def test_portions_do_not_matter(numbers, data):
    stream = b"".join(b"R%04d\r" % number for number in numbers)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    parser = Parser(MODELS["hrxl-5m"])
    readings = []
    for start, stop in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        readings += parser.feed(stream[start:stop])
    assert [round(reading.range_m * 1000) for reading in readings] == numbers


@given(st.sampled_from(sorted(MODELS)), st.lists(st.one_of(st.binary(max_size=12), st.just(b"R1234\r")), max_size=20))
def test_no_bytes_break_it_and_every_number_stands_in_them(model, portions):
    parser = Parser(MODELS[model])
    readings = [reading for portion in portions for reading in parser.feed(portion)]
    written = re.findall(rb"R(\d+)(?: P[01])?\r", b"".join(portions))
    numbers = {int(digits) for digits in written}
    for reading in readings:
        if reading.status is Status.OK:
            assert round(reading.range_m / MODELS[model].unit_m) in numbers
        else:
            assert not math.isfinite(reading.range_m)


@pytest.fixture
def terminal():
    controller, device = os.openpty()
    tty.setraw(controller)
    tty.setraw(device)
    yield controller, os.ttyname(device)
    for end in (controller, device):
        with contextlib.suppress(OSError):
            os.close(end)


class Talker(threading.Thread):
    """Sends lines for ever, each a number higher, as a free-running sensor does; `number` is the last one sent."""

    def __init__(self, controller, pause_s=0.01, step=1):
        super().__init__(daemon=True)
        self.controller, self.pause_s, self.step = controller, pause_s, step
        self.stop, self.number = threading.Event(), 1000

    def run(self):
        while not self.stop.wait(self.pause_s):
            os.write(self.controller, b"R%04d\r" % (self.number + self.step))
            self.number += self.step


def test_the_driver_reads_a_line_that_is_younger_than_the_call(terminal):
    controller, port = terminal
    talker = Talker(controller)
    with create(Parameters(port, "hrxl-5m", timeout_s=60.0)) as sensor:
        assert sensor.spec == SPEC
        talker.start()
        while talker.number < 1003:  # lines from before the call lie in the port's memory
            time.sleep(0.001)
        before, start_s = talker.number, time.monotonic()
        echo = sensor.fire()
        talker.stop.set()
    talker.join()
    assert echo.status is Status.OK
    assert round(echo.range_m * 1000) > before
    assert start_s <= echo.t_s <= time.monotonic()
    assert echo.count == 1


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ([500, 777, 500, 3500, 501], None),
        ([500, 777, 778], 0.778),
        ([500, 300, 300], -math.inf),
        ([500, 300, 777, 5000, 790, 777], 0.777),
    ],
)
def test_lines_without_a_sum_count_when_two_in_a_row_agree(lines, expected):
    class Played(SerialRanger):
        def __enter__(self):
            self._line = object()
            return self

        def __exit__(self, kind, error, trace): ...

        def _read(self, line, *, fresh):
            return b"R%04d\r" % lines.pop(0) if lines and not fresh else b""

    # The last lines disagree: only then does the call end by its time.
    patience_s = 0.05 if expected is None else 60.0
    with Played(SPEC, Parser(MODELS["hrxl-5m"]), "", 9600, patience_s, time.monotonic, 0.03) as sensor:
        echo = sensor.fire()
    if expected is None:
        assert echo.status is Status.FAULT
    else:
        assert echo.range_m == expected


def test_any_line_counts_when_agreement_is_not_asked_for(terminal):
    controller, port = terminal
    talker = Talker(controller, step=100)
    with create(Parameters(port, "hrxl-5m", 60.0, agreement_m=math.inf)) as sensor:
        talker.start()
        assert sensor.fire().status is Status.OK
        talker.stop.set()
    talker.join()


def test_a_silent_sensor_is_a_fault(terminal):
    _, port = terminal
    with create(Parameters(port, "hrxl-5m", timeout_s=0.05)) as sensor:
        echo = sensor.fire()
    assert echo.status is Status.FAULT
    assert math.isnan(echo.range_m)
    assert echo.count == 0


def test_a_sensor_at_the_wrong_speed_is_a_fault(terminal):
    controller, port = terminal
    with create(Parameters(port, "hrxl-5m", timeout_s=0.1)) as sensor:
        os.write(controller, bytes(range(128, 256)) * 4)
        echo = sensor.fire()
    assert echo.status is Status.FAULT


def test_a_port_that_vanishes_is_an_error(terminal):
    controller, port = terminal
    with create(Parameters(port, "hrxl-5m", timeout_s=60.0)) as sensor:
        os.close(controller)
        with pytest.raises(DeviceError, match="vanished"):
            sensor.fire()


def test_a_port_that_is_not_there_is_an_error():
    with pytest.raises(DeviceError, match="/dev/no-such-port"), create(Parameters("/dev/no-such-port", "xl")):
        pass


def test_a_sensor_outside_its_block_is_an_error():
    with pytest.raises(DeviceError, match="not open"):
        create(Parameters("/dev/null", "xl")).fire()


def test_the_model_is_not_optional():
    with pytest.raises(TypeError):
        Parameters("/dev/ttyUSB0")
    with pytest.raises(ConfigError, match="did you mean 'hrxl-5m'"):
        Parameters("/dev/ttyUSB0", "hrxl5m")
    with pytest.raises(ConfigError, match="agreement_m"):
        Parameters("/dev/ttyUSB0", "xl", agreement_m=math.nan)
    with pytest.raises(ConfigError, match="timeout_s"):
        Parameters("/dev/ttyUSB0", "xl", timeout_s=0.0)
