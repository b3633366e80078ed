"""Options that several commands share, and how results are printed."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from surfuse.cli._numbers import PORT_MAX, Real, Whole
from surfuse.errors import UsageError, nearest

Out = Annotated[Path | None, typer.Option("--out", help="Folder of the run; it must not exist yet.")]
Cell = Annotated[Path | None, typer.Option("--cell", help="Cell file (TOML); default: the simulated reference cell.")]
Method = Annotated[str | None, typer.Option("--method", help="Fusion method; 'surfuse methods' lists them.")]
Set = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY.PATH=VALUE", help="Override one value; may be repeated.")
]
Seed = Annotated[int | None, typer.Option("--seed", help="Seed of everything that is random.")]
"""Its limits are those of the configuration, where it may also stand in a file."""
ArmFile = Annotated[
    Path | None, typer.Option("--arm", metavar="FILE", help="MJCF or URDF file of another arm; default: the PUMA 560.")
]
Tool = Annotated[
    str | None, typer.Option("--tool", metavar="FRAME", help="Site, body or link of that file that carries the array.")
]
ArmDriver = Annotated[
    str | None,
    typer.Option("--arm-driver", metavar="NAME", help="trident: servo cards and dynamics; kinematic: faster, none."),
]
Scale = Annotated[
    float,
    typer.Option(
        "--scale", metavar="FACTOR", help="Factor on a truth mesh's numbers, 0.001 for mm.", parser=Real(1e-9, 1e9)
    ),
]
TruthFrame = Annotated[
    Literal["auto", "world", "part"],
    typer.Option(
        "--truth-frame",
        help="Frame of the truth: world (of the readings), part (of the map); auto: what the file says, else world.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout, nothing else there.")]
Yes = Annotated[bool, typer.Option("--yes", help="Agree to the first move of a real arm without being asked.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no table.")]
View = Annotated[bool, typer.Option("--view", help="Show the scan live on a page of this computer; look only.")]
ViewPort = Annotated[
    int,
    typer.Option(
        "--view-port",
        help="Port of that page on 127.0.0.1; 0: any free one.",
        parser=Whole(0, PORT_MAX),
        metavar="PORT",
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace the output file if it exists.")]


def overrides(assignments: list[str] | None, method: str | None, seed: int | None) -> list[str]:
    """`--set` values with the options that have a name of their own; these win.

    Raises
    ------
    UsageError : there is no method of that name.
    """
    texts = list(assignments or [])
    for text in texts:
        key, _, value = text.partition("=")
        if key.strip() == "fusion.method":
            _check_method(value.strip().strip("'" + '"'), text)
    if method is not None:
        _check_method(method, f"--method {method}")
        texts.append(f"fusion.method={toml_string(method)}")
    if seed is not None:
        texts.append(f"seed={seed}")
    return texts


def _check_method(name: str, given: str) -> None:
    from surfuse import registry

    known = registry.names("fusion")
    if name not in known:
        raise UsageError(f"{given}: there is no method '{name}'", cure=nearest(name, known))


def check_scene(name: str) -> None:
    """Refuse what is neither a built-in scene nor the name of a mesh file.

    Raises
    ------
    UsageError : with the nearest scene.
    """
    from surfuse.geometry.mesh_files import SUFFIXES
    from surfuse.settings import SCENES

    if Path(name).suffix.lower() == ".toml":
        raise UsageError(f"'{name}' is no scene", cure=f"a cell file is given as --cell {name}")
    if name not in SCENES and Path(name).suffix.lower() not in SUFFIXES:
        raise UsageError(
            f"unknown scene '{name}'", cure=f"{nearest(name, SCENES)}; or a mesh file ({', '.join(SUFFIXES)})"
        )


def arm_overrides(file: Path | None, tool: str | None, driver: str | None) -> list[str]:
    """The options of the arm as `--set` values."""
    given = {"arm.file": None if file is None else str(file), "arm.tool": tool, "arm.driver": driver}
    return [f"{key}={toml_string(value)}" for key, value in given.items() if value is not None]


def print_json(result: object) -> None:
    """Print one JSON document; numbers that JSON lacks become null."""
    from surfuse.commands.outcome import finite

    json.dump(finite(result), sys.stdout, indent=2, allow_nan=False)
    print()


def print_table(rows: list[tuple[str, str]]) -> None:
    """Print label and value pairs in two columns."""
    width = max((len(label) for label, _ in rows), default=0)
    for label, value in rows:
        print(f"{label:<{width}}  {value}")


def note(text: str) -> None:
    """Something that the user should know, not an error: one line on stderr."""
    print(f"surfuse: note: {text}", file=sys.stderr)


def toml_string(text: str) -> str:
    """A text as a TOML basic string."""
    return json.dumps(text, ensure_ascii=False)


def show(
    summary: dict[str, object], table: list[tuple[str, str]], as_json: bool, quiet: bool, complete: bool = True
) -> int:
    """Print the result one way, and give the exit status: 130 for an interrupted but resumable run."""
    if as_json:
        print_json(summary)
    elif not quiet:
        print_table(table)
    return 0 if complete else 130
