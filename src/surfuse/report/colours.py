"""Colour maps of the page: perceptually uniform and safe for colour-blind readers, the same in Python and JavaScript.

Seventeen anchors each, sampled from viridis, magma and cividis (van der Walt and Smith 2015; Nunez, Anderton and
Renslow 2018, all CC0) and from ColorBrewer's RdBu (Harrower and Brewer 2003), linear in between.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from surfuse.records import ByteArray

ANCHORS: dict[str, str] = {
    "viridis": "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c "
    "1fa088 28ae80 3fbc73 5ec962 84d44b addc30 d8e219 fde725",
    "magma": "000004 0a0822 1d1147 36106b 51127c 6a1c81 832681 9c2e7f b73779 "
    "d0416f e75263 f56b5c fc8961 fea772 fec488 fde2a3 fcfdbf",
    "cividis": "00224e 002e6a 1a386f 32436d 434e6c 535a6d 61656f 6f7073 7d7c78 "
    "8c8878 9b9476 aba072 bcae6c cdbb63 dec958 f0d846 fee838",
    "diverging": "053061 175290 2a71b2 3f8ec0 6bacd1 9bc9e0 c2ddec e0ecf3 f7f6f6 "
    "fbe5d8 fbccb4 f5aa89 e48066 d05548 ba2832 930e26 67001f",
}

# Okabe and Ito (2008): eight colours that stay apart under the common colour-vision deficiencies.
CATEGORIES = ("0072b2", "e69f00", "009e73", "cc79a7", "56b4e9", "d55e00", "999999", "f0e442")


def anchors(name: str) -> list[list[int]]:
    """The anchors of a colour map as [red, green, blue] in 0..255."""
    return [[int(code[i : i + 2], 16) for i in (0, 2, 4)] for code in ANCHORS[name].split()]


def colourise(values: npt.ArrayLike, low: float, high: float, name: str = "viridis") -> ByteArray:
    """Colours (..., 3) uint8 of values, `low` to `high` over the whole map; nan becomes grey.

    `name` is that of a colour scale; values beyond `low` and `high` get the colours of its ends.
    """
    array = np.asarray(values, dtype=np.float64)
    span = high - low if high > low else 1.0
    share = np.clip((array - low) / span, 0.0, 1.0)
    table = np.array(anchors(name), dtype=np.float64)
    at = np.linspace(0.0, 1.0, len(table))
    known = np.where(np.isfinite(share), share, 0.0)
    colours = np.stack([np.interp(known, at, table[:, k]) for k in range(3)], axis=-1)
    colours[~np.isfinite(array)] = 150.0
    result: ByteArray = np.round(colours).astype(np.uint8)
    return result
