"""What is told of an arm that was under way when its stop was not answered, and of a clock that stands still."""

import contextlib
import os
import signal
import threading
import time

import pytest
from scripted_bridge import CLOSE, HELLO, ScriptedBridge, good
from tilted_plane import above

from surfuse.bridge.client import BridgeClient
from surfuse.bridge.frozen_clock import FROZEN_SWEEPS
from surfuse.bridge.messages import MoveTo
from surfuse.bridge.patience import Patience
from surfuse.bridge.transport import TcpTransport
from surfuse.commands.acquire.acquisition import _resumable
from surfuse.errors import DeviceError, InterruptError, SafetyStopError
from surfuse.runs.folder import RunFolder

QUICK = Patience(0.2, 0.2, 0.2, 0.2, 0.3, start_timeout_s=5.0, give_up_s=0.5)
THERE = MoveTo(world_from_tool=above(0.1))
DOUBT = r"the stop was not answered: the arm may still be moving, stop it at its controller"


def opened(bridge, patience=QUICK):
    return BridgeClient(TcpTransport(bridge.address), patience)


def mute_in_moves(question):
    return None if question["do"] in ("move", "stop") else good(question)


def ctrl_c_in_a_move(bridge):
    def press():
        deadline_s = time.monotonic() + 10.0
        while "move" not in [one["do"] for one in bridge.questions] and time.monotonic() < deadline_s:
            time.sleep(0.01)
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    hand = threading.Thread(target=press)
    hand.start()
    return contextlib.closing(type("Hand", (), {"close": lambda self: hand.join()})())


@pytest.mark.skipif(os.name != "posix", reason="a signal for one thread")
@pytest.mark.usefixtures("ctrl_c_interrupts")
@pytest.mark.parametrize("can", [["stop"], []])
def test_ctrl_c_in_a_move_that_cannot_be_stopped_is_told(can, tmp_path):
    run = RunFolder.create(tmp_path / "run")
    words = DOUBT if can else r"the bridge cannot 'stop': the arm may still be moving"
    with (
        ScriptedBridge(mute_in_moves, {**HELLO, "can": can}) as bridge,
        ctrl_c_in_a_move(bridge),
        pytest.raises(InterruptError, match=rf"interrupted in a move; {words}.*surfuse resume"),
        _resumable(run),
        opened(bridge, Patience(0.2, move_timeout_s=30.0, give_up_s=0.5)) as client,
    ):
        client.move(THERE)


def test_a_move_and_a_stop_without_answers_tell_both():
    with (
        ScriptedBridge(mute_in_moves) as bridge,
        pytest.raises(DeviceError, match=rf"no answer to 'move' within 0\.3 s; {DOUBT}; .*move_timeout_s") as told,
        opened(bridge) as client,
    ):
        client.move(THERE)
    assert str(told.value).count("may still be moving") == 1


def test_a_line_that_breaks_in_a_move_and_stays_broken_keeps_its_cause():
    def answer(question):
        lost.append(question["do"])
        return CLOSE if "move" in lost else good(question)

    lost = []
    with (
        ScriptedBridge(answer) as bridge,
        pytest.raises(DeviceError, match=r"the bridge has closed the line; then .* the arm may still be moving"),
        opened(bridge) as client,
    ):
        client.move(THERE)


def test_a_refused_move_and_an_arm_at_rest_are_not_said_to_move():
    def answer(question):
        if question["do"] == "move":
            return {"id": question["id"], "ok": False, "kind": "safety", "error": "Protective stop."}
        return None if question["do"] == "stop" else good(question)

    with (
        ScriptedBridge(answer) as bridge,
        pytest.raises(SafetyStopError, match="Protective stop; clear") as told,
        opened(bridge) as client,
    ):
        client.move(THERE)
    assert "moving" not in str(told.value)
    with ScriptedBridge(answer) as bridge, pytest.raises(KeyboardInterrupt), opened(bridge):
        raise KeyboardInterrupt


def walk(client, sweeps):
    for k in range(sweeps):
        client.move(MoveTo(world_from_tool=above(0.01 * k)))
        client.sweep()


def test_a_clock_that_stands_still_over_moves_and_sweeps_stops_the_run():
    with ScriptedBridge(good) as bridge, opened(bridge) as client:
        walk(client, FROZEN_SWEEPS)
        with pytest.raises(SafetyStopError, match=r"clock of the bridge stands still: t_s = 1\.000000 in 5 sweeps"):
            walk(client, 1)


@pytest.mark.parametrize("advancing", ["move", "sweep"])
def test_a_clock_that_advances_only_when_it_is_used_goes_on(advancing):
    def answer(question):
        times_s.append(times_s[-1] + (question["do"] == advancing))
        return good(question, times_s[-1])

    times_s = [1.0]
    with ScriptedBridge(answer) as bridge, opened(bridge) as client:
        walk(client, 3 * FROZEN_SWEEPS)


def test_sweeps_without_a_move_between_may_repeat_their_stamps():
    with ScriptedBridge(good) as bridge, opened(bridge) as client:
        client.move(THERE)
        assert len([client.sweep() for _ in range(3 * FROZEN_SWEEPS)]) == 3 * FROZEN_SWEEPS


@pytest.mark.parametrize("closes", [True, False])
def test_a_port_of_another_program_is_no_bridge(closes):
    page = b"HTTP/1.1 400 Bad Request\r\nContent-Type: text/html\r\n\r\n"
    with (
        ScriptedBridge(good, [page, CLOSE] if closes else page) as bridge,
        pytest.raises(
            DeviceError, match=r"what answers there is no bridge: it said 'HTTP/1\.1 400.*check the port"
        ) as told,
    ):
        opened(bridge).__enter__()
    assert "resume" not in str(told.value)


def test_a_bridge_with_a_wrong_greeting_is_a_bridge():
    with (
        ScriptedBridge(good, {**HELLO, "sensors": 3}) as bridge,
        pytest.raises(DeviceError, match="the answer to 'hello' makes no sense: 'sensors'"),
    ):
        opened(bridge).__enter__()


@pytest.mark.parametrize("ask", ["sweep", "state"])
@pytest.mark.parametrize("answer", [None, CLOSE, {"id": 2, "ok": False, "kind": "device", "error": "broken."}])
def test_no_error_of_the_line_speaks_of_a_run(ask, answer):
    with (
        ScriptedBridge(lambda question: answer) as bridge,
        pytest.raises(DeviceError) as told,
        opened(bridge) as client,
    ):
        getattr(client, ask)()
    assert "resume" not in str(told.value)
    assert ".;" not in str(told.value)
