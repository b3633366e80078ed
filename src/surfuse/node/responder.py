"""The node without its bus: a frame comes in, frames go out; the firmware loop is this and a python-can bus.

One sequence is fired once. A repeated trigger gets the kept answers again, so that lost, late and doubled frames never
change a number.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from surfuse.errors import ConfigError, DataError, SurfuseError
from surfuse.interfaces import Clock, RangeSensor
from surfuse.node.catalogue import Catalogue, Rejection
from surfuse.node.messages import (
    ALL_SENSORS,
    MAX_PINGS,
    MAX_SENSORS,
    Acknowledge,
    CanFrame,
    EchoDetail,
    FaultCode,
    FaultReport,
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
)
from surfuse.records import Echo, Status

VERSION = (1, 1)
_US_PER_S = 1e6
_WRONG_NUMBER = Echo(range_m=math.nan, status=Status.FAULT, t_s=math.nan, count=0)

Average = Callable[[Sequence[Echo]], Echo]
SimultaneousFire = Callable[[Sequence[int]], Sequence[Echo | None]]
Configure = Callable[[int, KitMessage], None]


@dataclass(frozen=True)
class NodeIdentity:
    """Which node this is.

    node : its address on the bus, 1 to 7.
    uid : the board, 0 to 65535; two boards never share one.
    session : this start of the program, 0 to 255; another one than at the start before.
    """

    node: int = 1
    uid: int = 1
    session: int = 1

    def __post_init__(self) -> None:
        for name, value, low, high in (("node", self.node, 1, 7), ("uid", self.uid, 0, 65_535)):
            if not low <= value <= high:
                raise ConfigError(f"{name} = {value}", cure=f"give {low} to {high}")
        if not 0 <= self.session <= 255:
            raise ConfigError(f"session = {self.session}", cure="give 0 to 255")


@dataclass(frozen=True)
class NodeAbilities:
    """What a node can do with its sensors besides asking one after the other.

    Parameters
    ----------
    pings : readings that are taken of a sensor for one answer, 1 to 31; the kit message changes it.
    average : makes one answer of them; needed when `pings` > 1.
    configure : takes the kit parameters of one sensor; raises a `SurfuseError` to refuse. None: only `pings` is heeded,
        and only with an average.
    air : held while a sensor is in the air; share it among nodes that hear each other.
    fire_together : has the sensors of these numbers send at the same moment; None for one that failed. None: the node
        can only fire one after the other, and refuses triggers that ask for more.

    Raises
    ------
    ConfigError : pings out of their limits, or without an average.
    """

    pings: int = 1
    average: Average | None = None
    configure: Configure | None = None
    air: threading.Lock | None = None
    fire_together: SimultaneousFire | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.pings <= MAX_PINGS or (self.pings > 1 and self.average is None):
            raise ConfigError(f"pings = {self.pings}", cure=f"give 1 to {MAX_PINGS}, and an average when more than 1")


PLAIN = NodeAbilities()


class Responder:
    """What a node answers.

    Parameters
    ----------
    sensors : the rangers in the order of their numbers, at most 8.
    clock : time of the node; emissions are told relative to the trigger.
    identity : address, board and start.
    catalogue : the messages.
    abilities : what the node can do with its sensors besides.
    """

    def __init__(
        self,
        sensors: Sequence[RangeSensor],
        clock: Clock,
        identity: NodeIdentity,
        catalogue: Catalogue,
        abilities: NodeAbilities = PLAIN,
    ) -> None:
        if not 1 <= len(sensors) <= MAX_SENSORS:
            raise ConfigError(f"a node with {len(sensors)} sensors", cure=f"give 1 to {MAX_SENSORS}")
        self._sensors = tuple(sensors)
        self._clock = clock
        self._identity = identity
        self._catalogue = catalogue
        self._pings = [abilities.pings] * len(sensors)
        self._average = abilities.average
        self._configure = abilities.configure
        self._air = abilities.air or threading.Lock()
        self._volley = abilities.fire_together
        self._epoch: int | None = None
        self._sequence = 0
        self._accepted = 0
        self._accepted_s = 0.0
        self._answers: dict[int, tuple[Reading, EchoDetail]] = {}
        self._half: KitPulse | None = None
        self.state = NodeState.STARTING
        self.bad_frames = 0
        self.send_errors = 0

    def answer(self, frame: CanFrame) -> Iterator[CanFrame]:
        """The frames that answer one frame, each as soon as it is known; frames for others have no answer."""
        message = self._catalogue.decode(frame)
        if isinstance(message, Rejection):
            if message is not Rejection.FOREIGN and frame.identifier >> 4 & 7 == self._identity.node:
                self.bad_frames += 1
                yield self._fault(0, FaultCode.BAD_FRAME, ALL_SENSORS, len(frame.data))
        elif message.node != self._identity.node:
            return
        elif isinstance(message, Trigger):
            yield from self._trigger(message)
        elif isinstance(message, Query):
            yield self.heartbeat()
        elif isinstance(message, KitPulse):
            self._half = message
        elif isinstance(message, KitSampling):
            yield from self._kit(message)

    def heartbeat(self) -> CanFrame:
        """The sign of life."""
        who = self._identity
        errors = min(self.send_errors, 255), min(self.bad_frames, 255)
        return self._catalogue.encode(Heartbeat(who.node, self.state, who.session, *errors, *VERSION, who.uid))

    def _trigger(self, trigger: Trigger) -> Iterator[CanFrame]:
        fresh = trigger.epoch != self._epoch
        ahead = (trigger.sequence - self._sequence) % 256
        if not fresh and ahead >= 128:
            yield self._acknowledge(Subject.TRIGGER, trigger.sequence, Result.STALE, trigger.attempt, trigger.sensors)
            return
        absent = trigger.sensors >> len(self._sensors) << len(self._sensors)
        if trigger.together and self._volley is None:
            absent = trigger.sensors
        if absent:
            yield self._acknowledge(Subject.TRIGGER, trigger.sequence, Result.REFUSED, trigger.attempt, absent)
        repeated = not fresh and ahead == 0
        if not repeated:
            self._epoch, self._sequence = trigger.epoch, trigger.sequence
            self._accepted, self._accepted_s, self._answers = trigger.attempt, self._clock.now_s(), {}
        sensors = trigger.sensors & ~absent
        result = Result.REPEATED if repeated else Result.ACCEPTED
        yield self._acknowledge(Subject.TRIGGER, trigger.sequence, result, trigger.attempt, sensors)
        asked = [sensor for sensor in range(len(self._sensors)) if sensors >> sensor & 1]
        if trigger.together:
            yield from self._fire_together([sensor for sensor in asked if sensor not in self._answers])
        for sensor in asked:
            yield from self._send(sensor, trigger.attempt)
        self.state = NodeState.READY
        yield self._acknowledge(Subject.TRIGGER, trigger.sequence, Result.DONE, trigger.attempt, sensors)

    def _send(self, sensor: int, attempt: int) -> Iterator[CanFrame]:
        if sensor not in self._answers:
            self.state = NodeState.FIRING
            yield from self._keep(sensor, self._fire(sensor))
        yield from self._encoded(sensor, attempt)

    def _keep(self, sensor: int, echo: Echo | None) -> Iterator[CanFrame]:
        """Keep an answer (None: the sensor failed) to be sent as often as asked; say so when it is no good."""
        code = None if echo is not None else FaultCode.SENSOR_FAILED
        try:
            self._answers[sensor] = self._told(sensor, echo or _WRONG_NUMBER)
            self._encoded(sensor, 0)
        except DataError:
            code = FaultCode.VALUE_OUT_OF_RANGE
            self._answers[sensor] = self._told(sensor, _WRONG_NUMBER)
        if code is not None:
            yield self._fault(self._sequence, code, sensor, 0)

    def _encoded(self, sensor: int, attempt: int) -> tuple[CanFrame, CanFrame]:
        reading, detail = self._answers[sensor]
        encode = self._catalogue.encode
        return encode(reading._replace(attempt=attempt)), encode(detail._replace(attempt=attempt))

    def _fire(self, sensor: int) -> Echo | None:
        """One averaged answer, None of a sensor that failed; only one of the node is in the air at a time."""
        with self._air:
            try:
                echoes = [self._sensors[sensor].fire() for _ in range(self._pings[sensor])]
            except Exception:  # a driver is foreign code: whatever breaks in it must not stop the node
                return None
        return self._averaged(echoes)

    def _fire_together(self, sensors: list[int]) -> Iterator[CanFrame]:
        """One averaged answer of each, all in the air at the same moments."""
        if not sensors or self._volley is None:
            return
        self.state = NodeState.FIRING
        with self._air:
            volleys = [self._volley(sensors) for _ in range(max(self._pings[sensor] for sensor in sensors))]
        for place, sensor in enumerate(sensors):
            echoes = [fire_together[place] for fire_together in volleys[: self._pings[sensor]]]
            yield from self._keep(sensor, self._averaged(echoes))

    def _averaged(self, echoes: Sequence[Echo | None]) -> Echo | None:
        """One answer of several; None when one of them failed."""
        heard = [echo for echo in echoes if echo is not None]
        if len(heard) < len(echoes):
            return None
        try:
            return heard[0] if self._average is None else self._average(heard)
        except SurfuseError:
            return None

    def _told(self, sensor: int, echo: Echo) -> tuple[Reading, EchoDetail]:
        """An echo in the words of the bus."""
        who, sequence = self._identity, self._sequence
        since_s = echo.t_s - self._accepted_s
        if not math.isfinite(since_s):
            if echo.status is not Status.FAULT:
                raise DataError(f"an echo at t_s = {echo.t_s}", cure="give the moment of the first emission")
            since_s = 0.0
        spread_m = echo.spread_m if math.isfinite(echo.spread_m) else math.nan
        reading = Reading(
            who.node, sensor, sequence, who.session, echo.status, echo.count, echo.range_m, spread_m, attempt=0
        )
        detail = EchoDetail(
            who.node, sensor, sequence, who.session, round(since_s * _US_PER_S), 0, self._accepted, echo.amplitude
        )
        return reading, detail

    def _kit(self, sampling: KitSampling) -> Iterator[CanFrame]:
        half = self._half
        if half is None or (half.sequence, half.sensor) != (sampling.sequence, sampling.sensor):
            return
        every = sampling.sensor == ALL_SENSORS
        sensors = range(len(self._sensors)) if every else range(sampling.sensor, sampling.sensor + 1)
        mask = sum(1 << sensor for sensor in sensors)
        try:
            settings = KitMessage(*half[3:], sampling.sample_rate_hz, sampling.trigger_source, sampling.pings)
            if sensors[-1] >= len(self._sensors) or (self._configure is None and self._average is None):
                raise ConfigError("no such sensor, or nothing to set")
            for sensor in sensors:
                if self._configure is not None:
                    self._configure(sensor, settings)
                if self._average is not None:
                    self._pings[sensor] = settings.pings
        except SurfuseError:
            yield self._fault(sampling.sequence, FaultCode.KIT_REFUSED, sampling.sensor, 0)
            yield self._acknowledge(Subject.KIT, sampling.sequence, Result.REFUSED, 0, mask & 0xFFFF)
            return
        yield self._acknowledge(Subject.KIT, sampling.sequence, Result.ACCEPTED, 0, mask)

    def _acknowledge(self, subject: Subject, sequence: int, result: Result, attempt: int, sensors: int) -> CanFrame:
        who = self._identity
        return self._catalogue.encode(Acknowledge(who.node, sequence, who.session, subject, result, attempt, sensors))

    def _fault(self, sequence: int, code: FaultCode, sensor: int, detail: int) -> CanFrame:
        who = self._identity
        return self._catalogue.encode(FaultReport(who.node, sequence, who.session, code, sensor, detail))
