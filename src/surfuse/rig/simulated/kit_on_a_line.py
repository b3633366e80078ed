"""The twin's ranging kit at the other end of a serial line: it takes the protocol's lines and fires in the twin."""

from __future__ import annotations

import contextlib
import os
import select
import threading
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Self

import numpy as np

from surfuse.errors import ConfigError
from surfuse.interfaces import Clock
from surfuse.node.messages import MAX_PINGS, KitMessage
from surfuse.records import FloatArray, SensorSpec
from surfuse.rig.description import PING_PERIOD_S
from surfuse.rig.simulated.kit_by_message import kit_as_message, kit_from_message
from surfuse.serial_line.kit_words import EARLY, NOTHING, PROTOCOL, as_fields, changed_by, framed, unframed
from surfuse.twin.world import Twin

_LONGEST_BYTES = 200
_POLL_S = 0.05
_NAME = "surfuse-twin"


class KitOnALine:
    """The kit of one sensor of the twin.

    It tells times of flight as its own clock counted them, from which its fixed delay is already taken.

    Parameters
    ----------
    world : the twin; parameters that are set on the kit act there.
    spec : the sensor that the kit drives.
    pose : returns where the sensor is: `world_from_sensor` (4, 4).
    clock : simulated time, which goes on with every ping.
    """

    def __init__(self, world: Twin, spec: SensorSpec, pose: Callable[[], FloatArray], clock: Clock) -> None:
        self._world, self._spec, self._pose, self._clock = world, spec, pose, clock
        self._sets = 0
        self._begun = bytearray()

    def hear(self, data: bytes) -> Iterator[bytes]:
        """Bytes from the line, in any portions; the lines that answer them."""
        self._begun += data
        while (end := self._begun.find(b"\n")) >= 0:
            line = bytes(self._begun[:end]).decode("ascii", "replace").strip()
            del self._begun[: end + 1]
            if line:
                yield from self._answer(line)
        if len(self._begun) > _LONGEST_BYTES:
            self._begun.clear()

    @property
    def _kit(self) -> KitMessage:
        return kit_as_message(self._world.kit(self._spec), 1)

    def _answer(self, line: str) -> Iterator[bytes]:
        heard = unframed(line)
        if heard is None:
            yield framed("ER", 0, "SUM")
            return
        word, number, fields = heard
        if word == "FIRE":
            yield from self._fire(number, fields)
        elif word == "SET":
            yield self._set(number, fields)
        elif word == "GET":
            yield framed("PAR", number, *as_fields(self._kit))
        elif word == "ID":
            yield framed("KIT", number, str(PROTOCOL), _NAME)
        else:
            yield framed("ER", number, "WORD")

    def _set(self, number: int, fields: tuple[str, ...]) -> bytes:
        wanted = changed_by(self._kit, fields)
        if isinstance(wanted, str):
            return framed("ER", number, wanted)
        try:
            self._world.set_kit(self._spec.name, kit_from_message(wanted, self._world.kit(self._spec)))
        except ConfigError:
            return framed("ER", number, "VALUE")
        self._sets += 1
        return framed("OK", number, str(self._sets))

    def _fire(self, number: int, fields: tuple[str, ...]) -> Iterator[bytes]:
        if len(fields) != 1 or not fields[0].isdecimal() or not 1 <= int(fields[0]) <= MAX_PINGS:
            yield framed("ER", number, "PINGS")
            return
        count = int(fields[0])
        ranges, amplitudes = self._world.ping(self._pose(), self._spec, count, self._clock.now_s())
        self._clock.advance(count * PING_PERIOD_S)
        for k in range(count):
            yield framed("PING", number, str(k + 1), str(count), *self._told(float(ranges[k]), float(amplitudes[k])))
        yield framed("DONE", number, str(count), str(self._sets))

    def _told(self, range_m: float, amplitude: float) -> tuple[str, str]:
        """Time of flight in microseconds, and amplitude."""
        if not np.isfinite(range_m):
            return (EARLY if range_m < 0.0 else NOTHING), ""
        time_us = 2e6 * range_m / self._world.assumed_speed_m_s
        return f"{max(time_us, 0.0):.3f}", f"{min(max(amplitude, 0.0), 999.0):.4f}"


class ServedKit:
    """A kit that answers on a file descriptor, from a thread of its own; `with` starts and ends it.

    The descriptor is that of a serial port, or the controlling end of a pseudo-terminal; whoever opened it closes it.
    """

    def __init__(self, kit: KitOnALine, descriptor: int) -> None:
        self._kit, self._descriptor = kit, descriptor
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="surfuse-kit", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()

    def _serve(self) -> None:
        # A line that is pulled out is the end of the kit.
        with contextlib.suppress(OSError):
            while not self._stop.is_set():
                ready, _, _ = select.select([self._descriptor], [], [], _POLL_S)
                for answer in self._kit.hear(os.read(self._descriptor, 256)) if ready else ():
                    os.write(self._descriptor, answer)
