"""One sweep as the host sees it: triggers out, frames in, in any order, doubled, late, or not at all."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from surfuse.node.counters import BusEvent, Tally
from surfuse.node.messages import Acknowledge, EchoDetail, Reading, Result, Trigger
from surfuse.records import Echo, SensorSpec, Status

_ORDER_DONE = 1_000
_ORDER_ATTEMPT = 10_000
_CLOCK_TOLERANCE_S = 1e-3
_CLOCK_TOLERANCE = 1e-3


@dataclass
class _Attempt:
    """One trigger: when it was sent, which sensors it asked for, which frames answered it (by their order)."""

    sent_s: float
    sensors: int
    seen: set[int] = field(default_factory=set)
    refused: int = 0
    stale: bool = False

    def expected(self) -> set[int]:
        """Orders of the frames of a whole answer."""
        wanted = self.sensors & ~self.refused
        orders = {order for sensor in _numbers(wanted) for order in (1 + 2 * sensor, 2 + 2 * sensor)}
        return orders | {0, _ORDER_DONE}


class Exchange:
    """The frames of one sequence number, checked and put together.

    Parameters
    ----------
    node, sequence, epoch : address, number of the sweep, number of this run of the host.
    specs : spec of each sensor by its number in the node.
    tally : where events are counted.
    wave_speed_max_m_s : no echo of an ultrasonic sensor is faster; 400 m/s is air at 125 degrees Celsius.
    together : have all sensors send at the same moment instead of one after the other.
    """

    def __init__(
        self,
        node: int,
        sequence: int,
        epoch: int,
        specs: dict[int, SensorSpec],
        tally: Tally,
        wave_speed_max_m_s: float = 400.0,
        together: bool = False,
    ) -> None:
        self.sequence = sequence
        self._node, self._epoch, self._specs, self._tally = node, epoch, specs, tally
        self._speed_m_s, self._together = wave_speed_max_m_s, together
        self._attempts: list[_Attempt] = []
        self._readings: dict[int, tuple[Reading, float]] = {}
        self._details: dict[int, EchoDetail] = {}
        self._highest = -1
        self.over = False
        self.void = False
        self.contradicted = False
        self.poisoned: set[int] = set()
        self.refused: set[int] = set()
        self.news = 0
        self.session: int | None = None

    @property
    def attempts(self) -> int:
        """Triggers sent so far."""
        return len(self._attempts)

    @property
    def missing(self) -> int:
        """Mask of the sensors whose answer is not complete."""
        done = (self._readings.keys() & self._details.keys()) | self.refused
        return sum(1 << sensor for sensor in self._specs if sensor not in done)

    @property
    def untrusted(self) -> set[int]:
        """Sensors without a trustworthy answer."""
        if self.void:
            return set(self._specs)
        return self.poisoned | self.refused | set(_numbers(self.missing))

    @property
    def answered(self) -> bool:
        """Whether the node says that it has sent all answers to the last trigger."""
        return _ORDER_DONE in self._attempts[-1].seen

    def trigger(self, now_s: float) -> Trigger:
        """The next trigger: it asks for what is missing."""
        attempt = _Attempt(now_s, self.missing)
        self._attempts.append(attempt)
        self._tally.add(BusEvent.TRIGGERS if len(self._attempts) == 1 else BusEvent.RETRIGGERS)
        number = len(self._attempts) - 1
        return Trigger(self._node, self.sequence, number, attempt.sensors, self._epoch, int(self._together))

    def accept(self, message: Reading | EchoDetail | Acknowledge, arrival_s: float) -> None:
        """Take in one message of this sequence; its session is already known to be the right one."""
        if message.attempt >= len(self._attempts):
            self._tally.add(BusEvent.UNSOLICITED)
            return
        if isinstance(message, Acknowledge):
            order = self._acknowledge(message)
        elif message.sensor not in self._specs:
            self._tally.add(BusEvent.UNSOLICITED)
            return
        elif isinstance(message, Reading):
            order = 1 + 2 * message.sensor
            known = self._readings.setdefault(message.sensor, (message, arrival_s))[0]
            self._compare(known._replace(attempt=message.attempt) == message)
        else:
            order = 2 + 2 * message.sensor
            detail = self._details.setdefault(message.sensor, message)
            self._compare(detail._replace(attempt=message.attempt) == message)
        if order in self._attempts[message.attempt].seen:
            self._tally.add(BusEvent.DUPLICATED)
            return
        self._attempts[message.attempt].seen.add(order)
        self.news += 1
        if self.over and not isinstance(message, Acknowledge):
            self._tally.add(BusEvent.LATE)
        self._watch_order(message.attempt * _ORDER_ATTEMPT + order)
        if not isinstance(message, Acknowledge):
            self._check_time(message.sensor)

    def echo(self, sensor: int) -> Echo:
        """The answer of one sensor; a fault when no trustworthy one came."""
        if sensor in self.untrusted:
            sent_s = self._attempts[0].sent_s if self._attempts else math.nan
            return Echo(math.nan, Status.FAULT, sent_s, count=0)
        reading, detail = self._readings[sensor][0], self._details[sensor]
        return Echo(
            range_m=reading.range_m,
            status=reading.status,
            t_s=self._attempts[detail.accepted].sent_s + detail.time_us * 1e-6,
            amplitude=detail.amplitude,
            spread_m=reading.spread_m,
            count=reading.pings,
        )

    def close(self) -> None:
        """Count what never came; a sweep that a restart made void has no countable losses."""
        if self.void:
            return
        for attempt in self._attempts:
            if not attempt.seen:
                self._tally.add(BusEvent.UNANSWERED)
            elif not attempt.stale:
                self._tally.add(BusEvent.LOST, len(attempt.expected() - attempt.seen))

    def _acknowledge(self, message: Acknowledge) -> int:
        attempt = self._attempts[message.attempt]
        if message.result is Result.DONE:
            return _ORDER_DONE
        if message.result is Result.REFUSED:
            attempt.refused |= message.sensors
            self.refused.update(sensor for sensor in self._specs if message.sensors >> sensor & 1)
            return -1
        attempt.stale = message.result is Result.STALE
        return 0

    def _compare(self, same: bool) -> None:
        """Two values for one reading come from two nodes, and then no reading says whose it is."""
        self.contradicted = self.contradicted or not same

    def _watch_order(self, order: int) -> None:
        if order < self._highest:
            self._tally.add(BusEvent.REORDERED)
        self._highest = max(self._highest, order)

    def _check_time(self, sensor: int) -> None:
        """An answer cannot come before its echo: emission and flight both lie between trigger and answer."""
        if sensor not in self._readings or sensor not in self._details or sensor in self.poisoned:
            return
        (reading, arrival_s), detail = self._readings[sensor], self._details[sensor]
        if detail.accepted >= len(self._attempts):
            self._compare(False)
            return
        flight_s = 0.0
        if reading.status is Status.OK and self._specs[sensor].kind == "ultrasonic":
            flight_s = 2.0 * reading.range_m / self._speed_m_s
        least_s = (detail.time_us * 1e-6 + flight_s) * (1.0 - _CLOCK_TOLERANCE) - _CLOCK_TOLERANCE_S
        if arrival_s - self._attempts[detail.accepted].sent_s < least_s:
            self._tally.add(BusEvent.TOO_FAST)
            self.poisoned.add(sensor)


def _numbers(mask: int) -> list[int]:
    return [sensor for sensor in range(mask.bit_length()) if mask >> sensor & 1]
