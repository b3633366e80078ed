"""A map of a surface as a caller holds it: its layers, why a cell has its value, and ways to give it away."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from surfuse.commands.explain.explanation import CellExplanation, explanation_at
from surfuse.commands.explain.map_source import MapSource, source_of
from surfuse.commands.maps.map_files import format_of
from surfuse.door.arguments import FilePath, finite_number, path_of
from surfuse.durable import ExistingFileError
from surfuse.errors import DataError, UsageError
from surfuse.exporters import nc
from surfuse.records import (
    BoolArray,
    ByteArray,
    Finding,
    FloatArray,
    FusedPoints,
    IntArray,
    Trust,
    trust_of,
)
from surfuse.records import (
    SurfaceMap as MapRecord,
)

if TYPE_CHECKING:
    import matplotlib.axes
    import xarray


@dataclass(frozen=True, eq=False)
class SurfaceMap:
    """The fused surface w over (u, v): layers (R, C), rows along v, columns along u; made by `fuse` and `open_map`.

    `record` is the plain record that the stages take. `points` are the fused values of the stops (None: the file keeps
    none). `findings` is what was noticed, `judged` whether the readings were looked at too (not for a map file alone).
    `source` is what the map was made from, when it was made here; `path` the file that it was read from.
    """

    record: MapRecord
    points: FusedPoints | None = None
    findings: tuple[Finding, ...] = ()
    judged: bool = False
    source: MapSource | None = None
    path: Path | None = None

    @property
    def u_m(self) -> FloatArray:
        """Nodes (C,) along the scan line, m, part frame."""
        return self.record.grid.u_m

    @property
    def v_m(self) -> FloatArray:
        """Nodes (R,) up from the foot of the part, m, part frame."""
        return self.record.grid.v_m

    @property
    def world_from_part(self) -> FloatArray:
        """Pose (4, 4) of the part frame in the frame of the readings."""
        return self.record.grid.world_from_part

    @property
    def height_m(self) -> FloatArray:
        """Heights (R, C) w out of the part, m; nan where the cell has no value."""
        return self.record.height_m

    @property
    def sigma_m(self) -> FloatArray:
        """Standard deviations (R, C) of the heights, m."""
        return self.record.sigma_m

    @property
    def confidence(self) -> FloatArray:
        """Degrees of confidence (R, C) of the cells, 0 to 1."""
        return self.record.confidence

    @property
    def count(self) -> IntArray:
        """Readings (R, C) that each cell rests on."""
        return self.record.count

    @property
    def mask(self) -> BoolArray:
        """Cells (R, C) that have a value."""
        return self.record.mask

    @property
    def regime(self) -> ByteArray:
        """What each value (R, C) rests on: codes of `surfuse.records.Regime`."""
        return self.record.regime

    @property
    def method(self) -> str:
        """The fusion method."""
        return self.record.method

    @property
    def trust(self) -> Trust | None:
        """What follows from the findings: "bad" with an alarm, "doubtful" with a warning, else "good".

        Today the findings are what the reader of the log and the fusion notice anyway; no check looks for sensors that
        are biased, stuck or late, so "good" says only that nothing was repaired or assumed. None: a map file alone,
        whose readings nobody looked at.
        """
        return trust_of(self.findings) if self.judged else None

    def why(self, u_mm: float, v_mm: float, log: FilePath | None = None) -> CellExplanation:
        """Why the cell nearest to (u, v), in mm of the part frame, has its value; the content of `surfuse why --json`.

        A map that was read from a file finds its readings as the command does: beside it, or in `log`.

        Raises
        ------
        UsageError : (u, v) is not on the map.
        DataError : the readings are not found, or are not those of the map.
        """
        u_m, v_m = 1e-3 * finite_number(u_mm, "u_mm"), 1e-3 * finite_number(v_mm, "v_mm")
        return explanation_at(self._source(log), u_m, v_m)

    def _source(self, log: FilePath | None) -> MapSource:
        if self.source is not None:
            return self.source
        if self.path is None:
            raise DataError(
                "this map knows neither its readings nor its file", cure="take one of sf.fuse or sf.open_map"
            )
        return source_of(self.path, None if log is None else path_of(log, "log"))

    def save(self, path: FilePath, overwrite: bool = False) -> Path:
        """Write the map with its fused points as NetCDF (`.nc`), to the last bit; `open_map` reads it back.

        Raises
        ------
        UsageError : another suffix.
        StorageError : the file exists and `overwrite` is false, or the disk refused.
        """
        file = path_of(path, "path")
        if file.suffix.lower() not in nc.SUFFIXES:
            raise UsageError(f"'{file.name}' is no {nc.SUFFIXES[0]} file", cure="use .export(path) for other formats")
        with _overwriting():
            nc.write(file, self.record, overwrite=overwrite, points=self.points)
        return file

    def export(self, path: FilePath, overwrite: bool = False) -> Path:
        """Write the map for other programs; the suffix chooses the format, as `surfuse export` does.

        Raises
        ------
        UsageError : no format has that suffix.
        ConfigError : the format needs a package that is not installed.
        StorageError : the file exists and `overwrite` is false, or the disk refused.
        """
        file = path_of(path, "path")
        with _overwriting():
            format_of(file).write(file, self.record, overwrite=overwrite)
        return file

    def to_xarray(self) -> xarray.Dataset:
        """The map as a labelled dataset: the variables, units and attributes of surface.nc; `mask` as truth values.

        Raises
        ------
        ConfigError : xarray is not installed.
        """
        from surfuse.door.dataset import dataset_of

        return dataset_of(self.record)

    def plot(self, axes: matplotlib.axes.Axes | None = None, layer: str = "height") -> matplotlib.axes.Axes:
        """Draw a layer in mm over u and v in mm: "height" or "sigma"; into `axes`, or into a new figure.

        Raises
        ------
        ConfigError : matplotlib is not installed.
        UsageError : another layer.
        """
        from surfuse.door.plot import draw

        return draw(self.record, layer, axes)

    def __repr__(self) -> str:
        rows, columns = self.record.grid.shape
        cells = int(self.mask.sum())
        return f"<SurfaceMap by '{self.method}': {rows} x {columns} nodes, {cells} with a value, trust {self.trust}>"


@contextmanager
def _overwriting() -> Iterator[None]:
    """A file that is there is replaced by an argument of the call, not by an option of a command."""
    try:
        yield
    except ExistingFileError as error:
        raise error.asked_by("overwrite=True") from error
