"""Every command that the documentation prints is one that exists, with options that exist."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import typer

from surfuse import cli, registry
from surfuse.errors import SurfuseError
from surfuse.settings import load
from surfuse.twin.parts import SCENES

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")])
PROGRAM = re.compile(r"^(?:\$ )?(?:[\w./~-]*/)?surfuse(?: |$)")
PLACEHOLDER = re.compile(r"\b[A-Z_]+\b")


def lines_of(page: Path) -> list[str]:
    """Lines of code blocks and inline code that call surfuse, each a single command."""
    text = page.read_text("utf-8")
    blocks = re.findall(r"^```[a-z]*\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    plain = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    code = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    code += [span.replace("\n", " ") for span in re.findall(r"`([^`]+)`", plain)]
    parts = [part.strip() for line in code for part in re.split(r"&&|;(?=\s)", line.split("  #")[0])]
    return [part.removeprefix("$ ") for part in parts if PROGRAM.match(part)]


def examples(command: typer.core.TyperCommand | typer.core.TyperGroup, name: str) -> list[tuple[str, str]]:
    """Lines of a command's own help, and of the commands of a group, without their remarks in brackets."""
    lines = [part.strip() for line in (command.help or "").splitlines() for part in line.split("&&")]
    found = [(f"{name} --help", re.split(r"  +\(", line)[0]) for line in lines if line.startswith("surfuse ")]
    if isinstance(command, typer.core.TyperGroup):
        for child, inner in command.commands.items():
            found += examples(inner, child)
    return found


def commands() -> list[tuple[str, str]]:
    found = [(page.relative_to(ROOT).as_posix(), line) for page in PAGES for line in lines_of(page)]
    found += [pair for name, command in parser().commands.items() for pair in examples(command, name)]
    return sorted(set(found))


def parser() -> typer.core.TyperGroup:
    cli._register()
    return typer.main.get_command(cli.app)


def parsed(words: list[str]) -> dict[str, object]:
    """The parameters of the command that the words call; nothing is run."""
    command, context = parser(), None
    while isinstance(command, typer.core.TyperGroup):
        if not words or words[0].startswith("-"):
            command.make_context("surfuse", list(words) or ["doctor"], parent=context)
            return {}
        name, words = words[0], words[1:]
        assert name in command.commands, f"there is no command '{name}'"
        command = command.commands[name]
    return command.make_context(name, list(words), resilient_parsing=False).params


def test_there_are_commands_to_check():
    found = commands()
    assert len(found) > 30
    assert {"README.md", "docs/tutorial.md", "docs/how-to/own_log.md"} <= {page for page, _ in found}


@pytest.mark.parametrize(("page", "line"), commands())
def test_a_printed_command_is_accepted(page, line, tmp_path, monkeypatch):
    words = shlex.split(line)[1:]
    wrong, parameters = "", {}
    try:
        parameters = parsed([word for word in words if word != cli.DEBUG])
    except typer.Exit:
        return  # --help and --version
    except cli.ClickUsageError as error:
        wrong = error.format_message()
    # Inline code may name a command without its arguments, and give LETTERS for numbers.
    if wrong and not wrong.startswith("Missing "):
        assert PLACEHOLDER.search(line), wrong
        assert wrong.startswith("Invalid value"), wrong
    if parameters.get("assignments"):
        load(None, parameters["assignments"])
    scene = parameters.get("scene")
    assert scene is None or scene in SCENES or Path(scene).suffix in (".stl", ".ply", ".obj")
    method = parameters.get("method")
    if method is not None and method not in ("NAME", "my_method", "steady") and words[0] in ("acquire", "fuse"):
        registry.load("fusion", str(method))


def test_the_check_finds_what_is_wrong():
    for line in ("aquire", "acquire --sed 3", "fuse a b c", "export one"):
        with pytest.raises((AssertionError, cli.ClickUsageError)):
            parsed(shlex.split(line))
    with pytest.raises(SurfuseError):
        load(None, ["scan.stpe_m=1"])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_between_pages_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text("utf-8")):
        if "://" not in target and not target.startswith("mailto:"):
            assert (page.parent / target).exists(), target
