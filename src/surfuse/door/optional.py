"""Packages that only some calls need."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from surfuse.errors import ConfigError


@contextmanager
def needed(call: str, extra: str) -> Iterator[None]:
    """Imports in the block that fail say which extra of surfuse brings the package.

    Raises
    ------
    ConfigError : a package is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"{call} needs the package '{error.name}', which is not installed", cure=f"pip install 'surfuse[{extra}]'"
        ) from error
