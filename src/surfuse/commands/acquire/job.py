"""What an acquisition works with, from its first step to its last."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from surfuse.commands.outcome import Watcher
from surfuse.interfaces import FusionMethod
from surfuse.rig.devices import Rig
from surfuse.settings import Settings


@dataclass(frozen=True)
class Job:
    """The configuration, the rig that it describes, the fusion method, and who is told about progress.

    `ask` puts a question to the user (None: nobody can be asked); `yes` agrees to the first move of a real arm.
    """

    settings: Settings
    rig: Rig
    method: FusionMethod
    watcher: Watcher
    ask: Callable[[str], str] | None = None
    yes: bool = False
