"""A map as a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

from surfuse.door.arguments import shown
from surfuse.errors import UsageError, nearest
from surfuse.extras import needed_by
from surfuse.records import SurfaceMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_TITLES = {"height": "height w (mm)", "sigma": "standard deviation (mm)"}


def draw(surface: SurfaceMap, layer: str, axes: Axes | None) -> Axes:
    """The layer "height" or "sigma" of a map (R, C) in colours over its nodes, all in mm; cells without value white.

    Raises
    ------
    ConfigError : matplotlib is not installed.
    UsageError : another layer.
    """
    if not isinstance(layer, str) or layer not in _TITLES:
        raise UsageError(f"layer = {shown(layer)}", cure=nearest(str(layer), _TITLES))
    with needed_by("plot()"):
        import matplotlib.pyplot as plt
    if axes is None:
        _, axes = plt.subplots()
    values = surface.height_m if layer == "height" else surface.sigma_m
    grid = surface.grid
    colours = axes.pcolormesh(1e3 * grid.u_m, 1e3 * grid.v_m, 1e3 * values, shading="nearest")
    axes.set(xlabel="u (mm)", ylabel="v (mm)", title=f"{surface.method}: {_TITLES[layer]}", aspect="equal")
    axes.figure.colorbar(colours, ax=axes, label=_TITLES[layer])
    return axes
