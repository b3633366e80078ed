"""Bridges that break the protocol or die: always an error of ours, in time, and never a wrong number."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from scripted_bridge import CLOSE, HALF_CLOSE, HELLO, POSE, ScriptedBridge, good
from tilted_plane import above

from surfuse.bridge.client import BridgeClient
from surfuse.bridge.messages import MoveTo
from surfuse.bridge.patience import Patience
from surfuse.bridge.transport import TcpTransport
from surfuse.errors import ConfigError, DeviceError, SafetyStopError

QUICK = Patience(0.3, 0.3, 0.3, 0.3, 0.3, give_up_s=0.8)
RIG = Path(__file__).parent / "tilted_plane.py"


def opened(bridge, patience=QUICK):
    return BridgeClient(TcpTransport(bridge.address), patience)


def first_then_good(*first):
    """Answers the first questions by these, all others well."""
    waiting = list(first)

    def answer(question):
        return waiting.pop(0) if waiting else good(question)

    return answer


@pytest.mark.parametrize(
    "line",
    [
        b"Traceback (most recent call last):\n",
        b"{}\n",
        b'{"id": "1", "ok": true}\n',
        b'{"id": true, "ok": true}\n',
        b'{"id": 1000000, "ok": true}\n',
        b'{"id": 2, "ok": 1, "t_s": 1.0}\n',
        b'{"id": 2, "ok": true, "t_s": NaN}\n',
        b'{"id": 2, "ok": false, "kind": "tired", "error": "x"}\n',
        b'{"id": 2, "ok": false}\n',
        b"\x00\xff\n",
        b"[" * 100_000 + b"\n",
        b"x" * (2**20 + 1) + b"\n",
    ],
)
def test_one_answer_of_nonsense_is_asked_again(line):
    with ScriptedBridge(first_then_good(line)) as bridge, opened(bridge) as client:
        assert client.state().t_s == 1.0
        assert client.tally.garbled_answers == 1
    with ScriptedBridge(lambda question: line.replace(b'"id": 2', b'"id": %d' % question["id"])) as bridge:
        with opened(bridge) as client, pytest.raises(DeviceError, match="the answer to 'state' makes no sense"):
            client.state()
        assert [question["do"] for question in bridge.questions].count("state") == 3


def test_a_hundred_megabytes_in_one_line_are_not_kept():
    flood = [b"x" * 2**20] * 100
    patience = Patience(answer_timeout_s=20.0, give_up_s=40.0)
    with ScriptedBridge(first_then_good([*flood, b"\n"])) as bridge, opened(bridge, patience) as client:
        assert client.state().t_s == 1.0
        assert client.tally.garbled_answers == 1


def test_a_line_without_end_ends_at_the_deadline():
    def flood(question):
        return [b"y" * 2**16] * 100_000

    with ScriptedBridge(flood) as bridge, opened(bridge) as client, pytest.raises(DeviceError) as caught:
        client.state()
    assert caught.value.exit_status == 4


def test_silence_ends_at_the_deadline_and_later_questions_at_once():
    with ScriptedBridge(lambda question: None) as bridge, opened(bridge) as client:
        with pytest.raises(DeviceError, match=r"no answer to 'state' within 0.3 s"):
            client.state()
        asked = len(bridge.questions)
        with pytest.raises(DeviceError, match="no answer"):
            client.sweep()
        assert len(bridge.questions) == asked


def test_an_answer_too_late_is_not_taken_for_the_next_one():
    def late(question):
        if question["do"] == "state" and "late" not in seen:
            seen.append("late")
            time.sleep(0.45)
            return good(question, t_s=77.0)
        return good(question, t_s=99.0)

    seen = []
    with ScriptedBridge(late) as bridge, opened(bridge, Patience(0.3, give_up_s=2.0)) as client:
        assert client.state().t_s == 99.0
        assert (client.tally.stale_answers, client.tally.silences) == (1, 1)


@pytest.mark.parametrize("end", [CLOSE, [b'{"id": 2, "ok": tr', CLOSE], [HALF_CLOSE]])
def test_a_line_that_closes_is_opened_again(end):
    with ScriptedBridge(first_then_good(end)) as bridge, opened(bridge) as client:
        assert client.state().t_s == 1.0
        assert client.tally.reconnections == 1


def test_a_bridge_that_keeps_closing_is_given_up():
    with (
        ScriptedBridge(lambda question: [b'{"id"', CLOSE]) as bridge,
        opened(bridge) as client,
        pytest.raises(DeviceError, match=r"closed the line in the middle of an answer, after 5 bytes"),
    ):
        client.state()


def test_another_rig_on_the_same_port_is_not_taken_for_the_first():
    with ScriptedBridge(first_then_good(CLOSE)) as bridge, opened(bridge) as client:
        bridge._hello = {**HELLO, "sensors": ["us0"]}
        with pytest.raises(
            DeviceError, match="another rig answers now: 'scripted' with 1 sensors, before it was 'scripted' with 2"
        ):
            client.state()


def test_after_a_new_connection_the_arm_must_stand_where_it_stood():
    shifted = [*POSE[:3], 0.012, *POSE[4:]]

    def answer(question):
        if question["do"] == "sweep" and not moved:
            moved.append(True)
            return CLOSE
        return {**good(question), "world_from_tool": shifted} if moved and question["do"] == "state" else good(question)

    moved = []
    with ScriptedBridge(answer) as bridge, opened(bridge) as client:
        client.state()
        with pytest.raises(SafetyStopError, match=r"12.000 mm"):
            client.observe()


def test_a_bridge_started_again_may_count_its_time_anew():
    def answer(question):
        if question["do"] == "sweep" and not restarted:
            restarted.append(True)
            return CLOSE
        return good(question, t_s=0.5 if restarted else 1000.0)

    restarted = []
    with ScriptedBridge(answer) as bridge, opened(bridge) as client:
        assert client.observe().after.t_s == 0.5
        assert client.tally.reconnections == 1


@pytest.mark.parametrize("lost", [CLOSE, b"garbage\n", None])
def test_a_move_whose_answer_was_lost_is_not_repeated_when_the_arm_is_there(lost):
    target = above(0.1)

    def answer(question):
        if question["do"] == "move":
            return lost
        return {**good(question), "world_from_tool": target.ravel().tolist()}

    with ScriptedBridge(answer) as bridge, opened(bridge) as client:
        assert client.move(MoveTo(world_from_tool=target)).world_from_tool.tobytes() == target.tobytes()
    assert [question["do"] for question in bridge.questions].count("move") == 1


def test_a_move_is_repeated_only_after_the_arm_has_said_where_it_is():
    target = above(0.1)
    with ScriptedBridge(first_then_good(CLOSE)) as bridge, opened(bridge) as client:
        client.move(MoveTo(world_from_tool=target))
    words = [question["do"] for question in bridge.questions]
    assert words == ["hello", "move", "hello", "state", "move", "bye"]


def elsewhere(question):
    return {**good(question), "world_from_tool": above(-0.9).ravel().tolist()}


def test_an_arm_that_a_lost_line_leaves_off_its_way_is_not_sent_on():
    def answer(question):
        if question["do"] == "move":
            lost.append(True)
            return CLOSE
        return elsewhere(question) if lost else good(question)

    lost = []
    with ScriptedBridge(answer) as bridge, opened(bridge) as client:
        client.state()
        with pytest.raises(SafetyStopError, match=r"is 900 mm from its way, at most 100 mm"):
            client.move(MoveTo(world_from_tool=above(0.1)))
    assert [question["do"] for question in bridge.questions].count("move") == 1


def test_after_a_new_connection_nothing_moves_before_the_arm_has_said_where_it_is():
    def answer(question):
        if question["do"] == "reach" and not restarted:
            restarted.append(True)
            return CLOSE
        return elsewhere(question) if restarted and question["do"] == "state" else good(question)

    restarted = []
    with ScriptedBridge(answer) as bridge, opened(bridge) as client:
        client.state()
        client.reach(above(0.1)[None])
        with pytest.raises(SafetyStopError, match=r"900\.000 mm without a move"):
            client.move(MoveTo(world_from_tool=above(0.1)))
    assert "move" not in [question["do"] for question in bridge.questions]


def test_a_twin_that_was_started_again_begins_its_stop_again():
    twin = {**HELLO, "can": ["streams"]}
    with ScriptedBridge(first_then_good({"id": 2, "ok": True}, CLOSE), twin) as bridge, opened(bridge) as client:
        client.begin("stop", 7)
        client.sweep()
    begun = [(question["do"], question.get("index")) for question in bridge.questions]
    assert begun == [
        ("hello", None),
        ("begin", 7),
        ("sweep", None),
        ("hello", None),
        ("begin", 7),
        ("sweep", None),
        ("bye", None),
    ]


def test_a_silent_move_is_stopped_and_reported():
    def answer(question):
        return None if question["do"] == "move" else good(question)

    with (
        ScriptedBridge(answer) as bridge,
        opened(bridge) as client,
        pytest.raises(DeviceError, match=r"no answer to 'move' within 0\.3 s, and the arm is not where it was sent"),
    ):
        client.move(MoveTo(world_from_tool=above(0.1)))
    words = [question["do"] for question in bridge.questions]
    assert words[:3] == ["hello", "move", "stop"]


@pytest.mark.parametrize(
    "readings",
    [
        lambda first, second: [first, first],
        lambda first, second: [first, {**second, "sensor": "us2"}],
        lambda first, second: [first, {**second, "sensor": "us1 "}],
        lambda first, second: {"us0": first},
    ],
)
def test_doubled_and_foreign_sensors_are_refused(readings):
    def answer(question):
        whole = good(question)
        return {**whole, "readings": readings(*whole["readings"])} if question["do"] == "sweep" else whole

    with ScriptedBridge(answer) as bridge, opened(bridge) as client, pytest.raises(DeviceError, match="sweep"):
        client.sweep()


def test_a_sensor_that_was_not_asked_is_refused():
    def answer(question):
        return good({**question, "sensors": ["us0", "us1"]})

    with (
        ScriptedBridge(answer) as bridge,
        opened(bridge) as client,
        pytest.raises(DeviceError, match="'us0' was not asked; asked: us1"),
    ):
        client.sweep(("us1",))


def test_words_of_the_bridge_are_cleaned():
    text = "red \x1b[31m alert\r\nsurfuse: all is well \u202e" + "x" * 5000

    def answer(question):
        return {"id": question["id"], "ok": False, "kind": "device", "error": text}

    with ScriptedBridge(answer) as bridge, opened(bridge) as client, pytest.raises(DeviceError) as caught:
        client.sweep()
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 500


def test_another_version_of_the_protocol_is_named_at_once():
    with ScriptedBridge(good, {**HELLO, "protocol": 2}) as bridge:
        with pytest.raises(DeviceError, match="the bridge speaks protocol 2, this surfuse speaks 1"):
            opened(bridge).__enter__()
        assert len(bridge.questions) == 1


def test_a_question_that_the_bridge_cannot_read_keeps_its_words():
    line = b'{"id": null, "ok": false, "kind": "usage", "error": "no such comma"}\n'
    with (
        ScriptedBridge(lambda question: line) as bridge,
        opened(bridge) as client,
        pytest.raises(DeviceError, match="could not read it: no such comma"),
    ):
        client.state()


def test_what_the_bridge_did_not_announce_is_not_asked():
    with ScriptedBridge(good, {**HELLO, "can": [], "camera": None}) as bridge, opened(bridge) as client:
        for ask in (client.image, client.stop, lambda: client.reach(np.eye(4)[None])):
            with pytest.raises(DeviceError, match="the bridge cannot"):
                ask()
    assert [question["do"] for question in bridge.questions] == ["hello", "bye"]


@pytest.mark.parametrize("field", ["answer_timeout_s", "give_up_s", "attempts", "move_timeout_s"])
def test_patience_must_be_positive(field):
    for value in (0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ConfigError, match=field):
            Patience(**{field: value})


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("how", ["SIGKILL", "SIGSTOP"])
def test_a_dead_bridge_is_noticed_within_its_time(how):
    program = [sys.executable, str(RIG), "tcp://127.0.0.1:0"]
    with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        address = process.stdout.readline().decode().strip()
        with BridgeClient(TcpTransport(address), Patience(sweep_timeout_s=1.5, give_up_s=1.5)) as client:
            client.sweep()
            process.send_signal(getattr(signal, how))
            with pytest.raises(DeviceError) as caught:
                client.sweep()
            assert caught.value.exit_status == 4
        process.kill()


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_bridge_that_comes_up_again_is_found_again():
    program = [sys.executable, str(RIG)]
    with subprocess.Popen([*program, "tcp://127.0.0.1:0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as first:
        address = first.stdout.readline().decode().strip()
        with BridgeClient(TcpTransport(address), Patience(give_up_s=30.0)) as client:
            before = client.sweep()
            first.kill()
            first.wait()
            with subprocess.Popen([*program, address], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as second:
                after = client.sweep()
                assert [r.range_m for r in after.readings] == [r.range_m for r in before.readings]
                second.kill()


def test_questions_of_strangers_get_answers(tmp_path):
    import socket

    from tilted_plane import Served, TiltedPlane

    with Served(TiltedPlane()) as served:
        host, port = served.address.removeprefix("tcp://").split(":")
        with socket.create_connection((host, int(port))) as line, line.makefile("rb") as got:
            for asked, kind, words in (
                (b"GET / HTTP/1.1\r\n", "usage", "not JSON"),
                (b'{"do": "state"}\n', "usage", "'id' is missing"),
                (b'{"id": 4, "do": "dance"}\n', "usage", "unknown question 'dance'"),
                (b'{"id": 5, "do": "move"}\n', "usage", "one target"),
                (b'{"id": 6, "do": "move", "world_from_tool": [1]}\n', "usage", "1 items"),
                (b'{"id": 7, "do": "sweep", "sensors": ["us9"]}\n', "usage", "no sensor 'us9'"),
                (b'{"id": 8, "do": "hello", "protocol": 3}\n', "usage", "protocol 3, this bridge speaks 1"),
                (b"z" * (2**20 + 5) + b"\n", "usage", "more than 1048576 bytes"),
            ):
                line.sendall(asked)
                answer = json.loads(got.readline())
                assert (answer["ok"], answer["kind"]) == (False, kind)
                assert words in answer["error"], answer
            line.sendall(b'{"id": 9, "do": "state"}\n')
            assert json.loads(got.readline())["ok"] is True
