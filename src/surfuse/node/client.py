"""The host's side of the conversation with one node: roll call, sweeps asked for until they are whole, kit settings."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from surfuse.errors import DeviceError
from surfuse.interfaces import Clock
from surfuse.node.catalogue import Catalogue, Rejection
from surfuse.node.counters import BusEvent, Tally
from surfuse.node.exchange import Exchange
from surfuse.node.failures import no_adapter, no_answer, no_heartbeat, two_nodes
from surfuse.node.link import Arrival, Link
from surfuse.node.messages import (
    ALL_SENSORS,
    MAX_ATTEMPTS,
    Acknowledge,
    EchoDetail,
    FaultReport,
    Heartbeat,
    KitMessage,
    KitPulse,
    KitSampling,
    Query,
    Reading,
    Result,
    Subject,
    Trigger,
)
from surfuse.node.timeouts import NodeTimeouts
from surfuse.node.watch import LineVerdict, NodeWatch
from surfuse.records import SensorSpec

_REJECTED = {
    Rejection.FOREIGN: BusEvent.FOREIGN,
    Rejection.WRONG_LENGTH: BusEvent.WRONG_LENGTH,
    Rejection.UNKNOWN_WORD: BusEvent.UNKNOWN_WORD,
    Rejection.SENTINEL: BusEvent.CONTRADICTORY,
}
_QUERY_PAUSE_S = 0.2
_REMEMBERED_SWEEPS = 8


@dataclass(frozen=True)
class Line:
    """What the conversation with a node goes over.

    link : carries the frames; it is open.
    catalogue : makes frames of messages and back.
    clock : time of the readings, in s.
    tally : counts what goes wrong on the bus.
    monotonic_s : measures the waiting, which is real also when `clock` is simulated.
    """

    link: Link
    catalogue: Catalogue
    clock: Clock
    tally: Tally
    monotonic_s: Callable[[], float] = time.monotonic


class NodeClient:
    """One node, asked over a link that is open.

    Parameters
    ----------
    node : its address, 1 to 7.
    specs : spec of each sensor that is asked, by its number in the node.
    timeouts : waiting and asking again.
    line : what the conversation goes over.
    wave_speed_max_m_s, together : see `Exchange`.
    """

    def __init__(
        self,
        node: int,
        specs: dict[int, SensorSpec],
        timeouts: NodeTimeouts,
        line: Line,
        *,
        wave_speed_max_m_s: float = 400.0,
        together: bool = False,
    ) -> None:
        self._node, self._specs, self._patience, self._speed_m_s = node, specs, timeouts, wave_speed_max_m_s
        self._together = together
        self._link, self._catalogue, self._clock, self._tally = line.link, line.catalogue, line.clock, line.tally
        self._monotonic_s = line.monotonic_s
        self._epoch = 0
        self._sequence = 0
        self._kit_sequence = 0
        self._current: Exchange | None = None
        self._past: deque[Exchange] = deque()
        self._settings: dict[int, KitMessage] = {}
        self._kit_answer: Acknowledge | None = None
        self._unconfigured = False
        self._rivals = False
        self._deaf_since_s: float | None = None
        self.watch = NodeWatch()

    def connect(self) -> None:
        """Wait for the node, and for a second one with its id.

        Raises
        ------
        DeviceError : no heartbeat came, or two boards sent one.
        """
        start_s = self._monotonic_s()
        # Numbers of an earlier run of the host must not look like ours.
        self._epoch = int(start_s * 1e6) & 0xFFFF
        self._sequence = self._epoch & 0xFF
        give_up_s = start_s + self._patience.connect_timeout_s
        while self.watch.last_heartbeat is None:
            if self._monotonic_s() >= give_up_s:
                raise self.lost()
            self._link.send(self._catalogue.encode(Query(self._node, 0, self._epoch)))
            self._gather(_QUERY_PAUSE_S, until_heartbeat=True)
        self._gather(self._patience.roll_call_s, until_heartbeat=False)
        if self._rivals:
            raise self.lost()

    def close(self) -> None:
        """Count what the last sweeps still lack, once the frames on their way have come."""
        self._gather(self._patience.reorder_grace_s, until_heartbeat=False)
        if self._current is not None:
            self._past.append(self._current)
            self._current = None
        while self._past:
            self._past.popleft().close()

    def ask(self) -> Exchange:
        """Have all sensors fired once, and ask until their answers are whole, void, or given up.

        Raises
        ------
        DeviceError : two nodes answer under one id, so that no number says whose it is.
        """
        exchange = self._begin()
        timeouts = self._patience
        wait_s, heard_s = timeouts.answer_timeout_s, self._monotonic_s()
        while exchange.attempts < MAX_ATTEMPTS:
            if self._unconfigured:
                self._configure_again()
            news = exchange.news
            limit_s = self._send(exchange.trigger(self._clock.now_s()))
            self._listen(exchange, min(wait_s, limit_s))
            if exchange.void or not exchange.missing:
                break
            if exchange.news > news:
                heard_s = self._monotonic_s()
            if exchange.answered:
                continue
            # The node is silent, or slower than we thought: firing may take longer than our patience.
            silent_s = self._monotonic_s() - heard_s
            if silent_s >= limit_s:
                break
            wait_s = min(2.0 * wait_s, limit_s - silent_s)
        exchange.over = True
        if self._rivals:
            raise self.lost()
        return exchange

    def configure(self, number: int, settings: KitMessage) -> None:
        """Set the kit parameters of one sensor (15: of all); they are sent again after a restart of the node.

        Raises
        ------
        DeviceError : the node refuses them, or does not answer.
        """
        self._tell(number, settings)
        if number == ALL_SENSORS:
            self._settings.clear()
        self._settings[number] = settings

    def lost(self) -> DeviceError:
        """The error that says why the node cannot be used."""
        counts = self._tally.snapshot()
        if self._rivals:
            return two_nodes(self._node, self.watch.boards)
        if self._deaf_since_s is not None:
            return no_adapter(self._node, counts)
        if self.watch.last_heartbeat is None:
            return no_heartbeat(self._node, counts, self._patience.connect_timeout_s)
        return no_answer(self._node, counts)

    def _begin(self) -> Exchange:
        if self._current is not None:
            self._past.append(self._current)
        if len(self._past) > _REMEMBERED_SWEEPS:
            self._past.popleft().close()
        self._sequence = (self._sequence + 1) % 256
        who = self._node, self._sequence, self._epoch, self._specs, self._tally
        self._current = Exchange(*who, self._speed_m_s, self._together)
        return self._current

    def _send(self, trigger: Trigger) -> float:
        """Send a trigger; returns how long it makes sense to wait for an answer."""
        if self._link.send(self._catalogue.encode(trigger)):
            self._deaf_since_s = None
            return self._patience.silence_limit_s
        now_s = self._monotonic_s()
        if self._deaf_since_s is None:
            self._deaf_since_s = now_s
        left_s = self._patience.adapter_limit_s - (now_s - self._deaf_since_s)
        return min(max(left_s, 0.0), self._patience.silence_limit_s)

    def _listen(self, exchange: Exchange, wait_s: float) -> None:
        deadline_s = self._monotonic_s() + wait_s
        while exchange.missing and not exchange.void:
            left_s = deadline_s - self._monotonic_s()
            if left_s <= 0.0:
                return
            arrival = self._link.receive(left_s)
            if arrival is None:
                continue
            news = exchange.news
            self._take(arrival)
            if exchange.news > news:
                pause_s = min(wait_s, self._patience.reorder_grace_s) if exchange.answered else wait_s
                deadline_s = self._monotonic_s() + pause_s

    def _gather(self, duration_s: float, *, until_heartbeat: bool) -> None:
        deadline_s = self._monotonic_s() + duration_s
        while (left_s := deadline_s - self._monotonic_s()) > 0.0:
            arrival = self._link.receive(left_s)
            if arrival is not None:
                self._take(arrival)
            if until_heartbeat and self.watch.last_heartbeat is not None:
                return

    def _take(self, arrival: Arrival) -> None:
        message = self._catalogue.decode(arrival.frame)
        if isinstance(message, Rejection):
            self._tally.add(_REJECTED[message])
        elif message.node != self._node:
            self._tally.add(BusEvent.FOREIGN)
        elif isinstance(message, Heartbeat):
            self._judge(self.watch.hear(message))
        elif isinstance(message, FaultReport):
            self._tally.add(BusEvent.NODE_FAULTS)
        elif isinstance(message, Acknowledge) and message.subject is Subject.KIT:
            self._kit_answer = message
        elif isinstance(message, Reading | EchoDetail | Acknowledge):
            self._route(message, arrival.t_s)
        elif isinstance(message, Trigger | Query) and message.epoch == self._epoch:
            return  # some adapters return what they send
        else:
            self._tally.add(BusEvent.FOREIGN)

    def _route(self, message: Reading | EchoDetail | Acknowledge, arrival_s: float) -> None:
        current = self._current
        if current is not None and message.sequence == current.sequence:
            if self._judge(self.watch.see(message.session)) is LineVerdict.SAME:
                current.session = message.session
                self._accept(current, message, arrival_s)
            return
        for exchange in reversed(self._past):
            if exchange.sequence == message.sequence:
                if exchange.session == message.session:
                    self._accept(exchange, message, arrival_s)
                else:
                    self._judge(self.watch.see(message.session))
                return
        self._tally.add(BusEvent.UNSOLICITED)

    def _accept(self, exchange: Exchange, message: Reading | EchoDetail | Acknowledge, arrival_s: float) -> None:
        exchange.accept(message, arrival_s)
        if exchange.contradicted:
            self._judge(LineVerdict.RIVAL)

    def _judge(self, verdict: LineVerdict) -> LineVerdict:
        if verdict is LineVerdict.SAME:
            return verdict
        self._tally.add(BusEvent.RESTARTS if verdict is LineVerdict.RESTARTED else BusEvent.CONFLICTS)
        self._unconfigured = self._unconfigured or verdict is LineVerdict.RESTARTED
        self._rivals = self._rivals or verdict is LineVerdict.RIVAL
        if self._current is not None and not self._current.over:
            self._current.void = True
        return verdict

    def _configure_again(self) -> None:
        self._unconfigured = False
        for number, settings in self._settings.items():
            self._tell(number, settings)

    def _tell(self, number: int, settings: KitMessage) -> None:
        self._kit_sequence = (self._kit_sequence + 1) % 256
        head = self._node, self._kit_sequence, number
        pulse = KitPulse(*head, settings.frequency_hz, settings.cycles, settings.blanking_us, settings.gain_db)
        sampling = KitSampling(*head, settings.trigger_source, settings.sample_rate_hz, settings.pings)
        for _ in range(MAX_ATTEMPTS):
            self._link.send(self._catalogue.encode(pulse))
            self._link.send(self._catalogue.encode(sampling))
            result = self._kit_result()
            if result is Result.ACCEPTED:
                return
            if result is not None:
                cure = "ask for what its kit can do"
                raise DeviceError(f"refuses {settings}", cure=cure, where=f"sensor node {self._node}")
        raise self.lost()

    def _kit_result(self) -> Result | None:
        deadline_s = self._monotonic_s() + self._patience.answer_timeout_s
        while (left_s := deadline_s - self._monotonic_s()) > 0.0:
            arrival = self._link.receive(left_s)
            if arrival is not None:
                self._take(arrival)
            answer = self._kit_answer
            if answer is not None and answer.sequence == self._kit_sequence:
                return answer.result
        return None
