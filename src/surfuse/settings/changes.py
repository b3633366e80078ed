"""Which values of a configuration differ from the defaults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from surfuse.settings.configuration import Settings


def changed(settings: Settings) -> tuple[str, ...]:
    """Key paths, like `scan.step_m`, of all values that are not the default."""
    return tuple(_changed(settings.model_dump(), Settings().model_dump(), ""))


def _changed(values: Mapping[str, object], usual: Mapping[str, object], path: str) -> Iterator[str]:
    for key, value in values.items():
        default = usual.get(key)
        if isinstance(value, Mapping) and isinstance(default, Mapping):
            yield from _changed(value, default, f"{path}{key}.")
        elif value != default:
            yield f"{path}{key}"
