"""Which node is on the line: a restart and a second node with one id look alike until the first one speaks again."""

from __future__ import annotations

from collections import deque
from enum import Enum

from surfuse.node.messages import Heartbeat

_REMEMBERED = 16


class LineVerdict(Enum):
    """What a session number says."""

    SAME = "the node that we know"
    RESTARTED = "the node began anew"
    RIVAL = "two nodes have this id"


class NodeWatch:
    """Sessions and boards that were heard under one node id."""

    def __init__(self) -> None:
        self.session: int | None = None
        self.boards: set[int] = set()
        self.last_heartbeat: Heartbeat | None = None
        self._superseded: deque[int] = deque(maxlen=_REMEMBERED)

    def see(self, session: int) -> LineVerdict:
        """Judge the session of a message: one that was replaced and is back again belongs to another node."""
        if self.session is None or session == self.session:
            self.session = session
            return LineVerdict.SAME
        if session in self._superseded:
            return LineVerdict.RIVAL
        self._superseded.append(self.session)
        self.session = session
        return LineVerdict.RESTARTED

    def hear(self, heartbeat: Heartbeat) -> LineVerdict:
        """Judge a heartbeat: another board under the same id is a rival whatever its session says."""
        self.last_heartbeat = heartbeat
        self.boards.add(heartbeat.uid)
        verdict = self.see(heartbeat.session)
        return LineVerdict.RIVAL if len(self.boards) > 1 else verdict
