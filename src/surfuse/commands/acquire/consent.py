"""A yes before a real arm moves for the first time."""

from __future__ import annotations

import math

from surfuse.commands.acquire.job import Job
from surfuse.commands.outcome import Watcher, asked_by
from surfuse.errors import InterruptError, UsageError
from surfuse.records import ScanPlan
from surfuse.rig.devices import Viewpoints
from surfuse.settings import Settings

YES = ("y", "yes")
FIRST_MOVES_SHARE = 0.2
"""Share of the arm's speed on the way to the first stop."""


def refuse_unasked(settings: Settings, watcher: Watcher, yes: bool) -> None:
    """Refuse at once what nobody could agree to later.

    Raises
    ------
    UsageError : a real arm, nobody to ask, and no agreement on the command line.
    """
    moves = settings.arm.is_real and not settings.arm.is_played_back
    if moves and asked_by(watcher) is None and not yes:
        raise UsageError("a real arm would move, and no terminal is there to ask", cure="add --yes")


def agreed(job: Job, plan: ScanPlan, first: int) -> None:
    """Ask before a real arm moves, unless it was agreed to on the command line.

    Raises
    ------
    UsageError : nobody can be asked, and it was not agreed to.
    InterruptError : the answer was not yes; nothing has moved.
    """
    if _needs_no_yes(job) or first >= len(plan):
        return
    place = ", ".join(f"{x:.3f}" for x in plan.world_from_grip[first, :3, 3])
    _ask(job, f"The arm will move to ({place}) m and visit {len(plan) - first} stops.")


def agreed_to_look(job: Job) -> None:
    """The same before a real arm moves to look for the part; nothing is asked where it need not move.

    Raises
    ------
    UsageError, InterruptError : as `agreed`.
    """
    lookout = job.rig.lookout
    if _needs_no_yes(job) or lookout is None:
        return
    if isinstance(lookout, Viewpoints):
        if lookout.moves:
            _ask(job, f"The arm will move to {len(lookout.moves)} places to look for the part.")
        return
    lower, upper = (f"{math.degrees(angle):.0f}" for angle in lookout.turn_rad)
    _ask(job, f"Joint 1 of the arm will turn from {lower} to {upper} degrees to look for the part.")


def _needs_no_yes(job: Job) -> bool:
    return job.yes or job.rig.simulated or job.settings.arm.is_played_back


def _ask(job: Job, what: str) -> None:
    asker = asked_by(job.watcher)
    answer = None if asker is None else asker.ask(f"{what} surfuse has no safety function. Is the way free? [y/N]")
    if answer is None:
        raise UsageError("a real arm is about to move, and no terminal is there to ask", cure="add --yes")
    if answer.strip().lower() not in YES:
        raise InterruptError("not agreed to; the arm has not moved")
