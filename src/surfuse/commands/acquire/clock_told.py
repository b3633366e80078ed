"""How well the clocks of a rig belong together, as it is told: in the log, in the summary, on the terminal."""

from __future__ import annotations

from surfuse.rig.devices import Rig, Stamps
from surfuse.runs.log_records import Level, LogEvent
from surfuse.runs.log_writer import LogWriter

CLOCK = "clock"
"""Source of the events, and key of the summary."""


def log_clock(rig: Rig, log: LogWriter) -> None:
    """An event with what is known now; nothing for a rig of one clock."""
    if (stamps := rig.stamps()) is not None:
        log.append_event(LogEvent(rig.clock.now_s(), Level.INFO, CLOCK, stamps.in_words()))


def clock_data(stamps: Stamps | None) -> dict[str, object]:
    """For the summary."""
    if stamps is None:
        return {}
    clock = stamps.clock
    told = {
        "uncertainty_ms": 1e3 * clock.offset.uncertainty_s,
        "keeps_pace": clock.keeps_pace,
        "drift_ppm": 1e6 * clock.drift,
        "drift_uncertainty_ppm": 1e6 * clock.drift_uncertainty,
        "brought_to_it": list(stamps.others),
    }
    return {CLOCK: told}


def clock_rows(stamps: Stamps | None) -> list[tuple[str, str]]:
    """For the table at the end."""
    return [] if stamps is None else [(CLOCK, stamps.in_words())]
