"""From a cell file, `--set key.path=value` and options of a command to the configuration; later sources win."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path

from pydantic import ValidationError

from surfuse.errors import ConfigError
from surfuse.runs.configuration import RUN_TABLE, read_configuration
from surfuse.runs.toml_file import parse_toml
from surfuse.settings.configuration import Settings
from surfuse.settings.named_files import with_files_beside
from surfuse.settings.wrong_values import explain

_LISTED = 6
_BESIDE_LOGS = ("sensors.toml", "frame.toml")
_NOWHERE = "configuration"


def load(
    cell_file: Path | None = None,
    overrides: Iterable[str] = (),
    values: Mapping[str, object] | None = None,
    **sections: Mapping[str, object],
) -> Settings:
    """Defaults, then the cell file, then `key.path=value` overrides, then values by key path, then whole sections.

    The run.toml of a run is a cell file too: it repeats the run, with its seed. Files that a cell file names are looked
    for where we are, then beside it.

    Raises
    ------
    ConfigError : unreadable file, unknown key (with the nearest valid one), wrong type, value out of its limits.
    """
    tree = _read_toml(cell_file) if cell_file is not None else {}
    where = str(cell_file) if cell_file is not None else _NOWHERE
    for text in overrides:
        _assign(tree, text)
    for path, value in (values or {}).items():
        _put(tree, path, value)
    for name, content in sections.items():
        section = tree.setdefault(name, {})
        if isinstance(section, dict):
            section.update(content)
    return from_tree(tree, where)


def from_tree(tree: Mapping[str, object], where: str = _NOWHERE) -> Settings:
    """Validate a nested mapping of plain values."""
    try:
        return Settings.model_validate(dict(tree))
    except ValidationError as error:
        raise ConfigError(explain(error, tree), where=where) from error
    except ConfigError as error:
        place = "" if where == _NOWHERE else where
        raise ConfigError(error.what, cure=error.cure, where=error.where or place) from error


def _read_toml(path: Path) -> dict[str, object]:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"cannot read it ({error.strerror})", cure=_meant(path), where=str(path)) from error
    tree = parse_toml(data, str(path))
    if RUN_TABLE not in tree:
        return with_files_beside(tree, path.parent)
    tables, seed = read_configuration(path)
    return {**tables, "seed": seed}


def _meant(path: Path) -> str:
    """The cell file that may have been meant: one in the folder that was given, or of nearly that name."""
    folder = path if path.is_dir() else path.parent
    names = (
        [file.name for file in sorted(folder.glob("*.toml")) if file.name not in _BESIDE_LOGS]
        if folder.is_dir()
        else []
    )
    if not names:
        return "give the path of a TOML file; 'surfuse init FOLDER' writes one"
    return f"give the path of a TOML file; in {folder} there {_are(names[:_LISTED])}"


def _are(names: list[str]) -> str:
    return f"is {names[0]}" if len(names) == 1 else f"are {', '.join(names)}"


def _assign(tree: dict[str, object], text: str) -> None:
    """Put one `key.path=value` into the tree; the value is read as TOML, else as a string."""
    path, separator, value_text = text.partition("=")
    if not separator or not all(key.strip() for key in path.split(".")):
        raise ConfigError(
            f"'{text}' is not of the form key.path=value", cure="write for example --set scan.margin_m=0.03"
        )
    try:
        value: object = tomllib.loads(f"value = {value_text.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        value = value_text.strip()
    except RecursionError as error:
        raise ConfigError(f"the value of '{path}' is nested too deeply", cure="give a plain value") from error
    _put(tree, path, value)


def _put(tree: dict[str, object], path: str, value: object) -> None:
    """Put a value into the tree at a path of keys, a table key by key; the tables on the way are made."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            _put(tree, f"{path}.{key}", inner)
        return
    node, keys = tree, [key.strip() for key in path.split(".")]
    for key in keys[:-1]:
        child = node.setdefault(key, {})
        if not isinstance(child, dict):
            raise ConfigError(f"'{path}' goes through '{key}', which is a value", cure="use a table's name there")
        node = child
    node[keys[-1]] = value
