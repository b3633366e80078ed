"""What the pages say of the code is there: files, folders, functions, and the imports of their examples."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
from pathlib import Path

import pytest

import surfuse

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("[RC]*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").rglob("*.md")])
FILE_ENDINGS = ("py", "toml", "csv", "nc", "html", "md")
PLACES = (ROOT / "src" / "surfuse", ROOT, ROOT / "examples")
ROOMS = {module.name for module in pkgutil.iter_modules(surfuse.__path__)}
FILE = re.compile(r"`((?:[\w-]+/)+[\w-]+\.(?:py|dbc|md|toml)|(?:[\w-]+/)*[\w-]+/)`(?:: ((?:`\w+`(?:, )?)+))?")
DOTTED = re.compile(r"`(?:surfuse\.)?(\w+(?:\.\w+)+)(?:\(\))?`")
# Written by the reader or by a command.
ELSEWHERE = re.compile(
    r"^(runs|views|mine|turned|log|my_\w+|src/surfuse/fusion/my_\w+|src/surfuse/\w+/steady|\.venv)\b"
)


def names(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def plain_text(page: Path) -> str:
    return re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)


def resolved(path: str) -> object:
    """The module or the name behind a dotted path below surfuse."""
    parts = path.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(["surfuse", *parts[:cut]]))
        except ModuleNotFoundError:
            continue
        for name in parts[cut:]:
            found = getattr(found, name)
        return found
    raise AssertionError(f"there is no surfuse.{path}")


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_files_and_folders_that_a_page_names_are_there(page):
    for path, members in FILE.findall(plain_text(page)):
        if ELSEWHERE.match(path):
            continue
        found = [place / path for place in PLACES if (place / path).exists()]
        assert found, f"there is no {path}"
        for member in re.findall(r"\w+", members):
            assert re.search(rf"^(def|class) {member}\b|^{member}\b.*=", found[0].read_text("utf-8"), re.MULTILINE), (
                member
            )


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_names_that_a_page_gives_with_their_room_are_there(page):
    for path in DOTTED.findall(plain_text(page)):
        room, _, rest = path.partition(".")
        # `fusion` is a section of the settings, too.
        if room in ROOMS and rest not in FILE_ENDINGS and not rest.startswith(("method", "parameters")):
            resolved(path)


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_the_imports_of_a_page_s_python_resolve(page):
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    for block in blocks:
        if "(\n    path:" in block or ") -> " in block.splitlines()[-1]:
            continue  # a signature of the reference
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and node.module.startswith("surfuse"):
                module = importlib.import_module(node.module)
                for alias in node.names:
                    path = f"{node.module}.{alias.name}".removeprefix("surfuse.")
                    assert hasattr(module, alias.name) or resolved(path)


def test_the_page_on_the_architecture_names_every_room():
    page = (ROOT / "docs" / "explanations" / "architecture.md").read_text("utf-8")
    rooms = {module.name for module in pkgutil.iter_modules(surfuse.__path__) if module.ispkg}
    assert {room for room in rooms if f"`{room}/`" not in page} == set()
