"""Links that are no wire: a node answered without threads, and a bus that is bad on purpose.

Both let a host be tried against millions of frames, or a user's own firmware against a bad day.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np

from surfuse.errors import ConfigError
from surfuse.interfaces import Clock
from surfuse.node.link import Arrival, Link
from surfuse.node.messages import CanFrame
from surfuse.node.responder import Responder


class DirectLink:
    """A node in the calling thread: what is sent is answered at once; waiting passes in no time.

    Parameters
    ----------
    responder : the node.
    clock : stamps the arrivals.
    """

    def __init__(self, responder: Responder, clock: Clock) -> None:
        self._responder, self._clock = responder, clock
        self._arrivals: deque[Arrival] = deque()
        self._waited_s = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def monotonic_s(self) -> float:
        """Time that has passed by waiting; give it to the host as its measure."""
        return self._waited_s

    def send(self, frame: CanFrame) -> bool:
        """Have the node answer a frame."""
        for answer in self._responder.answer(frame):
            self._arrivals.append(Arrival(answer, self._clock.now_s()))
        return True

    def receive(self, timeout_s: float) -> Arrival | None:
        """The next answer; without one the whole time-out has passed."""
        if self._arrivals:
            return self._arrivals.popleft()
        self._waited_s += timeout_s
        return None


@dataclass(frozen=True)
class BadBus:
    """What a bad bus does to a frame, each with a probability from 0 to 1.

    loss : it is gone.
    duplication : it comes twice.
    reordering : it is held back until up to `hold_frames` others have passed.
    """

    loss: float = 0.2
    duplication: float = 0.2
    reordering: float = 0.2
    hold_frames: int = 12

    def __post_init__(self) -> None:
        for name, value in (("loss", self.loss), ("duplication", self.duplication), ("reordering", self.reordering)):
            if not 0.0 <= value <= 1.0:
                raise ConfigError(f"{name} = {value}", cure="give a probability, 0 to 1")
        if self.hold_frames < 1:
            raise ConfigError(f"hold_frames = {self.hold_frames}", cure="give at least 1")


@dataclass
class Injected:
    """How many frames were lost on the way out and in, doubled, and held back.

    As seen from the host: `out` is towards the node.
    """

    lost_out: int = 0
    lost_in: int = 0
    duplicated_in: int = 0
    held_in: int = 0


class BadLink:
    """A link through a bad bus; lost, doubled and reordered in both directions.

    Parameters
    ----------
    inner : the good link.
    bad : what happens to frames.
    generator : the chance.
    """

    def __init__(self, inner: Link, bad: BadBus, generator: np.random.Generator) -> None:
        self._inner, self._bad, self._generator = inner, bad, generator
        self._ready: deque[Arrival] = deque()
        self._held: list[tuple[int, Arrival]] = []
        self._held_out: CanFrame | None = None
        self.injected = Injected()

    def __enter__(self) -> Self:
        self._inner.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._inner.__exit__(kind, error, trace)

    def send(self, frame: CanFrame) -> bool:
        """Send, lose, double, or keep back until the next one."""
        lost, doubled, held = self._generator.random(3)
        earlier, self._held_out = self._held_out, None
        if lost < self._bad.loss:
            self.injected.lost_out += 1
        elif held < self._bad.reordering:
            self._held_out = frame
        else:
            self._inner.send(frame)
            if doubled < self._bad.duplication:
                self._inner.send(frame)
        if earlier is not None:
            self._inner.send(earlier)
        return True

    def receive(self, timeout_s: float) -> Arrival | None:
        """The next frame that the bad bus lets through."""
        while not self._ready:
            arrival = self._inner.receive(timeout_s)
            if arrival is None and not self._held:
                return None
            if arrival is None:
                self._ready.extend(held for _, held in self._held)
                self._held.clear()
            else:
                self._pass_on(arrival)
        return self._ready.popleft()

    def _pass_on(self, arrival: Arrival) -> None:
        due = [held for passes, held in self._held if passes <= 1]
        self._held = [(passes - 1, held) for passes, held in self._held if passes > 1]
        lost, doubled, held = self._generator.random(3)
        if lost < self._bad.loss:
            self.injected.lost_in += 1
        elif held < self._bad.reordering:
            self.injected.held_in += 1
            self._held.append((1 + int(self._generator.integers(self._bad.hold_frames)), arrival))
        else:
            self._ready.append(arrival)
            if doubled < self._bad.duplication:
                self.injected.duplicated_in += 1
                self._ready.append(arrival)
        self._ready.extend(due)
