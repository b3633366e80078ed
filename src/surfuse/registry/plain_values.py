"""The `Parameters` of a plug-in from plain values: a table of a TOML file, or `--set`."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

from surfuse.errors import ConfigError, SurfuseError, nearest
from surfuse.registry.folders import NOUNS, load

_KINDS = {bool: "true or false", int: "whole number", float: "number", str: "text", Path: "path"}
_GIVEN = "given_by_rig"


def parameters(
    kind: str, name: str, values: Mapping[str, object], where: str, surroundings: object | None = None
) -> object:
    """The parameters of a plug-in.

    `where` is the place of the table, for messages: `arm`, `fusion.parameters.mean`. `surroundings` is what the rig
    tells its drivers of this kind; None where there is no rig.

    Raises
    ------
    UsageError : no such plug-in.
    ConfigError : unknown key (the nearest is named), missing key, wrong type, value out of its limits; or the driver
        needs more than the rig can give.
    """
    module = load(kind, name)
    given = {} if surroundings is None else _accepted(module, f"{NOUNS[kind]} '{name}'", where, surroundings)
    return _built(module.Parameters, values, where, f"{NOUNS[kind]} '{name}'", given)


def _accepted(module: ModuleType, who: str, where: str, surroundings: object) -> dict[str, object]:
    """The surroundings under the name of their field; nothing for a plug-in that asks for none."""
    for field in dataclasses.fields(module.Parameters):
        if not field.metadata.get(_GIVEN):
            continue
        hint = typing.get_type_hints(module.Parameters)[field.name]
        wanted = next(one for one in (typing.get_args(hint) or (hint,)) if one is not types.NoneType)
        if isinstance(surroundings, wanted):
            return {field.name: surroundings}
        lacking = {one.name for one in dataclasses.fields(wanted)} - set(vars(surroundings))
        raise ConfigError(
            f"the {who} needs what this rig does not have: {', '.join(sorted(lacking))}",
            cure="take another driver, or the simulated rig",
            where=where,
        )
    return {}


def _built(record: type, values: Mapping[str, object], where: str, who: str, given: Mapping[str, object]) -> object:
    """A dataclass from the values of its fields."""
    known = {field.name: field for field in dataclasses.fields(record) if not field.metadata.get(_GIVEN)}
    hints = typing.get_type_hints(record)
    read: dict[str, object] = {}
    for key, value in values.items():
        if key not in known:
            raise ConfigError(f"unknown key '{where}.{key}'", cure=nearest(key, known))
        default = _default(known[key])
        read[key] = _typed(hints[key], value, f"{where}.{key}", who, default)
    missing = [name for name, field in known.items() if name not in values and _default(field) is dataclasses.MISSING]
    if missing:
        raise ConfigError(f"the {who} lacks {', '.join(missing)}", cure=f"add {missing[0]} = ...", where=where)
    try:
        return record(**read, **given)
    except SurfuseError as error:
        raise type(error)(error.what, cure=error.cure, where=error.where or where) from error
    except (TypeError, ValueError) as error:
        raise ConfigError(f"the {who} refuses its values: {error}", cure="correct them", where=where) from error


def _default(field: dataclasses.Field[object]) -> object:
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return field.default


def _typed(hint: object, value: object, where: str, who: str, default: object) -> object:
    """A plain value as the type of its field."""
    for one in _choices(hint):
        if dataclasses.is_dataclass(one) and isinstance(one, type) and isinstance(value, Mapping):
            return _built(one, value, where, who, {})
        fits, read = _plain(one, value)
        if fits:
            return read
    example = "" if default in (dataclasses.MISSING, None, ()) else f", for example {default!r}"
    if isinstance(value, str) and value and any(typing.get_origin(one) is tuple for one in _choices(hint)):
        example = f", as {value.split()!r}"
    raise ConfigError(f"{where} = {value!r}", cure=f"give {_words(hint)}{example}")


def _choices(hint: object) -> tuple[object, ...]:
    """The types of a union, or the one type."""
    union = isinstance(hint, types.UnionType) or typing.get_origin(hint) is typing.Union
    return typing.get_args(hint) if union else (hint,)


def _plain(hint: object, value: object) -> tuple[bool, object]:
    """Whether a value fits a type, and the value as that type."""
    if typing.get_origin(hint) is typing.Literal:
        return value in typing.get_args(hint), value
    if typing.get_origin(hint) is tuple:
        return _row(typing.get_args(hint), value)
    if hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        return True, float(value)
    if hint is Path and isinstance(value, str | Path):
        return bool(str(value)), Path(value)
    if hint in (bool, int, str):
        return type(value) is hint, value
    return False, value


def _row(hints: tuple[object, ...], value: object) -> tuple[bool, object]:
    """A list as a tuple of these types; `...` at the end: any number of the first."""
    if not isinstance(value, list | tuple):
        return False, value
    wanted = hints[:1] * len(value) if hints[-1:] == (Ellipsis,) else hints
    if len(wanted) != len(value):
        return False, value
    parts = [_plain(hint, one) for hint, one in zip(wanted, value, strict=True)]
    return all(fits for fits, _ in parts), tuple(read for _, read in parts)


def _words(hint: object) -> str:
    """What a type is called in a message."""
    names = []
    for one in _choices(hint):
        if typing.get_origin(one) is typing.Literal:
            names += [repr(choice) for choice in typing.get_args(one)]
        elif typing.get_origin(one) is tuple:
            names.append("a list")
        elif isinstance(one, type) and dataclasses.is_dataclass(one):
            names.append("a table")
        elif one is not types.NoneType:
            name = _KINDS.get(one, "") if isinstance(one, type) else ""
            names.append(name if one is bool else f"a {name}" if name else "nothing: no file can say it")
    return " or ".join(names)
