"""What a module of kernels is made from: its source and that of every module that it imports, as one short key.

A kernel is compiled together with the kernels and the constants of other modules that it names, so that it is stale as
soon as any of them changes.
"""

from __future__ import annotations

import hashlib
import re
from functools import cache
from pathlib import Path

_IMPORT = re.compile(rb"^(?:from\s+([\w.]+)\s+import\s+(\([^)]*\)|[^\n]*)|import\s+([\w.]+))", re.MULTILINE)
_COMMENT = re.compile(rb"#[^\n]*")
_ROOT = Path(__file__).resolve().parents[2]


def sources_key(file: Path, module: str) -> str:
    """Hash of a module's source and of all that it imports, directly or not, from its own package or from surfuse.

    Imports inside functions do not count: they cannot give a kernel anything.
    """
    top = module.split(".")[0]
    depth = len(module.split("."))
    outside = file.parents[depth - 1 + (file.name == "__init__.py")] if depth <= len(file.parents) - 1 else file.parent
    roots = (("surfuse", _ROOT), (top, _ROOT if top == "surfuse" else outside))
    seen: dict[Path, None] = {file: None}
    for path in (waiting := [file]):
        for found in _imported(path, roots):
            if found not in seen:
                seen[found] = None
                waiting.append(found)
    digest = hashlib.sha256()
    for path in sorted(seen):
        digest.update(_digest(path))
    return digest.hexdigest()[:16]


@cache
def _source(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""


@cache
def _digest(path: Path) -> bytes:
    return hashlib.sha256(_source(path)).digest()


@cache
def _imported(path: Path, roots: tuple[tuple[str, Path], ...]) -> tuple[Path, ...]:
    found: list[Path] = []
    for source, names, plain in _IMPORT.findall(_source(path)):
        module = (source or plain).decode()
        root = dict(roots).get(module.split(".")[0])
        if root is None:
            continue
        folder = root.joinpath(*module.split("."))
        found += _files(folder)
        for name in re.findall(rb"\w+", _COMMENT.sub(b"", names)):
            found += _files(folder / name.decode())
    return tuple(found)


@cache
def _files(module: Path) -> tuple[Path, ...]:
    """The file of a module or of a package; nothing where the name is none of a module."""
    candidates = (module.with_name(module.name + ".py"), module / "__init__.py")
    return tuple(path for path in candidates if path.is_file())
