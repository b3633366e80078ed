"""The ranging kit: lines of the protocol, and the whole driver against the twin's kit on a pseudo-terminal."""

from __future__ import annotations

import binascii
import math
import os
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surfuse.errors import ConfigError, DeviceError
from surfuse.node.messages import KitMessage
from surfuse.records import Status
from surfuse.sensors.ranging_kit import SPEC, Parameters, create
from surfuse.serial_line.kit_words import as_fields, changed_by, framed, unframed
from surfuse.twin.acoustics.air import AirParameters
from surfuse.twin.acoustics.kit import TUBE, KitParameters
from surfuse.twin.world import TwinParameters

posix = pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")


def terminal(**named):
    pytest.importorskip("serial")
    sys.path.insert(0, str(Path(__file__).parents[1] / "stand_ins"))
    from kit_terminal import KitTerminal

    return KitTerminal(**named)


@pytest.fixture
def kit():
    with terminal() as made:
        yield made


def echo_of(kit, **changes):
    with create(Parameters(kit.port, timeout_s=60.0, **changes)) as sensor:
        return sensor.fire()


# --- lines


def test_lines_are_those_of_the_page():
    page = (Path(__file__).parents[2] / "docs" / "reference" / "kit_serial.md").read_text("utf-8")
    examples = [line for line in page.splitlines() if line.startswith("$") and "*" in line]
    assert len(examples) >= 8
    for example in examples:
        word, number, fields = unframed(example)
        assert framed(word, number, *fields) == example.encode() + b"\r\n"


def test_the_check_is_the_common_one():
    assert binascii.crc_hqx(b"123456789", 0xFFFF) == 0x29B1  # as catalogues of CRCs give it for CCITT-FALSE
    assert framed("GET", 9) == b"$GET,9*%04X\r\n" % binascii.crc_hqx(b"GET,9", 0xFFFF)


@given(st.integers(0, 200), st.integers(1, 255))
def test_one_damaged_byte_is_always_seen(place, change):
    line = bytearray(framed("PING", 12, "1", "5", "2505.125", "0.9870")[:-2])
    line[place % len(line)] ^= change
    assert unframed(line.decode("latin-1")) is None


@pytest.mark.parametrize("text", ["", "$", "$GET,9", "GET,9*0000", "$GET*0000", "$get,9*" + "0" * 4, "$GET,99999*0000"])
def test_what_is_no_line_is_none(text):
    assert unframed(text) is None


def test_parameters_go_over_the_line_and_back():
    kit = KitMessage(50_000, 8, 2_100, 37.5, 400_000)
    assert changed_by(KitMessage(), as_fields(kit)) == replace(kit, pings=KitMessage().pings)
    assert changed_by(kit, ("CYC=9",)) == replace(kit, cycles=9)


@pytest.mark.parametrize(
    ("field", "word"),
    [
        ("FREQ=63001", "VALUE"),
        ("FREQ=-2", "VALUE"),
        ("CYC=0", "VALUE"),
        ("GAIN=40", "VALUE"),
        ("GAIN=40.2", "VALUE"),
        ("GAIN=900.0", "VALUE"),
        ("TRIG=NOW", "VALUE"),
        ("RATE=1e6", "VALUE"),
        ("BLANK", "VALUE"),
        ("VOLUME=3", "NAME"),
    ],
)
def test_a_wrong_field_is_an_error_word(field, word):
    assert changed_by(KitMessage(), (field,)) == word


# --- the driver against the twin's kit


@posix
def test_it_reads_the_plate_and_averages_its_pings(kit):
    echo = echo_of(kit)
    assert (echo.status, echo.count) == (Status.OK, 5)
    assert echo.range_m == pytest.approx(0.43, abs=1e-3)
    assert 0.0 < echo.spread_m < 1e-3
    assert kit.world.kit(SPEC) == KitParameters()


@posix
def test_what_is_set_is_what_the_twin_s_kit_has(kit):
    echo_of(
        kit, transmit_hz=50_000, cycles=8, blanking_s=1.5e-3, gain_db=46.0, sample_rate_hz=400_000, trigger="internal"
    )
    found = kit.world.kit(SPEC)
    assert (found.frequency_hz, found.cycles, found.sample_rate_hz) == (50e3, 8, 400e3)
    assert (found.blanking_s, found.trigger) == (pytest.approx(1.5e-3), "internal")
    assert found.gain == pytest.approx(10.0 ** (6.0 / 20.0))


@posix
def test_every_parameter_has_its_effect(kit):
    usual = echo_of(kit)
    assert echo_of(kit, transmit_hz=80_000).amplitude < 0.5 * usual.amplitude
    assert echo_of(kit, cycles=4).amplitude < usual.amplitude
    assert echo_of(kit, blanking_s=2.6e-3).status in (Status.TOO_CLOSE, Status.NO_ECHO)
    assert echo_of(kit, gain_db=0.0).status is Status.NO_ECHO
    assert echo_of(kit, sample_rate_hz=20_000, pings=9).spread_m > 1e-3
    assert echo_of(kit, pings=9).count == 9
    alone, crossed = (
        [echo_of(kit, trigger=trigger, pings=31) for _ in range(3)] for trigger in ("external", "internal")
    )
    assert all(echo.count == 31 for echo in alone)
    assert any(echo.count < 31 for echo in crossed)


@posix
def test_the_speed_of_sound_is_that_of_the_air():
    physics = TwinParameters(transducers={SPEC.name: TUBE}, air=AirParameters(temperature_c=30.0))
    with terminal(parameters=physics) as kit:
        cold, warm = echo_of(kit), echo_of(kit, air_temperature_c=30.0)
        told = echo_of(kit, sound_speed_m_s=200.0)
    assert cold.range_m == pytest.approx(0.43 * math.sqrt(293.15 / 303.15), abs=2e-3)
    assert warm.range_m == pytest.approx(0.43, abs=2e-3)
    assert warm.range_m > cold.range_m + 5e-3
    assert told.status is Status.TOO_CLOSE


@posix
def test_a_delay_is_taken_off(kit):
    assert echo_of(kit).range_m - echo_of(kit, delay_s=1e-4).range_m == pytest.approx(0.5 * 343.2e-4, abs=1e-3)


@posix
def test_an_answer_that_was_damaged_once_is_asked_for_again(kit):
    damaged = []

    def damage(line):
        if b"PING" in line and not damaged:
            damaged.append(line)
            return line.replace(b",", b";", 1)
        return line

    kit.kit.damage = damage
    with create(Parameters(kit.port, timeout_s=60.0)) as sensor:
        echo = sensor.fire()
        assert sensor.rejected == 1
    assert (echo.status, echo.count) == (Status.OK, 5)


@posix
@pytest.mark.parametrize(
    "damage",
    [
        lambda line: line[:-4] + b"\r\n" if b"PING" in line else line,
        lambda line: b"" if b",3,5," in line else line,
        lambda line: line.replace(b"PING", b"P\xffNG"),
        lambda line: line[:-2] + b"\x00" * 700 + line[-2:] if b"PING" in line else line,
    ],
)
def test_answers_that_are_damaged_again_and_again_are_a_fault(kit, damage):
    with create(Parameters(kit.port, timeout_s=0.5)) as sensor:
        kit.kit.damage = damage
        echo = sensor.fire()
        assert (echo.status, echo.count) == (Status.FAULT, 0)
        kit.kit.damage = lambda line: line
        # What was said before may still be on its way.
        assert any(sensor.fire().status is Status.OK for _ in range(50))


@posix
def test_answers_to_other_questions_are_passed_over(kit):
    kit.kit.damage = lambda line: framed("PING", 9998, "1", "5", "100.000", "1.0000") + line
    assert echo_of(kit).range_m == pytest.approx(0.43, abs=1e-3)


@posix
def test_a_question_that_arrived_damaged_is_asked_again(kit):
    heard = kit.kit.hear
    spoilt = []

    def hear(data):
        if b"FIRE" in data and not spoilt:
            spoilt.append(data)
            data = data.replace(b"FIRE", b"F_RE")
        return heard(data)

    kit.kit.hear = hear
    assert echo_of(kit).status is Status.OK
    assert spoilt


@posix
def test_a_kit_that_was_switched_off_is_set_again(kit):
    with create(Parameters(kit.port, cycles=8, timeout_s=60.0)) as sensor:
        sensor.fire()
        kit.power_cycle(KitParameters())
        assert sensor.fire().status is Status.OK
        assert kit.world.kit(SPEC).cycles == 8


@posix
def test_what_the_kit_cannot_have_is_refused_with_its_word(kit):
    with pytest.raises(DeviceError, match="VALUE, the kit cannot have this value"):
        echo_of(kit, transmit_hz=2_000)
    with pytest.raises(DeviceError, match="VALUE"):
        echo_of(kit, blanking_s=0.03)


@posix
def test_a_kit_with_other_parameters_than_set_is_refused(kit):
    kit.kit.damage = lambda line: (
        framed("PAR", unframed(line[:-2].decode())[1], *as_fields(KitMessage())) if (b"PAR" in line) else line
    )
    with pytest.raises(DeviceError, match="after it was set to"):
        echo_of(kit)


@posix
def test_a_kit_of_another_version_is_refused(kit):
    kit.kit.damage = lambda line: framed("KIT", unframed(line[:-2].decode())[1], "7", "x") if b"KIT" in line else line
    with pytest.raises(DeviceError, match="version 7"):
        echo_of(kit)


@posix
def test_silence_is_a_device_error(kit):
    with create(Parameters(kit.port, timeout_s=0.2)) as sensor:
        sensor.fire()
        kit.kit.damage = lambda line: b""
        with pytest.raises(DeviceError, match=r"no answer of the kit to FIRE within 0\.2 s") as caught:
            sensor.fire()
    assert caught.value.cure


@posix
def test_a_cable_that_is_pulled_out_is_a_device_error(kit):
    with create(Parameters(kit.port, timeout_s=0.5)) as sensor:
        sensor.fire()
        kit.vanish()
        with pytest.raises(DeviceError) as caught:
            sensor.fire()
    assert caught.value.cure


@posix
@given(data=st.lists(st.binary(max_size=60), max_size=6))
def test_any_bytes_leave_the_twin_s_kit_whole(data):
    sys.path.insert(0, str(Path(__file__).parents[1] / "stand_ins"))
    from kit_terminal import DamagedKit

    class Untouched:
        def kit(self, spec):
            return KitParameters()

    kit = DamagedKit(Untouched(), SPEC, None, None)
    said = [line for portion in data for line in kit.hear(portion)]
    assert all(line.startswith(b"$ER,0,SUM*") for line in said)
    list(kit.hear(b"\n"))
    (answer,) = kit.hear(framed("GET", 3))
    assert answer.startswith(b"$PAR,3,FREQ=63000,CYC=16,BLANK=1900,GAIN=40.0,RATE=1000000,TRIG=EXT*")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"port": ""}, "port = ''"),
        ({"baud_bps": 1}, "baud_bps"),
        ({"trigger": "loud"}, "external, internal"),
        ({"transmit_hz": 63_001}, "frequency_hz = 63001"),
        ({"pings": 32}, "pings = 32"),
        ({"gain_db": 40.2}, "gain_db"),
        ({"blanking_s": 1.0}, "blanking_s"),
        ({"sound_speed_m_s": 34.0}, "sound_speed_m_s"),
        ({"air_temperature_c": 293.0}, "air_temperature_c"),
        ({"timeout_s": 0.0}, "timeout_s"),
    ],
)
def test_parameters_check_themselves(changes, words):
    with pytest.raises(ConfigError, match=words):
        Parameters(**{"port": "/dev/ttyS0", **changes})
