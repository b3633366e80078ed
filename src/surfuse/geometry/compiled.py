"""One typed door to the compiler, so that kernels stay type-checked functions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import rmtree
from threading import Lock
from typing import TypeVar, cast

from numba import config, njit
from numba.core import event

from surfuse.geometry.compiling import COMPILING
from surfuse.geometry.kernel_folder import kernel_folder
from surfuse.geometry.kernel_sources import sources_key

F = TypeVar("F", bound=Callable[..., object])
_DECORATING = Lock()


def compiled(function: F) -> F:
    """Compile a numeric kernel ahead of its second call, cached on disk, same meaning as plain Python.

    Never with `fastmath`: it would break `isnan` and the bit-identity of live and replayed fusion. The folder of the
    cache is named by all sources that the kernel is made from, so that a changed one is compiled anew.
    """
    return _defined(function, inline=False)


def inlined(function: F) -> F:
    """The same for a small kernel that is called in the innermost loop: its text is put where it is called.

    A call counts every array that it is given in and out again, which costs more than a few sums do.
    """
    return _defined(function, inline=True)


def _defined(function: F, inline: bool) -> F:
    with _kept(function) as kept:
        kernel = njit(  # type: ignore[call-overload]
            cache=kept,
            nogil=True,
            error_model="numpy",
            forceinline=inline,
            no_cfunc_wrapper=True,  # nobody calls a kernel as a C function
        )
        return cast(F, kernel(function))


@contextmanager
def _kept(function: Callable[..., object]) -> Iterator[bool]:
    """Let the compiler's cache lie in the folder of this kernel; false where nothing can be kept.

    The compiler looks at `config.CACHE_DIR` when a kernel is defined, and takes it as it is for other packages.
    """
    folder = _folder_of(function)
    with _DECORATING:
        settings = vars(config)
        before = settings["CACHE_DIR"]
        settings["CACHE_DIR"] = "" if folder is None else str(folder)
        try:
            yield folder is not None
        finally:
            settings["CACHE_DIR"] = before


def _folder_of(function: Callable[..., object]) -> Path | None:
    """The folder of a kernel's module as its sources are now; those of its earlier sources are removed."""
    root = kernel_folder()
    if root is None:
        return None
    module = function.__module__
    folder = root.path / f"{module}-{sources_key(Path(function.__code__.co_filename), module)}"
    if not folder.is_dir():
        for stale in root.path.glob(f"{module}-*"):
            rmtree(stale, ignore_errors=True)
    return folder


class _Watched(event.Listener):
    """Tells `COMPILING` what the compiler does."""

    def on_start(self, event: event.Event) -> None:
        COMPILING.begin()

    def on_end(self, event: event.Event) -> None:
        COMPILING.end()


event.register("numba:compile", _Watched())  # type: ignore[no-untyped-call]
