"""What an acquisition works with, from its first step to its last."""

from __future__ import annotations

from dataclasses import dataclass

from surfuse.commands.outcome import Watcher
from surfuse.commands.show.observer import UNOBSERVED, ScanObserver
from surfuse.interfaces import FusionMethod
from surfuse.rig.devices import Rig
from surfuse.settings import Settings


@dataclass(frozen=True)
class Job:
    """The configuration, the rig that it describes, the fusion method, who is told about progress, and who looks on.

    The user has agreed to the first move of a real arm with `yes`; else the watcher is asked.
    """

    settings: Settings
    rig: Rig
    method: FusionMethod
    watcher: Watcher
    observer: ScanObserver = UNOBSERVED
    yes: bool = False
