"""What goes over the wire: bits survive, and nothing that is not the protocol gets in."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tilted_plane import CARTESIAN, SIX_JOINTS

from surfuse.bridge import answers, questions
from surfuse.bridge.fields import Fields
from surfuse.bridge.lines import LineBuffer
from surfuse.bridge.messages import (
    Ability,
    ArmKind,
    ArmOfBridge,
    BridgeReading,
    CameraOfBridge,
    Envelope,
    Hello,
    Image,
    MoveTo,
    Reach,
    State,
    SweepAnswer,
)
from surfuse.bridge.strict_json import LINE_LIMIT_BYTES, cleaned, decode_line, encode_line
from surfuse.errors import DataError, DeviceError
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import Status

FINITE = st.floats(allow_nan=False, allow_infinity=False)
NOT_NEGATIVE = st.floats(0.0, allow_infinity=False, allow_nan=False)
POSITIVE = st.floats(5e-324, allow_infinity=False, allow_nan=False, exclude_min=False)
NAMES = st.text("abcdefgh_0123456789 äß°", min_size=1, max_size=20).filter(lambda name: cleaned(name) == name)
ANGLES = st.floats(-math.pi, math.pi)
POSES = st.builds(
    lambda a, b, c, where: pose(
        rotation_about([1, 0, 0], a) @ rotation_about([0, 1, 0], b) @ rotation_about([0, 0, 1], c), where
    ),
    ANGLES,
    ANGLES,
    ANGLES,
    st.tuples(FINITE, FINITE, FINITE),
)
ENVELOPES = st.builds(
    lambda low, width, values: Envelope(low, width, np.array(values, dtype=np.float32)),
    FINITE,
    POSITIVE,
    st.lists(st.floats(width=32, allow_nan=False, allow_infinity=False), min_size=1, max_size=20),
)
ECHOES = st.lists(st.tuples(NOT_NEGATIVE, NOT_NEGATIVE), max_size=4).map(lambda found: tuple(sorted(found)))
UNSAID = st.just(math.nan)


@st.composite
def readings(draw):
    status = draw(st.sampled_from(list(Status)))
    ranges = {Status.NO_ECHO: math.inf, Status.TOO_CLOSE: -math.inf, Status.FAULT: math.nan}
    range_m = ranges.get(status, draw(NOT_NEGATIVE))
    more = draw(st.tuples(NOT_NEGATIVE | UNSAID, POSITIVE | UNSAID, ECHOES, st.none() | ENVELOPES))
    return BridgeReading(draw(NAMES), draw(FINITE), range_m, status, *more)


HELLOS = st.builds(
    Hello,
    NAMES,
    st.none() | st.just(CARTESIAN) | st.builds(ArmOfBridge, st.just(ArmKind.JOINTS), st.integers(1, 64)),
    st.lists(NAMES, max_size=64, unique=True).map(tuple),
    st.none() | st.builds(CameraOfBridge, st.integers(1, 3000), st.integers(1, 3000)),
    st.frozensets(st.sampled_from(list(Ability))),
)
SWEEPS = st.lists(readings(), max_size=6, unique_by=lambda reading: reading.sensor).map(
    lambda found: SweepAnswer(tuple(found))
)


def sent(fields):
    """What arrives of it at the other end."""
    return Fields(decode_line(encode_line(fields).rstrip(b"\n")))


def bits(value):
    return np.asarray(value).tobytes()


@given(HELLOS)
def test_a_greeting_comes_back(hello):
    assert answers.decode_hello(sent(answers.encode_hello(hello))) == hello


@given(FINITE, POSES, st.lists(FINITE, min_size=6, max_size=6))
def test_the_bits_of_a_state_survive(t_s, world_from_tool, joints):
    state = State(t_s, world_from_tool, np.array(joints))
    got = answers.decode_state(sent(answers.encode_state(state)), SIX_JOINTS)
    assert bits(got.t_s) == bits(t_s)
    assert bits(got.world_from_tool) == bits(state.world_from_tool)
    assert bits(got.joints_rad) == bits(state.joints_rad)


@given(SWEEPS)
def test_the_bits_of_a_sweep_survive(sweep):
    asked = [reading.sensor for reading in sweep.readings]
    got = answers.decode_sweep(sent(answers.encode_sweep(sweep)), asked)
    assert len(got.readings) == len(sweep.readings)
    for before, after in zip(sweep.readings, got.readings, strict=True):
        assert (after.sensor, after.status) == (before.sensor, before.status)
        for name in ("t_s", "range_m", "amplitude", "sigma_m", "echoes"):
            assert bits(getattr(after, name)) == bits(getattr(before, name)), name
        assert (after.envelope is None) == (before.envelope is None)
        if before.envelope is not None:
            assert bits(after.envelope.values) == bits(before.envelope.values)
            assert (after.envelope.range0_m, after.envelope.bin_m) == (before.envelope.range0_m, before.envelope.bin_m)


@given(st.integers(1, 20), st.integers(1, 20), st.data())
def test_the_bytes_of_a_picture_survive(width, height, data):
    grey = np.frombuffer(data.draw(st.binary(min_size=width * height, max_size=width * height)), np.uint8)
    image = Image(3.5, grey.reshape(height, width))
    got = answers.decode_image(sent(answers.encode_image(image)), CameraOfBridge(width, height))
    assert np.array_equal(got.grey, image.grey)


@given(st.lists(st.booleans()))
def test_reach_comes_back(flags):
    reach = Reach(np.array(flags, dtype=bool))
    assert answers.decode_reach(sent(answers.encode_reach(reach)), len(flags)).reachable.tolist() == flags


@given(POSES, st.none() | st.floats(0.0, 1.0, exclude_min=True))
def test_a_move_comes_back(world_from_tool, share):
    to = questions.decode_move(sent(questions.encode_move(MoveTo(world_from_tool=world_from_tool, speed_share=share))))
    assert bits(to.world_from_tool) == bits(MoveTo(world_from_tool=world_from_tool).world_from_tool)
    assert to.speed_share == share


@given(st.lists(POSES, max_size=5))
def test_poses_whose_reach_is_asked_come_back(poses):
    asked = np.array(poses).reshape(-1, 4, 4)
    assert bits(questions.decode_reach(sent(questions.encode_reach(asked)))) == bits(asked)


def test_keys_of_later_versions_are_passed_over():
    state = answers.decode_state(Fields({"t_s": 1, "joints_rad": [0] * 6, "mood": "good"}), SIX_JOINTS)
    assert state.t_s == 1.0
    hello = {"protocol": 1, "name": "n", "arm": None, "sensors": [], "can": ["reach", "sing"], "lamp": True}
    assert answers.decode_hello(Fields(hello)).can == {Ability.REACH}


@pytest.mark.parametrize(("name", "shown"), [("", "bridge"), ("a\x1b[2J\n" + "b" * 500, "a [2J b")])
def test_the_name_of_a_rig_is_cleaned(name, shown):
    hello = answers.decode_hello(Fields({"protocol": 1, "name": name, "arm": None, "sensors": []}))
    assert hello.name.startswith(shown)
    assert len(hello.name) <= 64


@pytest.mark.parametrize("version", [0, 2, 17])
def test_another_version_is_named_with_ours(version):
    with pytest.raises(DeviceError, match=rf"protocol {version}, this surfuse speaks 1"):
        answers.decode_hello(Fields({"protocol": version}))


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (b"", "not JSON"),
        (b"hello", "not JSON"),
        (b"[1]", "not a JSON object"),
        (b"7", "not a JSON object"),
        (b'{"a": NaN}', "NaN"),
        (b'{"a": -Infinity}', "Infinity"),
        (b'{"a": 1e999}', "float64"),
        (b'{"a": 1, "a": 2}', "'a' stands twice"),
        (b'{"b": {"a": 1, "a": 1}}', "'a' stands twice"),
        (b'{"a": ' + b"9" * 22 + b"}", "22 digits"),
        (b'{"a": -' + b"9" * 5000 + b"}", "digits"),
        (b'{"a": ' + b"[" * 17 + b"]" * 17 + b"}", "18 deep"),
        (b'{"a":' * 100_000, "deep"),
        (b"[" * 1_000_000, "deep"),
        (b'"' + b'\\"' * 500_000 + b"[" * 20, "not JSON"),
        (b'{"a": "\xff"}', "not UTF-8"),
        ('{"a": 1}'.encode("utf-16"), "not UTF-8"),
        ("﻿{}".encode(), "not JSON"),
        (b'{"a": 01}', "not JSON"),
        (b'{"a": "tab\there"}', "not JSON"),
    ],
)
def test_what_is_no_object_of_finite_numbers_is_refused(line, words):
    with pytest.raises(DataError, match=words):
        decode_line(line)


def test_brackets_inside_of_text_are_not_counted():
    assert decode_line(json.dumps({"a": "[" * 1000 + '\\"{'}).encode()) == {"a": "[" * 1000 + '\\"{'}


def test_what_json_cannot_hold_is_not_sent():
    with pytest.raises(DataError, match="finite"):
        encode_line({"t_s": math.nan})
    with pytest.raises(DataError, match=str(LINE_LIMIT_BYTES)):
        encode_line({"name": "x" * LINE_LIMIT_BYTES})


GOOD_POSE = np.eye(4).ravel().tolist()
MIRRORED = [-1.0, *GOOD_POSE[1:]]


def changed(values, i, value):
    return [*values[:i], value, *values[i + 1 :]]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"world_from_tool": GOOD_POSE}, "'t_s' is missing"),
        ({"t_s": 1.0}, "'world_from_tool' is missing; keys given: t_s"),
        ({"t_s": True, "world_from_tool": GOOD_POSE}, "'t_s' is true, wanted a number"),
        ({"t_s": "1", "world_from_tool": GOOD_POSE}, "'t_s' is the text '1'"),
        ({"t_s": None, "world_from_tool": GOOD_POSE}, "null"),
        ({"t_s": 1.0, "world_from_tool": GOOD_POSE[:15]}, "15 items"),
        ({"t_s": 1.0, "world_from_tool": np.eye(4).tolist()}, "4 items"),
        ({"t_s": 1.0, "world_from_tool": changed(GOOD_POSE, 3, False)}, r"'world_from_tool'\[3\] is false"),
        ({"t_s": 1.0, "world_from_tool": MIRRORED}, "left-handed"),
        ({"t_s": 1.0, "world_from_tool": changed(GOOD_POSE, 0, 1.00001)}, "off unit length.*at most 1e-06"),
        ({"t_s": 1.0, "world_from_tool": changed(GOOD_POSE, 0, 1e300)}, "no rotation"),
        ({"t_s": 1.0, "world_from_tool": changed(GOOD_POSE, 1, 0.001)}, "no rotation"),
        ({"t_s": 1.0, "world_from_tool": changed(GOOD_POSE, 12, 500.0)}, "bottom row 500, 0, 0, 1"),
        (
            {"t_s": 1.0, "world_from_tool": [*np.array(GOOD_POSE).reshape(4, 4).T.ravel().tolist()[:12], 1, 2, 3, 1]},
            "row",
        ),
        ({"t_s": 1.0, "world_from_tool": GOOD_POSE, "joints_rad": 3}, "wanted a list"),
        ({"t_s": 1.0, "world_from_tool": {}}, "an object"),
    ],
)
def test_a_state_that_is_none_is_refused_with_its_field(fields, words):
    with pytest.raises(DataError, match=words):
        answers.decode_state(Fields(fields), CARTESIAN)


def test_joints_must_be_as_many_as_announced():
    with pytest.raises(DataError, match="5 numbers, the arm has 6"):
        answers.decode_state(Fields({"t_s": 1.0, "joints_rad": [0.0] * 5}), SIX_JOINTS)
    with pytest.raises(DataError, match="world_from_tool"):
        answers.decode_state(Fields({"t_s": 1.0, "joints_rad": [0.0] * 6}), CARTESIAN)


READING = {"sensor": "us0", "t_s": 1.0, "range_m": 0.5, "status": "ok"}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sensor": "us9"}, "'us9' was not asked; asked: us0, us1"),
        ({"sensor": 3}, "the number 3"),
        ({"range_m": None}, "null, wanted a number"),
        ({"range_m": -0.1}, "0 to inf"),
        ({"range_m": "0.5"}, "text"),
        ({"status": "okay"}, "did you mean 'ok'"),
        ({"status": "no_echo"}, "beside the status 'no_echo'"),
        ({"status": "too_close", "range_m": 0}, "beside the status"),
        ({"amplitude": -1}, "amplitude"),
        ({"sigma_m": 0}, "above 0"),
        ({"echoes": [{"range_m": 0.5, "amplitude": 1}, {"range_m": 0.4, "amplitude": 1}]}, "0.4 m after 0.5 m"),
        ({"echoes": [{"range_m": 0.5}]}, r"echoes\[0\].amplitude' is missing"),
        ({"echoes": [0.5]}, r"echoes\[0\]' is the number"),
        ({"envelope": {"range0_m": 0, "bin_m": 0, "float32": "AAAAAA=="}}, "above 0"),
        ({"envelope": {"range0_m": 0, "bin_m": 1, "float32": "AAAA"}}, "3 bytes"),
        ({"envelope": {"range0_m": 0, "bin_m": 1, "float32": ""}}, "0 bytes"),
        ({"envelope": {"range0_m": 0, "bin_m": 1, "float32": "AADAfw=="}}, "not finite"),
        ({"envelope": {"range0_m": 0, "bin_m": 1, "float32": "AA A"}}, "base64"),
        ({"envelope": {"range0_m": 0, "bin_m": 1, "float32": "ÄÄÄÄ"}}, "base64"),
    ],
)
def test_a_reading_that_is_none_is_refused_with_its_field(change, words):
    with pytest.raises(DataError, match=words):
        answers.decode_sweep(Fields({"readings": [{**READING, **change}]}), ("us0", "us1"))


@pytest.mark.parametrize("key", list(READING))
def test_a_reading_names_what_it_lacks(key):
    short = {name: value for name, value in READING.items() if name != key}
    with pytest.raises(DataError, match=rf"readings\[0\].{key}' is missing"):
        answers.decode_sweep(Fields({"readings": [short]}), ("us0", "us1"))


def test_a_sensor_answers_once():
    with pytest.raises(DataError, match="'us0' 2 times"):
        answers.decode_sweep(Fields({"readings": [READING, READING]}), ("us0", "us1"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gray8": "AAEC"}, "3 bytes, 4 x 3 pixels are 12"),
        ({"width": 3}, "announced 4 x 3"),
        ({"width": 4.0}, "a whole number"),
        ({"gray8": "AAECAwQFBgcICQo"}, "base64"),
    ],
)
def test_a_picture_of_another_size_is_refused(change, words):
    image = {"t_s": 1.0, "width": 4, "height": 3, "gray8": "AAECAwQFBgcICQoL", **change}
    with pytest.raises(DataError, match=words):
        answers.decode_image(Fields(image), CameraOfBridge(4, 3))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sensors": ["a", "a"]}, "'a' 2 times"),
        ({"sensors": ["a\x1b[2J"]}, "control characters"),
        ({"sensors": [f"s{i}" for i in range(65)]}, "65 sensors, at most 64"),
        ({"sensors": [""]}, "0 characters"),
        ({"sensors": ["x" * 65]}, "65 characters"),
        ({"name": None}, "null"),
        ({"arm": {"kind": "joints"}}, "'arm.joints' is missing"),
        ({"arm": {"kind": "joint", "joints": 6}}, "did you mean 'joints'"),
        ({"arm": {"kind": "joints", "joints": 0}}, "wanted 1 to 64"),
        ({"camera": {"width": 100000, "height": 100000}}, "pixels, at most"),
    ],
)
def test_a_greeting_that_cannot_be_used_is_refused(change, words):
    hello = {"protocol": 1, "name": "n", "arm": None, "sensors": ["a"], "camera": None, "can": [], **change}
    with pytest.raises(DataError, match=words):
        answers.decode_hello(Fields(hello))


@given(st.lists(st.binary(max_size=30).map(lambda raw: raw.replace(b"\n", b"x")), max_size=8), st.data())
def test_lines_do_not_depend_on_the_portions(lines, data):
    stream = b"".join(line + b"\n" for line in lines)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
    buffer, got = LineBuffer(100), []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        buffer.feed(stream[start:end])
        while (line := buffer.next_line()) is not None:
            got.append(line)
    assert got == [line.rstrip(b"\r") for line in lines if line.strip()]


@given(st.integers(1, 200), st.integers(1, 50))
def test_a_line_beyond_the_limit_is_one_error_and_the_next_one_is_read(length, portion):
    stream = b"a" * length + b"\nnext\n"
    buffer, got = LineBuffer(100), []
    for i in range(0, len(stream), portion):
        buffer.feed(stream[i : i + portion])
        assert len(buffer.unfinished) <= 100
        while True:
            try:
                line = buffer.next_line()
            except DataError:
                line = b"too long"
            if line is None:
                break
            got.append(line)
    assert got == [b"a" * length if length <= 100 else b"too long", b"next"]


@given(st.text(max_size=500))
def test_cleaned_text_is_one_short_printable_line(text):
    clean = cleaned(text, 50)
    assert len(clean) <= 50
    assert clean.isprintable() or not clean
    assert cleaned(clean, 50) == clean
