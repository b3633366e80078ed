"""The errors of surfuse: one root, one exit status each, messages that name value, limit and cure."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable
from functools import partial
from typing import Self


class SurfuseError(Exception):
    """An error that a user can act on; its text says what is wrong, where, and what to do.

    Parameters
    ----------
    what : what is wrong, with the offending value and the limit that it broke.
    cure : what the user can do about it.
    where : file, line, key or device, when that is not part of `what`.
    """

    exit_status = 1

    def __init__(self, what: str, *, cure: str = "", where: str = "") -> None:
        self.what = what
        self.cure = cure
        self.where = where
        super().__init__(what, cure, where)

    def __str__(self) -> str:
        text = f"{self.where}: {self.what}" if self.where else self.what
        return f"{text}; {self.cure}" if self.cure else text

    def __reduce__(self) -> tuple[Callable[[], Self], tuple[()]]:
        """Copies and pickles whole: workers of a process pool raise these errors too."""
        return partial(type(self), self.what, cure=self.cure, where=self.where), ()


class UsageError(SurfuseError):
    """The command line asks for something that does not exist."""

    exit_status = 2


class ConfigError(SurfuseError):
    """A configuration value is missing, unknown or out of its limits."""

    exit_status = 3


class DataError(SurfuseError):
    """A file or a record holds data that cannot be used."""

    exit_status = 3


class DeviceError(SurfuseError):
    """A device does not answer, or answers nonsense."""

    exit_status = 4


class SafetyStopError(SurfuseError):
    """A motion was refused or stopped because a limit would be, or was, exceeded."""

    exit_status = 5


class UnreachableError(SafetyStopError):
    """The arm cannot take this pose, and has not moved: a scan may leave the stop out and go on."""


class StorageError(SurfuseError):
    """The disk refused, or what is on it is damaged."""

    exit_status = 6


class InterruptError(SurfuseError):
    """The user stopped the work at once; an acquisition keeps what it had scanned, and can be resumed."""

    exit_status = 130


_SLIP, _LIKE = 0.9, 0.5  # how alike two names are, 1 for equal ones (Ratcliff and Obershelp)


def nearest(name: str, valid: Iterable[str]) -> str:
    """Name the closest of the valid names, as the cure of an unknown-name error.

    One that begins like the name, or the other way round, is closer than one that only resembles it: `fx` is `fx_px`.
    Closer still is one that differs by a slip of the pen.
    """
    names = sorted(valid)
    listing, asked = ", ".join(names), name.casefold()
    begun = [one for one in names if asked and (one.casefold().startswith(asked) or asked.startswith(one.casefold()))]
    begun.sort(key=lambda one: abs(len(one) - len(name)))
    folded = {one.casefold(): one for one in reversed(names)}
    slip, like = (difflib.get_close_matches(asked, folded, n=1, cutoff=cutoff) for cutoff in (_SLIP, _LIKE))
    close = [folded[one] for one in slip] or begun[:1] or [folded[one] for one in like]
    return f"did you mean '{close[0]}'? valid: {listing}" if close else f"valid: {listing}"
