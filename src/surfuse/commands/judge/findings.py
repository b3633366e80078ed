"""What the reader of the log and the fusion noticed, as findings.

Only what was looked at anyway is told here: nothing tests whether a sensor is biased, stuck or drifting.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from surfuse.records import Finding, Regime, SurfaceMap, in_words


def findings_of(warnings: Iterable[str], surface: SurfaceMap) -> tuple[Finding, ...]:
    """Findings of a map: what its log warned of (`warnings`, sentences), then what its method says of the map.

    Codes: `log` (something was repaired, assumed or left out), `not_measured` (cells that no reading holds), `guard`
    (what held-out readings decided).
    """
    found = [Finding("log", "warning", warning) for warning in warnings]
    prior = int(np.count_nonzero(surface.mask & (surface.regime == int(Regime.PRIOR))))
    if prior:
        cells = int(np.count_nonzero(surface.mask))
        what = f"{prior} of {cells} cells with a value only continue their surroundings: no reading holds them"
        found.append(Finding("not_measured", "note", what))
    if surface.decisions:
        found.append(Finding("guard", "note", in_words(surface.decisions)))
    return tuple(found)
