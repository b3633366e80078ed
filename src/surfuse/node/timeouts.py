"""How long the host waits for a node, and how often it asks."""

from __future__ import annotations

from dataclasses import dataclass

from surfuse.errors import ConfigError


@dataclass(frozen=True)
class NodeTimeouts:
    """How long the host waits and how often it asks.

    answer_timeout_s : wait for the next frame of an answer before asking again; doubles until the node says that it
        is done.
    silence_limit_s : a sweep is given up when the node has said nothing about it for so long.
    adapter_limit_s : how long an adapter may take no frames at all, over all sweeps; it is opened anew meanwhile.
    rounds : how often a sweep is fired at all, when its answers cannot be trusted or completed.
    reorder_grace_s : wait for frames that a reordering bus still holds after the node has said that it is done.
    connect_timeout_s : wait for the first heartbeat.
    roll_call_s : wait for a second node with the same id after the first heartbeat.
    lost_sweeps_limit : sweeps in a row without one trustworthy answer after which the node counts as lost.
    """

    answer_timeout_s: float = 0.5
    silence_limit_s: float = 5.0
    adapter_limit_s: float = 5.0
    rounds: int = 3
    reorder_grace_s: float = 0.005
    connect_timeout_s: float = 5.0
    roll_call_s: float = 0.05
    lost_sweeps_limit: int = 3

    def __post_init__(self) -> None:
        positive = (
            ("answer_timeout_s", self.answer_timeout_s),
            ("silence_limit_s", self.silence_limit_s),
            ("adapter_limit_s", self.adapter_limit_s),
            ("connect_timeout_s", self.connect_timeout_s),
        )
        for name, value in positive:
            if not 0.0 < value <= 3600.0:
                raise ConfigError(f"{name} = {value}", cure="give more than 0 and at most 3600 s")
        for name, value in (("reorder_grace_s", self.reorder_grace_s), ("roll_call_s", self.roll_call_s)):
            if not 0.0 <= value <= 60.0:
                raise ConfigError(f"{name} = {value}", cure="give 0 to 60 s")
        if self.rounds < 1 or self.lost_sweeps_limit < 1:
            what = f"rounds = {self.rounds}, lost_sweeps_limit = {self.lost_sweeps_limit}"
            raise ConfigError(what, cure="give at least 1")
