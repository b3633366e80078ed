"""`run.toml`: the whole configuration of a run, with seed and versions, so that it can be repeated."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import tomlkit
from tomlkit.items import Table as TomlTable

from surfuse import __version__, durable
from surfuse.errors import ConfigError
from surfuse.runs.toml_file import MAX_DEPTH, read_toml

Value = str | int | float | bool
Nested = Mapping[str, "Value | list[Value] | Nested | Sequence[Nested] | None"]

FORMAT_VERSION = 1
RUN_TABLE = "run"
_RECORDED = ("numpy", "scipy", "numba", "embreex", "opencv-python-headless", "mcap", "h5netcdf")


def configuration_text(values: Nested, seed: int) -> str:
    """TOML of a configuration: a table `run` with format, versions and seed first; None values are left out.

    Raises
    ------
    ConfigError : `values` has a table `run`, or nests too deep.
    """
    if RUN_TABLE in values:
        raise ConfigError(f"the table '{RUN_TABLE}' is written by surfuse itself", cure="rename the table")
    document = tomlkit.document()
    document.add(tomlkit.comment("the configuration of this run; 'surfuse acquire --cell run.toml' repeats it"))
    # A value that is no table stands before the first table, or it would belong to that one.
    for key, value in values.items():
        if value is not None and not _has_tables(value):
            document[key] = value
    run = tomlkit.table()
    run["format_version"] = FORMAT_VERSION
    run["seed"] = seed
    run["surfuse"] = __version__
    run["python"] = platform.python_version()
    packages = tomlkit.table()
    for name in _RECORDED:
        try:
            packages[name] = version(name)
        except PackageNotFoundError:
            packages[name] = "not installed"
    run["packages"] = packages
    document[RUN_TABLE] = run
    for key, value in values.items():
        if value is not None and _has_tables(value):
            document[key] = _item(value, 1)
    return tomlkit.dumps(document)


def _has_tables(value: object) -> bool:
    """Whether a value is a table, or a list of tables."""
    return isinstance(value, Mapping) or (
        isinstance(value, list | tuple) and any(isinstance(one, Mapping) for one in value)
    )


def _item(value: object, depth: int) -> object:
    """A value, a table, or a list of tables, as the writer takes it."""
    if isinstance(value, Mapping):
        return _table(value, depth)
    if isinstance(value, list | tuple) and _has_tables(value):
        tables = tomlkit.aot()
        for one in value:
            tables.append(_table(one, depth))
        return tables
    return value


def _table(values: Nested, depth: int) -> TomlTable:
    if depth > MAX_DEPTH:
        raise ConfigError(f"the configuration is nested deeper than {MAX_DEPTH}", cure="give plain tables")
    table = tomlkit.table()
    for key, value in values.items():
        if value is not None:
            table[key] = _item(value, depth + 1)
    return table


def write_configuration(path: Path, values: Nested, seed: int) -> None:
    """Write `run.toml`, atomically and durably.

    Raises
    ------
    StorageError : the disk refused.
    """
    durable.write_text(path, configuration_text(values, seed), overwrite=True)


def read_configuration(path: Path) -> tuple[dict[str, object], int]:
    """The tables of a `run.toml` without `run`, and the seed.

    Raises
    ------
    ConfigError : not TOML, too big, too deep, numbers that are not finite, no seed, or written by a newer surfuse.
    StorageError : the file cannot be read.
    """
    tables = read_toml(path)
    run = tables.pop(RUN_TABLE, None)
    if not isinstance(run, dict) or not isinstance(run.get("seed"), int):
        raise ConfigError("no table 'run' with a seed", where=str(path), cure="give the run.toml of a run folder")
    found = run.get("format_version")
    if not isinstance(found, int) or found > FORMAT_VERSION:
        raise ConfigError(
            f"format version {found!r} (surfuse {run.get('surfuse')}), this surfuse {__version__} reads up to "
            f"{FORMAT_VERSION}",
            where=str(path),
            cure="install a newer surfuse",
        )
    return tables, run["seed"]
