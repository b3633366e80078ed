"""The files that a configuration names: found beside the cell file too, and by whole paths from anywhere."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

FILE_KEYS = (("scene", "name"), ("arm", "file"), ("area", "outline"), ("area", "mesh"))
COMMAND = ("arm", "command")


def with_files_beside(tree: Mapping[str, object], folder: Path) -> dict[str, object]:
    """The tables of a cell file in `folder`, with whole paths of named files that lie there and not where we are.

    Of the words of `arm.command` those count that are such files.
    """

    def found(word: str) -> str:
        beside = folder / word
        return str(beside.resolve()) if not Path(word).is_file() and _is_file(beside) else word

    changed = dict(tree)
    for table, key in (*FILE_KEYS, COMMAND):
        values = changed.get(table)
        value = values.get(key) if isinstance(values, Mapping) else None
        if isinstance(values, Mapping) and isinstance(value, str) and value and (table, key) != COMMAND:
            changed[table] = {**values, key: found(value)}
        elif isinstance(values, Mapping) and isinstance(value, list) and (table, key) == COMMAND:
            words = [word if isinstance(word, str) else "" for word in value]
            changed[table] = {**values, key: _changed_words(words, found)} if all(words) else values
    return changed


def command_from_anywhere(words: Sequence[str]) -> list[str]:
    """A command whose words that are files where we are have whole paths, so that it starts from another folder too."""
    return _changed_words(words, lambda word: str(Path(word).resolve()) if _is_file(Path(word)) else word)


def _changed_words(words: Sequence[str], change: Callable[[str], str]) -> list[str]:
    """The words, those that are files changed; the first one only where it is not found as a program."""
    first = words[0] if shutil.which(words[0]) and Path(words[0]).name == words[0] else change(words[0])
    return [first, *(change(word) for word in words[1:])]


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        # A word that no file can be called.
        return False
