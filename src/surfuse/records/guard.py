"""What a method decided about a region of its map, after readings that it had not been shown."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class GuardReason(IntEnum):
    """Why a region has the surface that it has."""

    BEST = 0
    BEATEN = 1
    FREE_SPACE = 2
    TOO_FEW = 3


@dataclass(frozen=True)
class RegionDecision:
    """One region of a map: which candidate surface was taken, and on what evidence.

    The box `low_uv_m` to `high_uv_m` (u, v in the part frame) bounds the `cells` of the region. `held_out` readings
    were kept from the estimate; `miss_m` says for each of the `candidates` how far on average (m, each miss at most
    20 mm) its predicted echoes were from them (nan: none), `above_free_space` which share of its cells (0 to 1) stands
    where the readings heard nothing. `chosen` is one of the candidates. `reason`: BEST, no other predicts clearly
    better; BEATEN, the first candidate was replaced; FREE_SPACE, a better predictor was refused because it stands in
    free space; TOO_FEW, not enough held-out readings to judge.
    """

    low_uv_m: tuple[float, float]
    high_uv_m: tuple[float, float]
    cells: int
    held_out: int
    candidates: tuple[str, ...]
    chosen: str
    reason: GuardReason
    miss_m: tuple[float, ...]
    above_free_space: tuple[float, ...]


def in_words(decisions: tuple[RegionDecision, ...]) -> str:
    """The decisions in one line: how many regions each surface won, and how many could not be judged."""
    won: dict[str, int] = {}
    for one in decisions:
        won[one.chosen] = won.get(one.chosen, 0) + 1
    blind = sum(one.reason is GuardReason.TOO_FEW for one in decisions)
    text = ", ".join(f"{name} in {count}" for name, count in won.items())
    regions = "1 region" if len(decisions) == 1 else f"{len(decisions)} regions"
    return f"of {regions} {text}" + (f"; {blind} not judged: too few readings" if blind else "")
