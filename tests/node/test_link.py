"""The reader thread on adapters that fail: the virtual bus, a bus that raises, and slcan on a pseudo-terminal."""

import itertools
import os
import threading
import time
import tty

import can
import pytest

from surfuse.errors import ConfigError, DeviceError
from surfuse.interfaces import MonotonicClock
from surfuse.node.counters import Tally
from surfuse.node.link import BusLink, BusParameters, open_bus
from surfuse.node.messages import CanFrame

PATIENCE_S = 300.0  # bounds a hang; nothing waits so long for what comes


def until(condition, limit_s=PATIENCE_S):
    give_up_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < give_up_s, "did not happen in time"
        time.sleep(0.002)


def linked(opener):
    tally = Tally()
    return BusLink(opener, MonotonicClock(), tally), tally


class ScriptedBus(can.BusABC):
    """Receives what its script says: messages, None, or exceptions."""

    def __init__(self, script, state=can.BusState.ACTIVE, refuse=False):
        super().__init__(channel="scripted")
        self.script, self.scripted_state, self.refuse = script, state, refuse

    def _recv_internal(self, timeout):
        if not self.script:
            time.sleep(0.001)
            return None, False
        step = self.script.pop(0)
        if isinstance(step, Exception):
            raise step
        return step, False

    def send(self, msg, timeout=None):
        if self.refuse:
            raise can.CanOperationError("Transmit buffer full")

    @property
    def state(self):
        return self.scripted_state


def message(identifier=0x210, data=bytes(8), **more):
    return can.Message(arbitration_id=identifier, data=data, **({"is_extended_id": False} | more))


def test_frames_go_both_ways_over_the_virtual_bus():
    parameters = BusParameters(channel="test_link_both_ways")
    one, _ = linked(lambda: open_bus(parameters))
    two, tally = linked(lambda: open_bus(parameters))
    with one, two:
        before_s = time.monotonic()
        assert one.send(CanFrame(0x211, b"12345678"))
        arrival = two.receive(PATIENCE_S)
        assert arrival is not None
        assert arrival.frame == CanFrame(0x211, b"12345678")
        assert before_s <= arrival.t_s <= time.monotonic()
        assert two.receive(0.0) is None
    assert tally.snapshot().frames == 1


@pytest.mark.parametrize("error", [IndexError("string index"), ValueError("non-hexadecimal")])
def test_damaged_lines_are_counted_and_the_next_frame_still_comes(error):
    buses = []

    def opener():
        buses.append(ScriptedBus([error] * 5 + [message()]))
        return buses[-1]

    link, tally = linked(opener)
    with link:
        assert link.receive(PATIENCE_S) is not None
    counters = tally.snapshot()
    assert (counters.receive_errors, counters.frames, counters.reopened) == (5, 1, 0)


@pytest.mark.parametrize(
    "error", [can.CanOperationError("gone"), OSError(19, "No such device"), RuntimeError("vendor")]
)
def test_a_vanished_adapter_is_opened_again(error):
    scripts = [[error], [message(0x212)]]
    link, tally = linked(lambda: ScriptedBus(scripts.pop(0)))
    with link:
        arrival = link.receive(PATIENCE_S)
    assert arrival is not None
    assert arrival.frame.identifier == 0x212
    counters = tally.snapshot()
    assert (counters.receive_errors, counters.reopened) == (1, 1)


class CountedPauses(threading.Event):
    """An event that notes how long it was asked to wait, and waits no time at all."""

    def __init__(self):
        super().__init__()
        self.asked_s = []

    def wait(self, timeout=None):
        self.asked_s.append(timeout)
        return super().wait(0.0)


def test_an_adapter_that_stays_away_is_tried_with_growing_pauses():
    opened = []

    def opener():
        opened.append(True)
        if len(opened) > 1:
            raise DeviceError("not there")
        return ScriptedBus([OSError("unplugged")])

    link, _ = linked(opener)
    link._stop = pauses = CountedPauses()
    with link:
        until(lambda: len(opened) >= 10)
        assert not link.send(CanFrame(0x110, bytes(8)))
    ratios = [later / earlier for earlier, later in itertools.pairwise(pauses.asked_s[:9])]
    assert ratios[:5] == pytest.approx([2.0] * 5)
    assert pauses.asked_s[0] == pytest.approx(0.05)
    assert max(pauses.asked_s) == pytest.approx(2.0)


@pytest.mark.parametrize(
    "bus",
    [
        lambda: ScriptedBus([message(0x40, is_error_frame=True)]),
        lambda: ScriptedBus([], state=can.BusState.ERROR),
    ],
    ids=["error frame", "state"],
)
def test_bus_off_is_seen_and_the_adapter_opened_again(bus):
    buses = [bus, lambda: ScriptedBus([message(0x213)])]
    link, tally = linked(lambda: buses.pop(0)())
    with link:
        assert link.receive(PATIENCE_S) is not None
    counters = tally.snapshot()
    assert (counters.bus_off, counters.reopened) == (1, 1)


def test_error_remote_extended_and_fd_frames_are_no_answers():
    script = [
        message(0x04, is_error_frame=True),
        message(0x210, b"", is_remote_frame=True),
        message(0x210, is_extended_id=True),
        message(0x210, bytes(16), is_fd=True),
        message(0x217),
    ]
    link, tally = linked(lambda: ScriptedBus(script))
    with link:
        arrival = link.receive(PATIENCE_S)
        assert arrival is not None
        assert arrival.frame.identifier == 0x217
    counters = tally.snapshot()
    assert (counters.error_frames, counters.foreign, counters.frames) == (1, 3, 5)


def test_a_length_that_is_not_that_of_the_data_is_no_length():
    odd = can.Message(arbitration_id=0x210, data=bytes(8), dlc=5, is_extended_id=False, check=False)
    link, _ = linked(lambda: ScriptedBus([odd]))
    with link:
        arrival = link.receive(PATIENCE_S)
    assert arrival is not None
    assert arrival.frame.data == b""


def test_a_refused_frame_is_counted_and_opens_the_adapter_again():
    buses = [ScriptedBus([], refuse=True), ScriptedBus([])]
    link, tally = linked(lambda: buses.pop(0))
    with link:
        assert not link.send(CanFrame(0x110, bytes(8)))
        until(lambda: tally.snapshot().reopened == 1)
        assert link.send(CanFrame(0x110, bytes(8)))
    assert tally.snapshot().send_errors == 1


def test_endless_garbage_opens_the_adapter_again():
    buses = [ScriptedBus([ValueError("garbage")] * 500), ScriptedBus([message()])]
    link, tally = linked(lambda: buses.pop(0))
    with link:
        assert link.receive(PATIENCE_S) is not None
    assert tally.snapshot().reopened == 1


def test_frames_that_nobody_reads_are_dropped_and_counted():
    link, tally = linked(lambda: ScriptedBus([message(data=n.to_bytes(8, "little")) for n in range(9000)]))
    with link:
        until(lambda: tally.snapshot().frames == 9000)
        arrival = link.receive(PATIENCE_S)
    assert tally.snapshot().overflowed == 9000 - 8192
    assert arrival is not None
    assert int.from_bytes(arrival.frame.data, "little") == 9000 - 8192


def test_no_thread_is_left_behind():
    before = set(threading.enumerate())
    link, _ = linked(lambda: ScriptedBus([]))
    with link:
        (reader,) = set(threading.enumerate()) - before
    until(lambda: not reader.is_alive())


def test_slcan_garbage_on_a_pseudo_terminal():
    host, device = os.openpty()
    tty.setraw(device)
    tty.setraw(host)
    options = (("sleep_after_open", 0.0),)
    parameters = BusParameters("slcan", os.ttyname(device), options=options)
    link, tally = linked(lambda: open_bus(parameters))
    try:
        with link:
            os.write(host, b"t21\r\x07tZZZ8\r" + b"t2108" + b"0123456789ABCDEF" + b"\r")
            arrival = link.receive(PATIENCE_S)
            assert arrival is not None
            assert arrival.frame == CanFrame(0x210, bytes.fromhex("0123456789ABCDEF"))
            assert tally.snapshot().receive_errors == 2
            # python-can keeps bytes that are no ASCII for ever; only a fresh start helps.
            os.write(host, b"\xff\r")
            until(lambda: tally.snapshot().reopened == 1)
            os.write(host, b"t2112FFFF\r")
            arrival = link.receive(PATIENCE_S)
            assert arrival is not None
            assert arrival.frame == CanFrame(0x211, b"\xff\xff")
            assert link.send(CanFrame(0x110, b"\x01" * 8))
            sent = b""
            while not sent.endswith(b"t11080101010101010101\r"):
                sent += os.read(host, 100)
    finally:
        os.close(host)
        os.close(device)


def test_an_adapter_that_is_not_there_says_so():
    with pytest.raises(DeviceError, match="slcan /dev/does-not-exist"):
        open_bus(BusParameters("slcan", "/dev/does-not-exist"))


def test_an_unknown_interface_lists_the_known_ones():
    with pytest.raises(ConfigError, match="socketcan"):
        BusParameters("carrier-pigeon")
    with pytest.raises(ConfigError, match="bitrate_bps"):
        BusParameters(bitrate_bps=5)
