"""Whether parts are brighter or darker than what is behind them."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from surfuse.errors import ConfigError, nearest
from surfuse.records import BoolArray, ByteArray

Polarity = Literal["auto", "bright", "dark"]
POLARITIES: tuple[Polarity, ...] = get_args(Polarity)


def named_polarity(name: str) -> Polarity:
    """The polarity of this name.

    Raises
    ------
    ConfigError : no such polarity.
    """
    for polarity in POLARITIES:
        if polarity == name:
            return polarity
    raise ConfigError(f"polarity = '{name}'", cure=nearest(name, POLARITIES))


def parts_are_bright(above: BoolArray, polarity: Polarity) -> bool:
    """Whether parts are the class `above` (H, W) the threshold: with `auto`, when most of the picture's rim is not."""
    if polarity != "auto":
        return polarity == "bright"
    rim = np.concatenate([above[0], above[-1], above[1:-1, 0], above[1:-1, -1]])
    return bool(rim.mean() <= 0.5)


def foreground(image: ByteArray, level: int, polarity: Polarity) -> BoolArray:
    """The class (H, W) of an image (H, W) that a threshold takes for parts."""
    above = np.asarray(image > level)
    return above if parts_are_bright(above, polarity) else ~above
