"""Every number of the command line is read one way: finite, and within limits that are told."""

from __future__ import annotations

import inspect
import pkgutil
from typing import get_args

import pytest
import typer

from surfuse import cli
from surfuse.cli._numbers import Real, Whole

READ_LATER = {("--seed", "the configuration has its limits"), ("U", "`why` names the place"), ("V", "`why` names it")}


def numbers():
    """(command, parameter, its typer description) of every int and float."""
    cli._register()
    groups = [group.typer_instance for group in cli.app.registered_groups]
    for program in (cli.app, *groups):
        for command in program.registered_commands:
            for name, one in inspect.signature(command.callback, eval_str=True).parameters.items():
                kind, *more = get_args(one.annotation) or (one.annotation,)
                if {kind, *get_args(kind)} & {int, float}:
                    yield command.name, name, more[0]


def test_no_number_is_read_without_limits():
    assert list(pkgutil.iter_modules(cli.__path__))
    later = {name for name, _ in READ_LATER}
    found = list(numbers())
    assert len(found) > 20
    for command, name, option in found:
        shown = {*(option.param_decls or ()), option.default, option.metavar}
        assert isinstance(option.parser, Real | Whole) or shown & later, (command, name)


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "1e999", "", "many", "1,5", "0x10"])
def test_what_is_no_finite_number_is_refused_with_the_limits(text):
    for reader in (Real(0.0, 5.0), Whole(0, 5)):
        with pytest.raises(typer.BadParameter, match="from 0 to 5"):
            reader(text)


@pytest.mark.parametrize(("reader", "good", "bad"), [(Real(0.5, 5.0), 0.5, 0.49), (Real(0.5, 5.0, above=True), 5, 0.5),
                                                     (Whole(1, 7), 7, 8), (Whole(1, 7), 1, 0)])  # fmt: skip
def test_limits_are_inside(reader, good, bad):
    assert reader(str(good)) == good
    with pytest.raises(typer.BadParameter, match=f"^{bad} is out of its limits"):
        reader(str(bad))


@pytest.mark.parametrize("words", [("record", "--cell", "x", "--minutes", "inf"), ("bridge", "--port", "-1"),
                                   ("node", "--id", "9"), ("view", "x", "--port", "70000")])  # fmt: skip
def test_a_command_says_which_option(command, words):
    command(*words).error(2, words[-2], words[-1])
