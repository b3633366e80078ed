"""One typed door to the compiler, so that kernels stay type-checked functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a numeric kernel ahead of its second call, cached on disk, same meaning as plain Python.

    Never with `fastmath`: it would break `isnan` and the bit-identity of live and replayed fusion.
    A kernel that calls kernels of another module is only recompiled when its own file changes: delete
    the `__pycache__` folders after editing a kernel that others call.
    """
    return cast(F, njit(cache=True, nogil=True, error_model="numpy")(function))
