"""What host and node say to each other: one immutable record per message, plain values, no bits.

Identifier (11 bit) = function << 7 | node << 4 | sensor: the lower, the more urgent. Nodes are 1 to 7, sensors 0 to 7.
`sequence` numbers the sweeps (modulo 256), `attempt` the triggers of one sweep, `session` the starts of a node.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from surfuse.errors import ConfigError
from surfuse.records import Status

MAX_SENSORS = 8
MAX_ATTEMPTS = 8
MAX_PINGS = 31
ALL_SENSORS = 15


class Function(IntEnum):
    """What a frame is for; the value is the upper part of its identifier."""

    FAULT = 1
    TRIGGER = 2
    ACKNOWLEDGE = 3
    READING = 4
    ECHO = 5
    KIT_PULSE = 6
    KIT_SAMPLING = 7
    QUERY = 8
    HEARTBEAT = 14


class Subject(IntEnum):
    """What an acknowledgement is about."""

    TRIGGER = 1
    KIT = 2


class Result(IntEnum):
    """What became of a request."""

    ACCEPTED = 1
    REPEATED = 2
    DONE = 3
    STALE = 4
    REFUSED = 5


class FaultCode(IntEnum):
    """What is wrong in a node."""

    SENSOR_FAILED = 1
    NO_SUCH_SENSOR = 2
    VALUE_OUT_OF_RANGE = 3
    BAD_FRAME = 4
    KIT_REFUSED = 5


class NodeState(IntEnum):
    """What a node is doing."""

    STARTING = 0
    READY = 1
    FIRING = 2
    FAILED = 3


class TriggerSource(IntEnum):
    """What starts a ping of the kit."""

    INTERNAL = 0
    EXTERNAL = 1


class CanFrame(NamedTuple):
    """One classic CAN frame with an 11-bit identifier.

    `identifier` is made of function (4 bits), node (3) and sensor (4), see the function of that name; `data` is up to 8
    bytes, all of ours have 8.
    """

    identifier: int
    data: bytes


class Trigger(NamedTuple):
    """Fire the sensors of the mask, or send their answers of this sequence again; `together` 1: all at one moment.

    `sensors` has bit k set for sensor k. `epoch` is the number of this run of the host and `sequence` that of the
    sweep, both counted round; `attempt` counts the triggers of one sequence.
    """

    node: int
    sequence: int
    attempt: int
    sensors: int
    epoch: int
    together: int = 0


class Acknowledge(NamedTuple):
    """A request was taken, done or refused; `sensors` is the mask that this is about.

    `sequence` and `attempt` are those of the request, `session` is the number of this start of the node.
    """

    node: int
    sequence: int
    session: int
    subject: Subject
    result: Result
    attempt: int
    sensors: int


class Reading(NamedTuple):
    """Range of one sensor; `attempt` is the trigger that this frame answers.

    `range_m` after REP-117 agrees with `status`; `pings` is how many agreed on it, `spread_m` their standard deviation
    (nan: one ping). `session` is the number of this start of the node.
    """

    node: int
    sensor: int
    sequence: int
    session: int
    status: Status
    pings: int
    range_m: float
    spread_m: float
    attempt: int


class EchoDetail(NamedTuple):
    """When (microseconds after the trigger `accepted`) and how strong the echo of one reading was.

    `accepted` is the attempt that made the node fire, `amplitude` that of the echo (nan: none); the other numbers are
    those of the `Reading`.
    """

    node: int
    sensor: int
    sequence: int
    session: int
    time_us: int
    attempt: int
    accepted: int
    amplitude: float


class Query(NamedTuple):
    """Asks every node with this id for its heartbeat.

    A node answers with a `Heartbeat`; `epoch` is the number of this run of the host.
    """

    node: int
    sequence: int
    epoch: int


class Heartbeat(NamedTuple):
    """A node is alive: its state, error counters, firmware version, and which board it is.

    `uid` is the board and `session` this start of it: two boards with one id show by them. `tx_errors` and
    `rx_errors` count frames that could not be sent and bad ones that came, up to 255.
    """

    node: int
    state: NodeState
    session: int
    tx_errors: int
    rx_errors: int
    version_major: int
    version_minor: int
    uid: int


class FaultReport(NamedTuple):
    """Something is wrong in a node; sensor 15 is the node itself.

    `detail` is the length of a bad frame, else 0. `sequence` is 0 outside of a
    sweep.
    """

    node: int
    sequence: int
    session: int
    code: FaultCode
    sensor: int
    detail: int


@dataclass(frozen=True)
class KitMessage:
    """Parameters of the ranging kit of one sensor.

    frequency_hz : transmit frequency, even numbers up to 131070.
    cycles : length of the burst in periods, 1 to 255.
    blanking_us : time after the burst in which nothing is heard, 0 to 65535.
    gain_db : amplifier gain, 0 to 127.5 in steps of 0.5.
    sample_rate_hz : sampling of the echo, 1 to 16777215.
    trigger_source : what starts a ping.
    pings : pings that are averaged into one reading, 1 to 31.
    """

    frequency_hz: int = 63_000
    cycles: int = 16
    blanking_us: int = 2_380
    gain_db: float = 40.0
    sample_rate_hz: int = 1_000_000
    trigger_source: TriggerSource = TriggerSource.EXTERNAL
    pings: int = 8

    def __post_init__(self) -> None:
        limits = (
            ("frequency_hz", self.frequency_hz, 2, 131_070, 2),
            ("cycles", self.cycles, 1, 255, 1),
            ("blanking_us", self.blanking_us, 0, 65_535, 1),
            ("gain_db", self.gain_db, 0, 127.5, 0.5),
            ("sample_rate_hz", self.sample_rate_hz, 1, 16_777_215, 1),
            ("pings", self.pings, 1, MAX_PINGS, 1),
        )
        for name, value, low, high, step in limits:
            if not low <= value <= high or value % step:
                raise ConfigError(
                    f"kit parameter {name} = {value}", cure=f"give {low} to {high} in steps of {step}, as the bus does"
                )


class KitPulse(NamedTuple):
    """First half of the kit parameters as they travel.

    `blanking_us` in microseconds, the rest in the units of the names; limits as in `KitMessage`. It does nothing until
    the second half has come.
    """

    node: int
    sequence: int
    sensor: int
    frequency_hz: int
    cycles: int
    blanking_us: int
    gain_db: float


class KitSampling(NamedTuple):
    """Second half of the kit parameters as they travel.

    The two halves belong together by `sequence` and `sensor`; the node acknowledges them both with one answer.
    """

    node: int
    sequence: int
    sensor: int
    trigger_source: TriggerSource
    sample_rate_hz: int
    pings: int


Message = Trigger | Acknowledge | Reading | EchoDetail | KitPulse | KitSampling | Query | Heartbeat | FaultReport


def identifier(function: Function, node: int, sensor: int = 0) -> int:
    """The 11-bit identifier of a message."""
    return function << 7 | node << 4 | sensor
