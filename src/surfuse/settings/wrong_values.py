"""What is wrong with a configuration, in one line: key, value, limit, and what to write instead."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import get_args

from pydantic import BaseModel, ValidationError

from surfuse.errors import nearest
from surfuse.settings.configuration import Settings
from surfuse.settings.section import Section

_SHOWN = 80  # characters of a wrong value that a message repeats
_PARAMETER_PLACE = 4  # fusion.parameters.METHOD.KEY
_LISTS = ("sensor",)
"""Tables of which there may be several, `[[sensor]]`."""
_DRIVEN = ("arm", "camera", "ranger")
"""Tables whose further keys are those of a driver."""
_VECTORS = ("position_m", "axis", "origin_m", "u", "v", "normal", "region_px", "distortion")

Place = tuple[int | str, ...]


@dataclass(frozen=True)
class _Problem:
    """One thing that is wrong: pydantic's name for it, where it is, the value, its words and the limits in them."""

    kind: str
    place: Place
    given: object
    message: str
    limits: Mapping[str, object]


def _problems(error: ValidationError) -> list[_Problem]:
    return [
        _Problem(one["type"], tuple(one["loc"]), one["input"], one["msg"], one.get("ctx", {}))
        for one in error.errors(include_url=False)
    ]


def explain(error: ValidationError, tree: Mapping[str, object]) -> str:
    """The first problem of the configuration `tree`."""
    problems = _problems(error)
    problem = problems[0]
    place, more = problem.place, f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    if problem.kind == "extra_forbidden":
        return _unknown_key(place, more)
    path = _path(place, tree)
    if problem.kind == "missing" and isinstance(place[-1], str):
        return f"{_path(place[:-1], tree)} has no {place[-1]}{more}; add the key '{place[-1]}'"
    if (table := _table_trouble(problem, path)) is not None:
        return f"{table}{more}"
    if (count := _wrong_count(problem, problems, tree)) is not None:
        return count
    if place[:2] == ("fusion", "parameters") and len(place) > _PARAMETER_PLACE:
        # One problem for every type that a parameter may have; the last word of the place is that type.
        shown = _path(place[:_PARAMETER_PLACE], tree)
        return f"{shown} = {_shown(problem.given)}: give a finite number, a text, true or false"
    if "parameters" in place and place[0] in (*_DRIVEN, *_LISTS):
        of_driver = place.index("parameters")
        shown = _path((*place[:of_driver], place[of_driver + 1]), tree)
        given = _shown(problem.given)
        return f"{shown} = {given}: give a finite number, a text, true or false, or a list of texts or of numbers"
    return f"{path} = {_shown(problem.given)}: {_words(problem)}{more}"


def _unknown_key(place: Place, more: str) -> str:
    """A key that is not there: the nearest one, or the table to which it belongs."""
    key, valid = str(place[-1]), _keys(tuple(str(part) for part in place[:-1]))
    path = ".".join(map(str, place))
    homes = [] if len(place) > 1 else [name for name in Settings.model_fields if key in _keys((name,))]
    home = f"it is a key of [{homes[0]}]; " if homes and key not in valid else ""
    return f"unknown key '{path}'{more}; {home}{nearest(key, valid)}"


def _table_trouble(problem: _Problem, path: str) -> str | None:
    """A table where a value stands, one bracket where two belong, or the reverse; None for other trouble."""
    kind, given, name = problem.kind, problem.given, str(problem.place[-1]) if problem.place else ""
    if kind == "tuple_type" and name in _LISTS:
        if isinstance(given, Mapping):
            return f"[{name}] is one table, and there may be several; write [[{name}]], with two brackets, for each"
        return f"{path} = {_shown(given)}: it is a list of tables; write a table [[{name}]] for each"
    if kind not in ("dict_type", "model_type", "model_attributes_type"):
        return None
    if isinstance(given, list):
        return f"[[{name}]] makes a list of tables, and there is only one; write [{name}], with one bracket"
    return f"{path} = {_shown(given)}: it is a table, not a value; write {path}.KEY=VALUE"


def _wrong_count(problem: _Problem, problems: list[_Problem], tree: Mapping[str, object]) -> str | None:
    """Too few or too many values in a row; None for other trouble."""
    place, given = problem.place, problem.given
    if problem.kind == "missing":
        place = place[:-1]
        ends = [one.place[-1] for one in problems if one.place[:-1] == place and one.kind == "missing"]
        wanted = max(end for end in ends if isinstance(end, int)) + 1
    elif problem.kind in ("too_long", "too_short"):
        wanted = int(str(problem.limits.get("max_length", problem.limits.get("min_length", 0))))
    else:
        return None
    found = len(given) if isinstance(given, list | tuple) else 0
    exact = problem.kind == "missing" or place[-1] in _VECTORS
    limit = f"{wanted} are needed" if exact else f"at most {wanted} can be given"
    return f"{_path(place, tree)} = {_shown(given)}: the number of values is {found}, and {limit}"


def _words(problem: _Problem) -> str:
    """What is wrong in pydantic's words, and what to write where the kind of the value is wrong."""
    kind, given, message = problem.kind, problem.given, problem.message[0].lower() + problem.message[1:]
    if kind in ("list_type", "tuple_type"):
        return "several values are needed here; write them in square brackets, as [0.0, 0.0, 1.0]"
    cure = _in_metres(problem)
    if kind in ("float_type", "int_type"):
        cure = _of_number(given)
    elif kind == "bool_type":
        word = str(given).strip().lower()
        cure = f"write {word} without quotes" if word in ("true", "false") else "write true or false"
    elif kind == "string_type" and isinstance(given, bool | int | float):
        cure = f'write it in quotes: "{str(given).lower()}"'
    elif kind == "literal_error" and isinstance(given, str):
        words = str(problem.limits.get("expected", "")).replace(" or ", ", ").split(", ")
        likely = nearest(given, [word.strip("'") for word in words])
        cure = likely.partition("? ")[0] + "?" if "? " in likely else ""
    return f"{message}; {cure}" if cure else message


def _in_metres(problem: _Problem) -> str:
    """A hint at millimetres, where a length is far above its limit."""
    limit, given, key = problem.limits.get("le"), problem.given, str(problem.place[-1])
    if not key.endswith("_m") or not isinstance(given, int | float) or not isinstance(limit, int | float):
        return ""
    return f"give metres ({given:g} mm are {1e-3 * given:g})" if given > limit else ""


def _of_number(given: object) -> str:
    """What to write for what is no number."""
    if isinstance(given, str) and len(given) <= _SHOWN and _is_number(given):
        return f"write it without quotes: {given.strip()}"
    return "give one number" if isinstance(given, list | Mapping) else ""


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _path(place: Place, tree: Mapping[str, object]) -> str:
    """The key as a person writes it; of a list of tables the name of the one that is meant."""
    if len(place) > 1 and place[0] in _LISTS and isinstance(place[1], int):
        rest = _dotted(place[2:])
        return f"{place[0]} {_name(place[0], place[1], tree)}{': ' if rest else ''}{rest}"
    return _dotted(place)


def _dotted(place: Place) -> str:
    """Keys with dots, numbers in a list in brackets."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place).removeprefix(".")


def _name(table: object, index: int, tree: Mapping[str, object]) -> str:
    """'us0', or the number of a table that has no name."""
    found = tree.get(str(table))
    one = found[index] if isinstance(found, list | tuple) and index < len(found) else None
    name = one.get("name") if isinstance(one, Mapping) else None
    return f"'{name}'" if isinstance(name, str) and name else f"number {index + 1}"


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def _keys(path: tuple[str, ...]) -> tuple[str, ...]:
    """Valid keys of the section at a path."""
    model: type[BaseModel] = Settings
    for part in path:
        if part not in model.model_fields:
            continue  # the number of a table in a list
        annotation = model.model_fields[part].annotation
        candidates = [annotation, *get_args(annotation)]
        model = next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), Section)
    return tuple(model.model_fields)
