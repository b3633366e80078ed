"""What a log holds besides sweeps: events, and what is known before the first reading."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from surfuse.records import CameraFrame, FusionScene, Readings, ScanPlan, Sweep, readings_from_sweeps

FORMAT_VERSION = 1
"""Version of the log format; a reader refuses logs with a higher one."""


class Level(IntEnum):
    """Severity of an event; the numbers are those of rcl_interfaces/msg/Log."""

    INFO = 20
    WARN = 30
    ERROR = 40


@dataclass(frozen=True)
class LogEvent:
    """Something that happened: time in s, severity, the stage that says it, and one line of text.

    `t_s` is the time of the run's clock; `level` says how severe it is.
    """

    t_s: float
    level: Level
    source: str
    text: str


class Damage(IntEnum):
    """What a reader had to do without; `UNFINISHED` alone means that nothing is known to be lost."""

    UNFINISHED = 0
    CUT_OFF = 1
    CORRUPT = 2
    MISSING = 3


@dataclass(frozen=True)
class LogDamage:
    """One place where a log is not as it was written: segment, byte offset, kind and a sentence."""

    segment: str
    offset: int
    kind: Damage
    text: str


@dataclass(frozen=True)
class RunLog:
    """All that a surfuse log holds, in the order of the stops; one sweep a stop, the last complete one.

    `damage` tells what was cut off or corrupt; a stop that is missing in `sweeps` for that reason is named there.

    `scene` and `plan` are None where the log ends before them; `frames` are the camera's.
    """

    scene: FusionScene | None
    plan: ScanPlan | None
    frames: tuple[CameraFrame, ...]
    events: tuple[LogEvent, ...]
    sweeps: tuple[Sweep, ...]
    damage: tuple[LogDamage, ...]

    def readings(self) -> Readings:
        """The sweeps as columns; without a scene the log has no sensors and no sweeps either."""
        return readings_from_sweeps(self.scene.specs if self.scene else (), list(self.sweeps))
