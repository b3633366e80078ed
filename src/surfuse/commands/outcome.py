"""What a command of the pipeline gives back, and how it tells where it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable


@dataclass(frozen=True)
class Outcome:
    """The result twice: plain data for machines, label and text for people.

    `complete` is false when the user interrupted an acquisition that can be resumed.
    """

    summary: dict[str, object]
    table: list[tuple[str, str]]
    complete: bool = True


class Watcher(Protocol):
    """Told about progress, asked whether to stop."""

    def stage(self, name: str, total: int = 1) -> None: ...
    def advance(self, steps: int = 1) -> None: ...
    def warn(self, text: str) -> None: ...
    def stop_requested(self) -> bool: ...


class SilentWatcher:
    """A watcher that says nothing and never stops."""

    def stage(self, name: str, total: int = 1) -> None:
        """Ignore."""

    def advance(self, steps: int = 1) -> None:
        """Ignore."""

    def warn(self, text: str) -> None:
        """Ignore."""

    def stop_requested(self) -> bool:
        """Never."""
        return False


@runtime_checkable
class Asker(Protocol):
    """A watcher that can ask the user, as one at a terminal."""

    @property
    def attended(self) -> bool:
        """Whether somebody is there to answer."""

    def ask(self, question: str) -> str | None:
        """The answer, without the end of its line; None when nobody is there."""


def asked_by(watcher: Watcher) -> Asker | None:
    """The watcher, if it can ask and somebody is there to answer."""
    return watcher if isinstance(watcher, Asker) and watcher.attended else None


def finite(value: object) -> object:
    """Plain data as JSON can hold it: numbers that are not finite become null, keys and other objects text."""
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    if isinstance(value, dict):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return value if isinstance(value, str | int | bool | None) else str(value)
