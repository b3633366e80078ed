"""`surfuse` as a process that sends itself a signal at the moment when so many bytes stand in its log.

Usage: python at_a_size.py SIGNAL BYTES WORDS... A test that watches the file from outside looks too late on a busy
machine; this one is exact: the write that passes the size is cut there.
"""

from __future__ import annotations

import os
import sys

from surfuse.cli import main
from surfuse.runs import segment


class Disk:
    """The module `os` as the log sees it."""

    def __init__(self, number: int, left: int) -> None:
        self.number, self.left = number, left

    def __getattr__(self, name: str) -> object:
        return getattr(os, name)

    def write(self, descriptor: int, data: memoryview) -> int:
        if not 0 <= self.left <= len(data):
            self.left -= len(data)
            return os.write(descriptor, data)
        written = os.write(descriptor, data[: self.left])
        self.left = -1
        os.kill(os.getpid(), self.number)
        return written


if __name__ == "__main__":
    segment.os = Disk(int(sys.argv[1]), int(sys.argv[2]))  # type: ignore[assignment]
    sys.argv = ["surfuse", *sys.argv[3:]]
    main()
