"""All plug-ins of a kind with their summaries; what cannot be used, and why.

A plug-in of another package is imported in a process of its own first, with a time limit: one that blocks, ends the
program or crashes is named and left out.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint

from surfuse.errors import ConfigError
from surfuse.extras import install_command, installed
from surfuse.registry.folders import NOUNS, found, load, owner

LIMIT_S = 30.0
_CHILD = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from surfuse.registry.probe import tell; "
    "tell(*sys.argv[2:])"
)
MARK = "surfuse plug-in: "


@dataclass(frozen=True)
class Listed:
    """A plug-in: its one line, the suffixes of its files (formats), and what it still needs (empty: nothing)."""

    name: str
    summary: str
    suffixes: tuple[str, ...] = ()
    needs: str = ""


@dataclass(frozen=True)
class Listing:
    """The plug-ins of a kind in the order of their names, and one line on each that is left out."""

    plug_ins: tuple[Listed, ...]
    left_out: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all that can be loaded."""
        return tuple(one.name for one in self.plug_ins)


@cache
def listing(kind: str) -> Listing:
    """Every plug-in of a kind, imported once."""
    here = found(kind)
    probes = {name: _start(kind, point) for name, point in here.others.items()}
    listed = [_built_in(kind, name) for name in here.built_in]
    left_out = list(here.refused)
    give_up_s = time.monotonic() + LIMIT_S
    for name, probe in probes.items():
        answer = _answer(probe, max(0.0, give_up_s - time.monotonic()))
        if isinstance(answer, Listed):
            listed.append(answer)
        else:
            left_out.append(f"{NOUNS[kind]} '{name}' of {owner(here.others[name])} is left out: {answer}")
    return Listing(tuple(sorted(listed, key=lambda one: one.name)), tuple(left_out))


def _built_in(kind: str, name: str) -> Listed:
    try:
        module = load(kind, name)
    except ConfigError as error:
        return Listed(name, "", needs=str(error))
    missing = next((package for package in getattr(module, "NEEDS", ()) if not installed(package)), "")
    needs = f"needs the package '{missing}', which is not installed; {install_command(missing)}" if missing else ""
    return Listed(name, module.SUMMARY, getattr(module, "SUFFIXES", ()), needs)


def _start(kind: str, point: EntryPoint) -> subprocess.Popen[str] | str:
    """Begin to import a plug-in in another process; or why that cannot be done."""
    try:
        return subprocess.Popen(
            [sys.executable, "-c", _CHILD, json.dumps(sys.path), kind, point.name, point.value, f"surfuse.{kind}"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            encoding="utf-8",
            errors="replace",
        )
    except OSError as error:
        return f"it cannot be looked at ({error})"


def _answer(probe: subprocess.Popen[str] | str, limit_s: float) -> Listed | str:
    """What the other process says of the plug-in; or what is wrong with it."""
    if isinstance(probe, str):
        return probe
    with probe:
        try:
            said, _ = probe.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            probe.kill()
            return f"it was not imported within {LIMIT_S:g} s"
    lines = [line.removeprefix(MARK) for line in said.splitlines() if line.startswith(MARK)]
    if not lines:
        return f"it ended the program that imported it (status {probe.returncode})"
    told = json.loads(lines[-1])
    if told["wrong"]:
        return str(told["wrong"])
    return Listed(str(told["name"]), str(told["summary"]), tuple(map(str, told["suffixes"])))
