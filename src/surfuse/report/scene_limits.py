"""How much a 3-D scene may hold."""

from __future__ import annotations

from dataclasses import dataclass

from surfuse.errors import ConfigError


@dataclass(frozen=True)
class SceneLimits:
    """How much the scene may hold: nodes a surface, surfaces, and moments of the replay.

    `nodes_max` of a surface beyond which it is thinned out, `surfaces_max` shown at once, `frames_max` moments of the
    replay.
    """

    nodes_max: int = 2500
    surfaces_max: int = 5
    frames_max: int = 240

    def __post_init__(self) -> None:
        for name, least in (("nodes_max", 4), ("surfaces_max", 0), ("frames_max", 1)):
            if getattr(self, name) < least:
                raise ConfigError(f"{name} = {getattr(self, name)}", cure=f"give at least {least}")
