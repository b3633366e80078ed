"""Writes docs/reference/api.md and settings.md from the code: `python docs/make_reference.py`."""

from __future__ import annotations

import dataclasses
import inspect
import json
import re
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType
from typing import Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

import surfuse
from surfuse import registry
from surfuse.commands.explain.evidence_records import ReadingEvidence, StopEvidence
from surfuse.settings import Settings
from surfuse.settings.hidden_errors import HiddenErrors
from surfuse.settings.looking_tables import PlaneSettings
from surfuse.settings.rig_tables import AreaSettings, SensorSettings

REFERENCE = Path(__file__).parent / "reference"
COMMAND = "python docs/make_reference.py"
HEAD = f"<!-- Written by `{COMMAND}` from the code; do not edit. -->\n\n"

CALLS = ("read", "log", "fuse", "methods", "open_map", "evaluate", "acquire", "resume")
CLASSES = ("Log", "Frame", "Sensor", "SurfaceMap", "Finding", "MapScore", "CellExplanation", "Run", "SurfuseError")

API_TEXT = """\
# The Python door

`import surfuse as sf` takes a moment and loads nothing else; every name below is loaded when it is used. Arrays in,
arrays out: no call reads a file that it was not given, sets up logging or keeps state. Every error is a `SurfuseError`.
[From Python](../how-to/python.md) shows it at work.

## Calls
"""

SETTINGS_TEXT = """\
# Settings

A cell file (TOML) has a table for each section; `--set section.key=value` and the `settings` of `surfuse.acquire` take
the same keys. `run.toml` of a run holds all of them. Lengths are in metres, angles in degrees; the unit 1 stands for
numbers without one. Later sources win: defaults, cell file, `--set`, options of the command.
"""

DRIVERS_TEXT = """\
## Keys of the drivers

They stand in the table that names the driver: `[arm]`, `[[sensor]]`, `[camera]` or `[ranger]`.
"""
NEEDED = "needed"
RIG_TABLES = {
    "[[sensor]]": SensorSettings,
    "[area]": AreaSettings,
    "[search.plane]": PlaneSettings,
    "[hidden]": HiddenErrors,
}
DRIVERS = {
    "arms": ("bridge", "gcode", "recorded", "ur_rtde"),
    "sensors": ("a02yyuw", "gcode_probe", "hcsr04", "iio", "maxbotix", "ranging_kit", "recorded", "tfmini"),
    "cameras": ("recorded", "uvc"),
}

PARAMETERS_TEXT = """\
## Parameters of the fusion methods

`--set fusion.parameters.<method>.<key>=value`, or the `parameters` of `surfuse.fuse`. Units stand at the ends of the
names.
"""

# By the end of the name: the longest that fits is the unit.
UNITS = {
    "per_root_m": "m^(-1/2)",
    "deg_s2": "deg/s²",
    "deg_s": "deg/s",
    "m_s": "m/s",
    "deg": "deg",
    "mm": "mm",
    "m": "m",
    "s": "s",
    "hz": "Hz",
    "bps": "bit/s",
    "px": "px",
    "kg": "kg",
    "c": "°C",
    "percent": "%",
    "rad": "rad",
    "k": "K",
    "levels": "grey levels",
}


def unit_of(name: str, annotation: object) -> str:
    """The unit that a name carries; "1" for numbers without one, nothing for words and switches."""
    for end, unit in UNITS.items():
        if name.endswith(f"_{end}"):
            return unit
    kinds = {annotation, *get_args(annotation)}
    return "1" if kinds & {int, float} and bool not in kinds else ""


def pages() -> dict[Path, str]:
    """Both pages as they should be."""
    return {REFERENCE / "api.md": api_page(), REFERENCE / "settings.md": settings_page()}


def settings_page() -> str:
    """A table a section: key, default, unit, limits, meaning; then the parameters of the fusion methods."""
    text = HEAD + SETTINGS_TEXT
    loose = {name: field for name, field in Settings.model_fields.items() if not _is_section(field)}
    text += "\n## Outside of the sections\n\n" + _table(loose)
    for name, field in Settings.model_fields.items():
        section = field.annotation
        if _is_section(field) and isinstance(section, type) and issubclass(section, BaseModel):
            text += f"\n## `[{name}]`\n\n{_plain(section)}\n\n" + _table(section.model_fields)
    for head, table in RIG_TABLES.items():
        text += f"\n## `{head}`\n\n{_plain(table)}\n\n" + _table(table.model_fields)
    return text + "\n" + "".join(_driver_keys()) + "\n" + "".join(_parameters())


def _driver_keys() -> Iterator[str]:
    yield DRIVERS_TEXT
    for kind, names in DRIVERS.items():
        for name in names:
            module = registry.load(kind, name)
            yield f"\n### `{name}`\n\n{module.SUMMARY[0].upper()}{module.SUMMARY[1:]}.\n\n"
            yield "| key | default | unit |\n|---|---|---|\n"
            for field in dataclasses.fields(module.Parameters):
                if not field.metadata.get("given_by_rig"):
                    default = NEEDED if field.default is dataclasses.MISSING else _value(field.default)
                    yield f"| `{field.name}` | {default} | {unit_of(field.name, type(field.default))} |\n"
            yield f"\n{_plain(module.Parameters)}\n"


def _is_section(field: FieldInfo) -> bool:
    return isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)


def _table(fields: dict[str, FieldInfo]) -> str:
    rows = ["| key | default | unit | limits | meaning |", "|---|---|---|---|---|"]
    for name, field in fields.items():
        default = {} if field.default_factory is not None else field.default
        cells = (f"`{name}`", _value(default), unit_of(name, field.annotation), _limits(field), field.description or "")
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"


def _value(value: object) -> str:
    if value is PydanticUndefined:
        return NEEDED
    if value is None:
        return "-"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, str):
        return f"`{json.dumps(value)}`"
    return f"`{list(value)}`" if isinstance(value, tuple) else f"`{value}`"


def _limits(field: FieldInfo) -> str:
    for kind in (field.annotation, *get_args(field.annotation)):
        if get_origin(kind) is Literal:
            return ", ".join(f"`{word}`" for word in get_args(kind))
    bounds = {
        name: getattr(one, name) for one in field.metadata for name in ("gt", "ge", "lt", "le") if hasattr(one, name)
    }
    low = next((f"{_short(bounds[key])} {sign}" for key, sign in (("gt", "<"), ("ge", "≤")) if key in bounds), "")
    high = next((f"{sign} {_short(bounds[key])}" for key, sign in (("lt", "<"), ("le", "≤")) if key in bounds), "")
    if low and not high:
        return f"{'>' if 'gt' in bounds else '≥'} {low.split()[0]}"
    return f"{low} . {high}".strip(" .") if not low else f"{low} x {high}" if high else ""


def _short(bound: float) -> str:
    return "2⁶³ - 1" if bound == 2**63 - 1 else f"{bound:g}" if bound < 1e5 else f"{bound:.0f}"


def _parameters() -> Iterator[str]:
    yield PARAMETERS_TEXT
    for name in registry.names("fusion"):
        module = registry.load("fusion", name)
        yield f"\n### `{name}`\n\n{module.SUMMARY[0].upper()}{module.SUMMARY[1:]}.\n\n"
        yield "| key | default | unit |\n|---|---|---|\n"
        for field in dataclasses.fields(module.Parameters):
            yield f"| `{field.name}` | {_value(field.default)} | {unit_of(field.name, type(field.default))} |\n"
        yield f"\n{_plain(module.Parameters)}\n"


def api_page() -> str:
    """The calls of `surfuse`, then its records."""
    text = HEAD + API_TEXT
    for name in CALLS:
        call = getattr(surfuse, name)
        text += f"\n### `{name}`\n\n```python\n{_signature(name, call)}\n```\n\n{_plain(call)}\n"
    text += "\n## Records\n"
    for name in CLASSES:
        text += _class(name, getattr(surfuse, name))
    text += "\n## What `why` tells of stops and readings\n"
    for one in (StopEvidence, ReadingEvidence):
        text += _class(one.__name__, one)
    return text


def _signature(name: str, call: FunctionType, hide: tuple[str, ...] = ()) -> str:
    """A signature from the source's own words, the same under every version of Python."""
    words, starred = [], False
    for one in inspect.signature(call).parameters.values():
        if one.name in hide:
            continue
        if one.kind is one.KEYWORD_ONLY and not starred:
            words.append("*")
            starred = True
        default = "" if one.default is one.empty else f" = {_python(one.default)}"
        words.append(f"{one.name}: {one.annotation}{default}")
    line = f"{name}({', '.join(words)}) -> {inspect.signature(call).return_annotation}"
    if len(line) <= 110:
        return line
    return f"{name}(\n" + "".join(f"    {word},\n" for word in words) + f") -> {line.rpartition(' -> ')[2]}"


def _python(value: object) -> str:
    return json.dumps(value) if isinstance(value, str) else repr(value)


def _class(name: str, record: type) -> str:
    text = f"\n### `{name}`\n\n{_plain(record)}\n"
    rows = [f"| `{key}` | `{kind}` | {meaning} |" for key, kind, meaning in _members(record)]
    if rows:
        text += "\n| name | type | meaning |\n|---|---|---|\n" + "\n".join(rows) + "\n"
    for key, member in vars(record).items():
        if isinstance(member, FunctionType) and not key.startswith("_") and member.__doc__:
            text += f"\n```python\n{_signature(f'.{key}', member, ('self',))}\n```\n\n{_plain(member)}\n"
    return text


def _members(record: type) -> Iterator[tuple[str, str, str]]:
    """Fields and properties with their types; a field's meaning stands in the text above."""
    if dataclasses.is_dataclass(record):
        for field in dataclasses.fields(record):
            default = "" if field.default is dataclasses.MISSING else f"default {_value(field.default)}"
            yield (
                field.name,
                str(field.type).replace("|", "\\|"),
                default if field.default is not None else "default none",
            )
    for key, member in vars(record).items():
        if isinstance(member, property) and not key.startswith("_"):
            kind = inspect.signature(member.fget).return_annotation
            yield key, str(kind).replace("|", "\\|"), " ".join(_plain(member).split())


_LISTED = re.compile(r"([\w, ]+) : (.*)")


def _plain(thing: object) -> str:
    """A docstring as markdown: every `name : meaning` of its sections as an item of a list."""
    lines = [""]
    for line in (inspect.getdoc(thing) or "").splitlines():
        listed, in_list = _LISTED.fullmatch(line), lines[-1].startswith("- ")
        if listed:
            lines += [] if in_list or not lines[-1] else [""]
            lines.append(f"- `{listed[1]}`: {listed[2]}")
        elif line.startswith("    ") and in_list:
            lines[-1] += f" {line.strip()}"
        elif set(line) == {"-"}:
            lines.append("")
        else:
            lines += [""] if in_list and line else []
            lines.append(line)
    return "\n".join(lines).strip()


def main() -> None:
    """Write both pages."""
    for path, text in pages().items():
        path.write_text(text, "utf-8")
        print(path)


if __name__ == "__main__":
    main()
