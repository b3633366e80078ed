"""Frames to messages and back, after the bit positions of the DBC file, with the checks that a DBC cannot express.

A DBC decoder takes nine bytes for eight, a sentinel for a range, and an unknown word for a number; here each of these
is a `Rejection`. Sentinel: all bits of a field set. Ranges follow REP-117: `+inf` nothing, `-inf` too close, `nan`
faulty.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum
from pathlib import Path

from surfuse.errors import DataError
from surfuse.node.layout import FRAME_BYTES, Layouts, load_layouts
from surfuse.node.messages import (
    Acknowledge,
    CanFrame,
    EchoDetail,
    FaultCode,
    FaultReport,
    Function,
    Heartbeat,
    KitPulse,
    KitSampling,
    Message,
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

_FUNCTIONS = frozenset(int(function) for function in Function)
_RANGE_OF = {Status.NO_ECHO: math.inf, Status.TOO_CLOSE: -math.inf, Status.FAULT: math.nan}
_STATUSES = tuple(Status)
_MM_PER_M = 1000.0
_PLAIN: dict[type[Message], Function] = {
    Trigger: Function.TRIGGER,
    Acknowledge: Function.ACKNOWLEDGE,
    Query: Function.QUERY,
    FaultReport: Function.FAULT,
    KitSampling: Function.KIT_SAMPLING,
}


class Rejection(Enum):
    """Why a frame was not taken for a message."""

    FOREIGN = "identifier of another system"
    WRONG_LENGTH = "not 8 bytes"
    UNKNOWN_WORD = "a word that the catalogue does not know"
    SENTINEL = "range, count and status contradict each other"


class Catalogue:
    """Encoder and decoder of all messages.

    Parameters
    ----------
    path : a DBC file of the user's; None: the one of this package.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._layouts: Layouts = load_layouts(path)
        reading, echo = self._layouts[Function.READING], self._layouts[Function.ECHO]
        _, _, _, self._count, range_, spread, _ = zip(reading.fields, reading.scales, strict=True)
        self._range_none, self._range_per_m = range_[0][1], round(_MM_PER_M / range_[1])
        self._spread_none, self._spread_per_m = spread[0][1], round(_MM_PER_M / spread[1])
        self._count_max = self._count[0][1]
        self._amplitude_none, self._amplitude_per_one = echo.fields[5][1], round(1.0 / echo.scales[5])
        self._decoders: dict[int, Callable[[int, int, tuple[int, ...]], Message | Rejection]] = {
            Function.FAULT: _fault,
            Function.TRIGGER: lambda node, _, raw: Trigger(node, *raw),
            Function.ACKNOWLEDGE: _acknowledge,
            Function.READING: self._reading,
            Function.ECHO: self._echo,
            Function.KIT_PULSE: self._kit_pulse,
            Function.KIT_SAMPLING: _kit_sampling,
            Function.QUERY: lambda node, _, raw: Query(node, *raw),
            Function.HEARTBEAT: _heartbeat,
        }
        self._unpack = {int(function): layout.unpack for function, layout in self._layouts.items()}

    def decode(self, frame: CanFrame) -> Message | Rejection:
        """The message in a frame, or why there is none."""
        function = frame.identifier >> 7
        if function not in _FUNCTIONS or frame.identifier >> 11:
            return Rejection.FOREIGN
        if len(frame.data) != FRAME_BYTES:
            return Rejection.WRONG_LENGTH
        raw = self._unpack[function](frame.data)
        return self._decoders[function](frame.identifier >> 4 & 7, frame.identifier & 15, raw)

    def encode(self, message: Message) -> CanFrame:
        """The frame of a message.

        Raises
        ------
        DataError : a value cannot be told on the bus (a range beyond 41 m, a negative time).
        """
        if isinstance(message, Reading):
            return self._encode_reading(message)
        if isinstance(message, EchoDetail):
            strength = self._raw_amplitude(message.amplitude)
            return self._frame(Function.ECHO, message.node, message.sensor, *message[2:7], strength)
        if isinstance(message, KitPulse):
            scales = self._layouts[Function.KIT_PULSE].scales
            frequency, gain = round(message.frequency_hz / scales[2]), round(message.gain_db / scales[5])
            raw = (message.sequence, message.sensor, frequency, message.cycles, message.blanking_us, gain)
            return self._frame(Function.KIT_PULSE, message.node, 0, *raw)
        if isinstance(message, Heartbeat):
            return self._frame(Function.HEARTBEAT, message.node, 0, *message)
        return self._frame(_PLAIN[type(message)], message.node, 0, *message[1:])

    def _frame(self, function: Function, node: int, sensor: int, *raw: int) -> CanFrame:
        return CanFrame(identifier(function, node, sensor), self._layouts[function].pack(*raw))

    def _encode_reading(self, reading: Reading) -> CanFrame:
        range_raw = self._range_none
        if reading.status is Status.OK:
            if not 0.0 < reading.range_m < math.inf or reading.pings == 0:
                what = f"range {reading.range_m} m of {reading.pings} pings with status OK"
                raise DataError(what, cure="give a positive finite range of at least one ping")
            range_raw = round(reading.range_m * self._range_per_m)
            if not 0 < range_raw < self._range_none:
                limit = self._range_none / self._range_per_m
                raise DataError(f"range {reading.range_m} m", cure=f"the bus carries 0.01 mm to {limit:.0f} m")
        spread = self._spread_none
        if not math.isnan(reading.spread_m):
            spread = round(reading.spread_m * self._spread_per_m)
            if not 0 <= spread < self._spread_none:
                raise DataError(f"spread {reading.spread_m} m", cure="the bus carries 0 to 327 mm")
        if not 0 <= reading.pings <= self._count_max:
            raise DataError(f"{reading.pings} pings", cure=f"the bus carries 0 to {self._count_max}")
        raw = (reading.sequence, reading.session, reading.status, reading.pings, range_raw, spread, reading.attempt)
        return self._frame(Function.READING, reading.node, reading.sensor, *raw)

    def _raw_amplitude(self, amplitude: float) -> int:
        if math.isnan(amplitude):
            return self._amplitude_none
        raw = round(amplitude * self._amplitude_per_one) if math.isfinite(amplitude) else -1
        if not 0 <= raw < self._amplitude_none:
            raise DataError(f"amplitude {amplitude}", cure="the bus carries 0 to 13.1 (1: a facing plate) or nan")
        return raw

    def _reading(self, node: int, sensor: int, raw: tuple[int, ...]) -> Message | Rejection:
        sequence, session, word, count, range_raw, spread_raw, attempt = raw
        if word >= len(_STATUSES):
            return Rejection.UNKNOWN_WORD
        status = _STATUSES[word]
        if status is Status.OK:
            if not 0 < range_raw < self._range_none or count == 0:
                return Rejection.SENTINEL
            range_m = range_raw / self._range_per_m
        else:
            if range_raw != self._range_none:
                return Rejection.SENTINEL
            range_m = _RANGE_OF[status]
        spread_m = math.nan if spread_raw == self._spread_none else spread_raw / self._spread_per_m
        return Reading(node, sensor, sequence, session, status, count, range_m, spread_m, attempt)

    def _echo(self, node: int, sensor: int, raw: tuple[int, ...]) -> Message:
        sequence, session, time_us, attempt, accepted, amplitude = raw
        strength = math.nan if amplitude == self._amplitude_none else amplitude / self._amplitude_per_one
        return EchoDetail(node, sensor, sequence, session, time_us, attempt, accepted, strength)

    def _kit_pulse(self, node: int, _: int, raw: tuple[int, ...]) -> Message:
        scales = self._layouts[Function.KIT_PULSE].scales
        sequence, sensor, frequency, cycles, blanking_us, gain = raw
        return KitPulse(node, sequence, sensor, round(frequency * scales[2]), cycles, blanking_us, gain * scales[5])


def _acknowledge(node: int, _: int, raw: tuple[int, ...]) -> Message | Rejection:
    sequence, session, subject, result, attempt, sensors = raw
    try:
        return Acknowledge(node, sequence, session, Subject(subject), Result(result), attempt, sensors)
    except ValueError:
        return Rejection.UNKNOWN_WORD


def _fault(node: int, _: int, raw: tuple[int, ...]) -> Message | Rejection:
    sequence, session, code, sensor, detail = raw
    try:
        return FaultReport(node, sequence, session, FaultCode(code), sensor, detail)
    except ValueError:
        return Rejection.UNKNOWN_WORD


def _kit_sampling(node: int, _: int, raw: tuple[int, ...]) -> Message | Rejection:
    sequence, sensor, source, rate, pings = raw
    try:
        return KitSampling(node, sequence, sensor, TriggerSource(source), rate, pings)
    except ValueError:
        return Rejection.UNKNOWN_WORD


def _heartbeat(node: int, _: int, raw: tuple[int, ...]) -> Message | Rejection:
    inner, state, *rest = raw
    try:
        return Heartbeat(node, NodeState(state), *rest) if inner == node else Rejection.UNKNOWN_WORD
    except ValueError:
        return Rejection.UNKNOWN_WORD
