"""Files that the commands on single pictures write."""

from __future__ import annotations

from pathlib import Path

from surfuse.durable import refuse_existing
from surfuse.errors import UsageError


def check_output(path: Path | None, suffix: str, force: bool, image: Path) -> None:
    """Refuse before any work is done; the picture itself is never replaced, asked for or not."""
    if path is None:
        return
    if path.resolve() == image.resolve():
        raise UsageError(f"the output '{path}' would replace the picture itself", cure="give another name")
    if path.suffix.lower() != suffix:
        raise UsageError(f"output file '{path}'", cure=f"give a name that ends in {suffix}")
    refuse_existing(path, force)
