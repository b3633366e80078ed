"""Whether this process is compiling kernels, and how many it has: for a person who waits.

Nothing heavy is imported here, so that a command line can look before any kernel is there.
"""

from __future__ import annotations

import gc
from dataclasses import dataclass


@dataclass
class Compiling:
    """What the compiler does in this process. `depth` counts kernels under way: one asks for those that it calls.

    The compiler makes millions of small objects that live on. The garbage collector would walk through them again and
    again, a tenth of the time, so it rests meanwhile.
    """

    kernels: int = 0
    depth: int = 0
    _collects: bool = False

    def begin(self) -> None:
        """A kernel is being compiled."""
        if self.depth == 0:
            self._collects = gc.isenabled()
            gc.disable()
        self.depth += 1

    def end(self) -> None:
        """It is compiled, or could not be."""
        self.depth, self.kernels = self.depth - 1, self.kernels + 1
        if self.depth == 0 and self._collects:
            gc.enable()


COMPILING = Compiling()
