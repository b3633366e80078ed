"""Maps from readings, from files, and against truth."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from pathlib import Path

from surfuse.commands.explain.map_source import MapSource
from surfuse.commands.fuse.map_of_log import fused, grid_of, require_cells
from surfuse.commands.fuse.methods import create_method, method_lines
from surfuse.commands.judge.evaluation import MapScore, have_common_cells, map_score
from surfuse.commands.judge.findings import findings_of
from surfuse.commands.judge.truth_files import dense_truth, read_truth
from surfuse.commands.maps.map_files import map_path, read_map
from surfuse.door.arguments import FilePath, finite_number, path_of, plain_values, shown
from surfuse.door.logs import Log
from surfuse.door.surface_map import SurfaceMap
from surfuse.errors import DataError, UsageError
from surfuse.exporters import nc
from surfuse.interfaces import FusionMethod
from surfuse.runs.folder import RunFolder
from surfuse.runs.scan_log import require_echoes
from surfuse.settings import FusionSettings, from_tree
from surfuse.surface.dense_score import dense_truth_of_map

_ELSEWHERE = "map and truth have no cell in common"


def methods() -> dict[str, str]:
    """Names of the fusion methods, each with what it does in one line; plug-ins that cannot be used are warned of."""
    return dict(method_lines(lambda text: warnings.warn(text, stacklevel=2)))


def fuse(
    log: Log, method: str | FusionMethod = "beam", parameters: Mapping[str, str | int | float | bool] | None = None
) -> SurfaceMap:
    """Fuse a log into a map; the map that `surfuse fuse` makes of the same readings, to the last bit.

    `method` is a name (see `methods`) with `parameters` as in `fusion.parameters.<method>`, or a method of one's own
    (`surfuse.interfaces.FusionMethod`), which has its parameters already.

    Raises
    ------
    UsageError : something else than a log or a method.
    ConfigError : no such method; a parameter that the method does not have, or out of its limits.
    DataError : no reading is an echo, or no cell of the map gets a value.
    """
    if not isinstance(log, Log):
        raise UsageError(f"log = {shown(log)} is no log", cure="give what sf.read or sf.log returned")
    scan = log.scan
    settings = _fusion_settings(method, parameters)
    chosen = create_method(settings) if isinstance(method, str) else method
    require_echoes(scan.readings, log.name)
    result, record = fused(scan, chosen, grid_of(scan))
    require_cells(record, log.name)
    source = MapSource(record, result.points, scan.readings, log.path, scan.scene(), settings)
    return SurfaceMap(record, result.points, findings_of(scan.warnings, record), judged=True, source=source)


def _fusion_settings(
    method: str | FusionMethod, parameters: Mapping[str, str | int | float | bool] | None
) -> FusionSettings:
    values = plain_values(parameters, "parameters")
    if isinstance(method, str):
        return from_tree({"fusion": {"method": method, "parameters": {method: values}}}, "sf.fuse").fusion
    if not isinstance(method, FusionMethod):
        raise UsageError(f"method = {shown(method)} is no fusion method", cure="give a name of sf.methods()")
    if values:
        raise UsageError("parameters beside a method of one's own", cure="give them to that method when it is made")
    return FusionSettings()


def open_map(path: FilePath) -> SurfaceMap:
    """Open a map file of any format that can be read, or the map of a run folder.

    Raises
    ------
    UsageError, ConfigError, DataError, StorageError : not there, not a map, or its format cannot be read.
    """
    file = map_path(path_of(path, "path"))
    record = read_map(file)
    points = nc.read_points(file) if file.suffix.lower() in nc.SUFFIXES else None
    warnings = _warnings_beside(file)
    findings = findings_of(warnings or (), record)
    return SurfaceMap(record, points, findings, judged=warnings is not None, path=file)


def _warnings_beside(file: Path) -> tuple[str, ...] | None:
    """What the log of the run warned of, by its summary; None when no summary says so."""
    summary = RunFolder(file.parent).summary
    if file.name != RunFolder(file.parent).surface.name or not summary.is_file():
        return None
    try:
        warnings = json.loads(summary.read_text("utf-8")).get("warnings")
    except (OSError, ValueError, AttributeError):
        # The map itself is whole; what its run thought of it cannot be known any more.
        return None
    return tuple(str(text) for text in warnings) if isinstance(warnings, list) else None


def evaluate(surface: SurfaceMap | FilePath, truth: SurfaceMap | FilePath, scale: float = 1.0) -> MapScore:
    """Error of a map against truth: a mesh in the frame of the readings, or another map.

    `surface` and `truth` are maps, map files or run folders; `scale` is a factor on the numbers of a mesh file (0.001
    for millimetres).

    Raises
    ------
    UsageError : no path, or a scale that is not above 0.
    DataError : map and truth have no cell in common, or a file cannot be used.
    """
    record = surface.record if isinstance(surface, SurfaceMap) else read_map(path_of(surface, "surface"))
    if isinstance(truth, SurfaceMap):
        found = map_score(record, truth.record, dense_truth_of_map(truth.record, record.grid))
        if found.cells == 0:
            raise DataError(_ELSEWHERE, cure="give truth in the frame of the readings")
        return found
    file, factor = path_of(truth, "truth"), finite_number(scale, "scale")
    if not factor > 0.0:
        raise UsageError(f"scale = {factor:g}", cure="give a factor > 0, 0.001 for millimetres")
    true = read_truth(file, record.grid, factor)
    if not have_common_cells(record, true):
        raise DataError(
            _ELSEWHERE,
            where=str(file),
            cure="give truth in the frame of the readings; scale=0.001 if its numbers are millimetres",
        )
    return map_score(record, true, dense_truth(file, record.grid, factor))
