"""How a bridge's clock and this machine's belong together, by every state that it tells; and a clock that lies."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from surfuse.bridge.messages import Question
from surfuse.errors import SafetyStopError

DRIFT_LIMIT = 2e-4
"""Share of the time by which two good clocks run apart at most; crystals stay within a quarter of it."""

JUMP_LIMIT_S = 0.5
"""A clock that kept pace with this machine's may leave it by so much, for states that are told late."""

PACE_LIMIT_S, PACE_S, PACE_TIMES = 0.05, 5.0, 3
"""A clock keeps pace that stayed so near for so long, over so many of each kind of question that was asked."""


@dataclass(frozen=True)
class ClockOffset:
    """How this machine's `time.monotonic` and the bridge's clock belong together, at most `uncertainty_s` off."""

    host_minus_bridge_s: float
    uncertainty_s: float


@dataclass(frozen=True)
class ClockFindings:
    """What is known of the bridge's clock: the offset now, whether it keeps pace with this machine's, and its drift.

    `keeps_pace` is false for a clock with a time of its own, as that of a simulation. `drift` is the share by which it
    runs faster than this machine's, at most `drift_uncertainty` off.
    """

    offset: ClockOffset
    keeps_pace: bool
    drift: float
    drift_uncertainty: float

    def in_words(self) -> str:
        """One sentence without its end."""
        text = f"this computer's and the bridge's agree to {1e3 * self.offset.uncertainty_s:.2g} ms"
        if not self.keeps_pace:
            return f"{text} and do not keep pace: its time is that of a simulation, or its states are told late"
        if self.drift_uncertainty > DRIFT_LIMIT:
            return text
        return f"{text}; drift {1e6 * self.drift:+.2g} ppm, at most {1e6 * self.drift_uncertainty:.2g} off"


@dataclass(frozen=True)
class _Bounds:
    """`host - bridge` lies between `low_s` and `high_s`, at the moment `at_s` of this machine's clock."""

    low_s: float
    high_s: float
    at_s: float

    @property
    def half_s(self) -> float:
        return 0.5 * (self.high_s - self.low_s)

    @property
    def middle_s(self) -> float:
        return 0.5 * (self.high_s + self.low_s)

    def grown(self, at_s: float) -> _Bounds:
        """The same later: the clocks may have run apart."""
        apart_s = DRIFT_LIMIT * max(at_s - self.at_s, 0.0)
        return _Bounds(self.low_s - apart_s, self.high_s + apart_s, at_s)


class ClockWatch:
    """Takes in when states were asked, answered and stamped.

    The stamp lies between question and answer, which bounds the offset; bounds that overlap narrow each other, those
    that do not are widened to hold both. A clock that kept pace with this machine's and leaves it lies. One that never
    kept pace has a time of its own, which is no fault.
    """

    def __init__(self, where: str) -> None:
        self._where = where
        self._pace = True
        self.new_connection()

    def new_connection(self) -> None:
        """A bridge that was started again may count its time anew."""
        self._known: _Bounds | None = None
        self._first: _Bounds | None = None
        self._asked: Counter[Question] = Counter()
        self._since: set[Question] = set()

    def asked(self, question: Question) -> None:
        """A question was answered; what happened in it may have made the clock of a simulation jump."""
        self._since.add(question)

    def take(self, sent_s: float, received_s: float, stamp_s: float) -> None:
        """A state: when it was asked and answered by this machine's clock, and its stamp by the bridge's.

        Raises
        ------
        SafetyStopError : a clock that kept pace has left this machine's; with value and limit.
        """
        new = _Bounds(sent_s - stamp_s, received_s - stamp_s, received_s)
        since, self._since = self._since, set()
        if self._known is None:
            self._known = self._first = new
            return
        known = self._known.grown(received_s)
        low_s, high_s = max(known.low_s, new.low_s), min(known.high_s, new.high_s)
        if low_s > high_s:
            self._check_pace(known, new, since)
            low_s, high_s = min(known.low_s, new.low_s), max(known.high_s, new.high_s)
        self._known = _Bounds(low_s, high_s, received_s)
        for question in since:
            self._asked[question] += 1
        self._narrow_first()

    def findings(self, now_s: float) -> ClockFindings:
        """What is known at a moment of this machine's clock; before the first state nothing."""
        if self._known is None or self._first is None:
            return ClockFindings(ClockOffset(0.0, math.inf), self._pace, 0.0, math.inf)
        known = self._known.grown(now_s)
        offset = ClockOffset(known.middle_s, known.half_s)
        span_s = self._known.at_s - self._first.at_s
        if span_s <= 0.0:
            return ClockFindings(offset, self._pace, 0.0, math.inf)
        drift = -(self._known.middle_s - self._first.middle_s) / span_s
        return ClockFindings(offset, self._pace, drift, (self._known.half_s + self._first.half_s) / span_s)

    def _narrow_first(self) -> None:
        """Where the drift is counted from: the best of the first seconds."""
        assert self._first is not None
        assert self._known is not None
        if self._known.half_s < self._first.half_s and self._known.at_s - self._first.at_s < 1.0:
            self._first = self._known

    def _check_pace(self, known: _Bounds, new: _Bounds, since: set[Question]) -> None:
        """Bounds that exclude each other: by how much, and whether this clock is one that may not do that."""
        forward = new.high_s < known.low_s
        widest_s = known.high_s - new.high_s if forward else new.low_s - known.low_s
        if widest_s <= PACE_LIMIT_S or not self._pace:
            return
        proven = self._is_proven(known, since)
        if proven and widest_s <= JUMP_LIMIT_S:
            return
        self._pace = proven
        if proven:
            word = "forward" if forward else "back"
            raise SafetyStopError(
                f"the clock of the bridge, which kept pace with this computer's, has gone {word} by {widest_s:.3f} s "
                f"against it, at most {JUMP_LIMIT_S:g} s",
                where=self._where,
                cure="use a clock that only goes forward and is not set (time.monotonic)",
            )

    def _is_proven(self, known: _Bounds, since: set[Question]) -> bool:
        """Whether the clock kept pace long enough, over all that was asked since the last state."""
        assert self._first is not None
        return known.at_s - self._first.at_s >= PACE_S and all(self._asked[kind] >= PACE_TIMES for kind in since)
