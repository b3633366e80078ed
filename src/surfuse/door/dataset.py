"""A map as an xarray dataset."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from surfuse.extras import needed_by
from surfuse.map_files.native import write_native
from surfuse.records import SurfaceMap

if TYPE_CHECKING:
    import xarray


def dataset_of(surface: SurfaceMap) -> xarray.Dataset:
    """What xarray reads of the native file of the map, in memory: names and attributes cannot drift apart.

    Raises
    ------
    ConfigError : xarray is not installed.
    """
    with needed_by("to_xarray()"):
        import xarray
    memory = io.BytesIO()
    write_native(memory, surface, points=None)
    dataset = xarray.load_dataset(memory, engine="h5netcdf")
    has_value = dataset["mask"].astype(bool)
    has_value.attrs = {"long_name": dataset["mask"].attrs["long_name"]}
    return dataset.assign(mask=has_value)
