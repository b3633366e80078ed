"""What was noticed about readings or a map, and how far a map can be trusted."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Severity = Literal["note", "warning", "alarm"]
Trust = Literal["good", "doubtful", "bad"]


@dataclass(frozen=True)
class Finding:
    """One thing that was noticed: a `code` for programs, `what` in one sentence, `where` (sensor, stops, region)."""

    code: str
    severity: Severity
    what: str
    where: str = ""


def trust_of(findings: Iterable[Finding]) -> Trust:
    """What follows from the findings: bad with an alarm, doubtful with a warning, good with notes alone or nothing."""
    found = {finding.severity for finding in findings}
    if "alarm" in found:
        return "bad"
    return "doubtful" if "warning" in found else "good"
