"""What an acquisition works with, from its first step to its last."""

from __future__ import annotations

from dataclasses import dataclass

from surfuse.commands.outcome import Watcher
from surfuse.interfaces import FusionMethod
from surfuse.rig.devices import Rig
from surfuse.settings import Settings


@dataclass(frozen=True)
class Job:
    """The configuration, the rig that it describes, the fusion method, and who is told about progress."""

    settings: Settings
    rig: Rig
    method: FusionMethod
    watcher: Watcher
