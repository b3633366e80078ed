"""The catalogue against cantools, an independent decoder of the same DBC file, and against frames that are none."""

import importlib.resources
import math
from pathlib import Path

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surfuse.errors import ConfigError, DataError
from surfuse.node.catalogue import Catalogue, Rejection
from surfuse.node.messages import (
    Acknowledge,
    CanFrame,
    EchoDetail,
    FaultCode,
    FaultReport,
    Function,
    Heartbeat,
    KitMessage,
    KitPulse,
    KitSampling,
    NodeState,
    Query,
    Reading,
    Result,
    Subject,
    Trigger,
    TriggerSource,
    identifier,
)
from surfuse.records import Status

DBC = importlib.resources.files("surfuse.node") / "surfuse.dbc"
DATABASE = cantools.database.load_string(DBC.read_text(), "dbc")
CATALOGUE = Catalogue()
BYTE = st.integers(0, 255)
NODE = st.integers(1, 2)
SENSOR = st.integers(0, 7)
ATTEMPT = st.integers(0, 7)
MASK = st.integers(0, 0xFFFF)


def numbers(scaled: bool):
    return {"decode_choices": False, "scaling": scaled}


READINGS = st.builds(
    lambda node, sensor, sequence, session, status, pings, raw, spread, attempt: Reading(
        node,
        sensor,
        sequence,
        session,
        status,
        pings,
        {Status.OK: raw / 1e5, Status.NO_ECHO: math.inf, Status.TOO_CLOSE: -math.inf, Status.FAULT: math.nan}[status],
        spread / 1e5,
        attempt,
    ),
    NODE,
    SENSOR,
    BYTE,
    BYTE,
    st.sampled_from(Status),
    st.integers(1, 31),
    st.integers(1, 0x3FFFFE),
    st.integers(0, 0x7FFE),
    ATTEMPT,
)
ECHOES = st.builds(
    lambda amplitude, *head: EchoDetail(*head, amplitude / 20_000),
    st.integers(0, 0x3FFFE),
    NODE,
    SENSOR,
    BYTE,
    BYTE,
    st.integers(0, 0xFFFFFF),
    ATTEMPT,
    ATTEMPT,
)
OTHERS = st.one_of(
    st.builds(Trigger, NODE, BYTE, ATTEMPT, MASK, MASK, st.integers(0, 1)),
    st.builds(Acknowledge, NODE, BYTE, BYTE, st.sampled_from(Subject), st.sampled_from(Result), ATTEMPT, MASK),
    st.builds(Query, NODE, BYTE, MASK),
    st.builds(FaultReport, NODE, BYTE, BYTE, st.sampled_from(FaultCode), st.integers(0, 15), MASK),
    st.builds(Heartbeat, NODE, st.sampled_from(NodeState), BYTE, BYTE, BYTE, BYTE, BYTE, MASK),
    st.builds(
        KitSampling, NODE, BYTE, st.integers(0, 15), st.sampled_from(TriggerSource), st.integers(0, 2**24 - 1), ATTEMPT
    ),
    st.builds(
        KitPulse,
        NODE,
        BYTE,
        st.integers(0, 15),
        st.integers(0, 65535).map(lambda n: 2 * n),
        BYTE,
        MASK,
        BYTE.map(lambda n: n / 2),
    ),
)


def same(a, b):
    return type(a) is type(b) and all(x == y or (x != x and y != y) for x, y in zip(a, b, strict=True))


@given(st.one_of(READINGS, ECHOES, OTHERS))
def test_a_message_survives_its_frame(message):
    frame = CATALOGUE.encode(message)
    assert len(frame.data) == 8
    assert frame.identifier < 0x7F0
    assert same(CATALOGUE.decode(frame), message)


@given(READINGS)
def test_cantools_reads_the_same_reading(reading):
    frame = CATALOGUE.encode(reading)
    message = DATABASE.get_message_by_frame_id(frame.identifier)
    assert message.name == f"Reading_{reading.node}_{reading.sensor}"
    theirs = message.decode(frame.data, **numbers(True))
    assert (theirs["sequence"], theirs["session"], theirs["attempt"]) == (
        reading.sequence,
        reading.session,
        reading.attempt,
    )
    assert (theirs["status"], theirs["count"]) == (reading.status, reading.pings)
    assert theirs["spread"] * 1e-3 == pytest.approx(reading.spread_m, abs=1e-15)
    if reading.status is Status.OK:
        assert theirs["range"] * 1e-3 == pytest.approx(reading.range_m, rel=1e-14)
    else:
        assert message.decode(frame.data, **numbers(False))["range"] == 0x3FFFFF


@given(ECHOES)
def test_cantools_reads_the_same_echo(echo):
    frame = CATALOGUE.encode(echo)
    theirs = DATABASE.get_message_by_frame_id(frame.identifier).decode(frame.data, **numbers(True))
    assert theirs["time"] == echo.time_us
    assert (theirs["attempt"], theirs["accepted"]) == (echo.attempt, echo.accepted)
    assert theirs["amplitude"] == pytest.approx(echo.amplitude, rel=1e-12)


@given(OTHERS)
def test_cantools_reads_the_same_numbers(message):
    frame = CATALOGUE.encode(message)
    theirs = DATABASE.get_message_by_frame_id(frame.identifier).decode(frame.data, **numbers(True))
    ours = message if isinstance(message, Heartbeat) else message[1:]
    assert sorted(map(float, ours)) == pytest.approx(sorted(map(float, theirs.values())))


@given(st.sampled_from(DATABASE.messages), st.binary(min_size=8, max_size=8))
def test_whatever_cantools_encodes_is_decoded_or_refused(message, data):
    decoded = CATALOGUE.decode(CanFrame(message.frame_id, data))
    if isinstance(decoded, Rejection):
        assert decoded in (Rejection.UNKNOWN_WORD, Rejection.SENTINEL)
    elif isinstance(decoded, Reading):
        raw = message.decode(data, **numbers(False))
        assert (raw["status"] == Status.OK) == math.isfinite(decoded.range_m)
        assert CATALOGUE.encode(decoded).data == data


@given(st.integers(-1, 0xFFFF), st.binary(max_size=12))
def test_no_bytes_break_the_decoder(frame_id, data):
    CATALOGUE.decode(CanFrame(frame_id, data))


@pytest.mark.parametrize("length", [0, 7, 9, 64])
def test_a_wrong_length_is_no_message(length):
    assert CATALOGUE.decode(CanFrame(identifier(Function.READING, 1), bytes(length))) is Rejection.WRONG_LENGTH


def raw_reading(status, count, range_raw):
    bits = status << 16 | count << 19 | range_raw << 24
    return CanFrame(identifier(Function.READING, 1, 3), bits.to_bytes(8, "little"))


@pytest.mark.parametrize(
    ("frame", "rejection"),
    [
        (raw_reading(0, 4, 0x3FFFFF), Rejection.SENTINEL),
        (raw_reading(0, 4, 0), Rejection.SENTINEL),
        (raw_reading(0, 0, 43_000), Rejection.SENTINEL),
        (raw_reading(1, 4, 43_000), Rejection.SENTINEL),
        (raw_reading(5, 4, 43_000), Rejection.UNKNOWN_WORD),
        (CanFrame(0x7FF, bytes(8)), Rejection.FOREIGN),
        (CanFrame(0x7FF << 4, bytes(8)), Rejection.FOREIGN),
    ],
)
def test_contradictions_are_refused(frame, rejection):
    assert CATALOGUE.decode(frame) is rejection


def test_a_heartbeat_that_names_another_node_is_refused():
    frame = CATALOGUE.encode(Heartbeat(1, NodeState.READY, 0, 0, 0, 1, 0, 7))
    assert CATALOGUE.decode(frame._replace(identifier=identifier(Function.HEARTBEAT, 2))) is Rejection.UNKNOWN_WORD


def test_a_range_keeps_a_hundredth_of_a_millimetre():
    reading = Reading(1, 0, 0, 0, Status.OK, 8, 0.430_004_9, math.nan, 0)
    decoded = CATALOGUE.decode(CATALOGUE.encode(reading))
    assert isinstance(decoded, Reading)
    assert decoded.range_m == 0.43
    assert math.isnan(decoded.spread_m)


@pytest.mark.parametrize(
    "message",
    [
        Reading(1, 0, 0, 0, Status.OK, 8, 42.0, 0.0, 0),
        Reading(1, 0, 0, 0, Status.OK, 8, math.nan, 0.0, 0),
        Reading(1, 0, 0, 0, Status.OK, 8, -0.1, 0.0, 0),
        Reading(1, 0, 0, 0, Status.OK, 0, 0.43, 0.0, 0),
        Reading(1, 0, 0, 0, Status.OK, 32, 0.43, 0.0, 0),
        Reading(1, 0, 0, 0, Status.OK, 8, 0.43, 0.328, 0),
        EchoDetail(1, 0, 0, 0, -1, 0, 0, 1.0),
        EchoDetail(1, 0, 0, 0, 2**24, 0, 0, 1.0),
        EchoDetail(1, 0, 0, 0, 0, 0, 0, -0.1),
        EchoDetail(1, 0, 0, 0, 0, 0, 0, 13.2),
        EchoDetail(1, 0, 0, 0, 0, 0, 0, math.inf),
    ],
)
def test_what_the_bus_cannot_carry_is_refused_and_not_clamped(message):
    with pytest.raises(DataError):
        CATALOGUE.encode(message)


@pytest.mark.parametrize(
    "change",
    [
        {"frequency_hz": 63_001},
        {"frequency_hz": 140_000},
        {"cycles": 0},
        {"gain_db": 128.0},
        {"gain_db": 0.3},
        {"blanking_us": -1},
        {"pings": 32},
        {"sample_rate_hz": 0},
    ],
)
def test_kit_settings_have_limits(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        KitMessage(**change)


GOOD = DBC.read_text()
HOSTILE = {
    "empty": "",
    "no dbc": "hello",
    "binary": "\x00\x01" * 500,
    "message missing": GOOD.replace("BO_ 546 ", "BO_ 1999 "),
    "signal gone": GOOD.replace(' SG_ epoch : 32|16@1+ (1,0) [0|65535] "" Node1\n', ""),
    "big endian": GOOD.replace("sequence : 0|8@1+", "sequence : 7|8@0+"),
    "signed": GOOD.replace("range : 24|22@1+", "range : 24|22@1-"),
    "offset": GOOD.replace("(0.01,0)", "(0.01,5)"),
    "one sensor shifted": GOOD.replace(
        "BO_ 531 Reading_1_3: 8 Node1\n SG_ sequence : 0|8", "BO_ 531 Reading_1_3: 8 Node1\n SG_ sequence : 1|7"
    ),
    "other words": GOOD.replace('1 "NO_ECHO" 2 "TOO_CLOSE"', '2 "NO_ECHO" 1 "TOO_CLOSE"'),
    "overlap": GOOD.replace("spread : 46|15", "spread : 40|15"),
    "outside": GOOD.replace("spread : 46|15", "spread : 60|15"),
    "endless": GOOD + "BO_ 1 A: 8 X\n" * 90_000,
    "truncated": GOOD[: len(GOOD) // 2],
    "zero scale": GOOD.replace("(0.01,0)", "(0,0)"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_catalogue_is_refused_with_its_name(name, tmp_path: Path):
    path = tmp_path / "user.dbc"
    path.write_text(HOSTILE[name])
    with pytest.raises(ConfigError, match=r"user\.dbc"):
        Catalogue(path)


def test_a_missing_catalogue_is_refused(tmp_path: Path):
    with pytest.raises(ConfigError, match=r"none\.dbc"):
        Catalogue(tmp_path / "none.dbc")


def test_a_copy_of_the_catalogue_works(tmp_path: Path):
    path = tmp_path / "copy.dbc"
    path.write_text(GOOD)
    frame = CATALOGUE.encode(Query(2, 3, 4))
    assert Catalogue(path).decode(frame) == Query(2, 3, 4)
