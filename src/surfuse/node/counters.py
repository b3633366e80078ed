"""What happened on the bus, counted: nothing that goes wrong there is silent."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import StrEnum


class BusEvent(StrEnum):
    """Things that are counted; the values are the fields of `BusCounters`."""

    FRAMES = "frames"
    FOREIGN = "foreign"
    WRONG_LENGTH = "wrong_length"
    UNKNOWN_WORD = "unknown_word"
    CONTRADICTORY = "contradictory"
    ERROR_FRAMES = "error_frames"
    TRIGGERS = "triggers"
    RETRIGGERS = "retriggers"
    FIRED_AGAIN = "fired_again"
    UNANSWERED = "unanswered"
    LOST = "lost"
    DUPLICATED = "duplicated"
    REORDERED = "reordered"
    LATE = "late"
    UNSOLICITED = "unsolicited"
    TOO_FAST = "too_fast"
    CONFLICTS = "conflicts"
    RESTARTS = "restarts"
    REFUSED = "refused"
    NODE_FAULTS = "node_faults"
    BUS_OFF = "bus_off"
    RECEIVE_ERRORS = "receive_errors"
    SEND_ERRORS = "send_errors"
    REOPENED = "reopened"
    OVERFLOWED = "overflowed"
    READINGS = "readings"
    FAILED = "failed"


@dataclass(frozen=True)
class BusCounters:
    """Counts since the connection was opened.

    frames : frames received, whatever they were.
    foreign, wrong_length, unknown_word, contradictory, error_frames : frames that were no message, by reason.
    triggers, retriggers : first and repeated triggers sent; a repeated one does not fire again.
    fired_again : sweeps begun anew because the first answers could not be trusted or did not come.
    unanswered : triggers to which not one frame came back.
    lost : frames that an answer lacked.
    duplicated, reordered : frames that came twice, or after one sent later.
    late : answers that came when their sweep was over.
    unsolicited : answers to nothing that was asked.
    too_fast : readings that came before their echo can have come back.
    conflicts : signs of two nodes with one id: other values for the same reading, or an old session again.
    restarts : a node began a new session.
    refused : sensors that the node does not have.
    node_faults : faults that the node reported.
    bus_off, receive_errors, send_errors, reopened : trouble of the adapter, and how often it was opened anew.
    overflowed : frames dropped because the host did not read them.
    readings, failed : readings returned, and those of them that are faults because no trustworthy answer came.
    """

    frames: int
    foreign: int
    wrong_length: int
    unknown_word: int
    contradictory: int
    error_frames: int
    triggers: int
    retriggers: int
    fired_again: int
    unanswered: int
    lost: int
    duplicated: int
    reordered: int
    late: int
    unsolicited: int
    too_fast: int
    conflicts: int
    restarts: int
    refused: int
    node_faults: int
    bus_off: int
    receive_errors: int
    send_errors: int
    reopened: int
    overflowed: int
    readings: int
    failed: int


class Tally:
    """The counting side; each event is counted by one thread only."""

    def __init__(self) -> None:
        self._counts: Counter[BusEvent] = Counter()

    def add(self, event: BusEvent, number: int = 1) -> None:
        """Count an event."""
        self._counts[event] += number

    def snapshot(self) -> BusCounters:
        """The counts so far."""
        return BusCounters(*(self._counts[event] for event in BusEvent))
