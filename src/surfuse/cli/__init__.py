"""The command line: one file a command, no logic.

Nothing heavy is imported here, so that `surfuse --help` answers at once: every command imports its work when it runs.
"""

from __future__ import annotations

import functools
import importlib
import inspect
import io
import os
import pkgutil
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from typing import NoReturn, ParamSpec, TypeVar

import typer

from surfuse import __version__
from surfuse.durable import ExistingFileError
from surfuse.errors import InterruptError, StorageError, SurfuseError, UsageError, nearest
from surfuse.extras import missing_package

P = ParamSpec("P")
T = TypeVar("T")
INTERRUPTED = 130
DEBUG = "--debug"
ClickUsageError: type[typer.BadParameter] = typer.BadParameter.__mro__[1]  # wherever typer keeps click

app = typer.Typer(
    name="surfuse",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help=(
        "A surface profiler from a robot arm, a camera and cheap range sensors.\n\n"
        "Start with: surfuse acquire (the simulated cell) or surfuse fuse readings.csv (a log of your own).\n\n"
        "surfuse has no safety function; stops belong to the robot's controller."
    ),
)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"surfuse {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Print the version."),
    debug: bool = typer.Option(False, DEBUG, help="Show a traceback with an error (any position)."),
) -> None:
    """Options before the command."""


def _register() -> None:
    """Every module of this folder registers its command under its own name, once a process."""
    if app.registered_commands:
        return
    for module in sorted(entry.name for entry in pkgutil.iter_modules(__path__)):
        if not module.startswith("_"):
            importlib.import_module(f"{__name__}.{module}").register(app)
    groups = [group.typer_instance for group in app.registered_groups if group.typer_instance is not None]
    for command in [entry for program in (app, *groups) for entry in program.registered_commands]:
        if command.callback is not None:
            command.callback = _tells_interrupts(command.callback)


def _tells_interrupts(work: Callable[P, T]) -> Callable[P, T]:
    """The same command, with Ctrl-C as an error that is told: typer ends silently."""

    @functools.wraps(work)
    def told(*arguments: P.args, **options: P.kwargs) -> T:
        try:
            return work(*arguments, **options)
        except KeyboardInterrupt as error:
            raise InterruptError("interrupted") from error

    return told


def _checked(arguments: list[str]) -> list[str]:
    """The arguments, with the help of a group that is given alone; a misspelt command names the nearest one.

    Raises
    ------
    UsageError : there is no such command.
    """
    names = [command.name for command in app.registered_commands if command.name]
    names += [group.name for group in app.registered_groups if group.name]
    words = [argument for argument in arguments if not argument.startswith("-")]
    if words and words[0] not in names:
        raise UsageError(f"unknown command '{words[0]}'", cure=nearest(words[0], names))
    for group in app.registered_groups:
        if words and words[0] == group.name and group.typer_instance is not None:
            inner = [entry.name for entry in group.typer_instance.registered_commands if entry.name]
            if len(arguments) == 1:
                return [*arguments, "--help"]
            if len(words) > 1 and words[1] not in inner:
                raise UsageError(f"unknown command '{group.name} {words[1]}'", cure=nearest(words[1], inner))
    return arguments


def _in_words(message: str, names: tuple[str, ...], arguments: list[str]) -> str:
    """What is wrong with the command line, with the value that was given to the option of these names."""
    text = message.replace("Value error, ", "").replace(", unable to parse string as an integer", "")
    text = text.replace(", unable to parse string as a number", "").rstrip(".")
    option = next((name for name in names if name in arguments[:-1]), None)
    given = arguments[arguments.index(option) + 1] if option is not None else ""
    value = f" (given: '{given}')" if given and f"'{given}'" not in text else ""
    return f"{text}{value}; try 'surfuse {_command_of(arguments)}--help'"


def _command_of(arguments: list[str]) -> str:
    groups = [group.name for group in app.registered_groups]
    words = [argument for argument in arguments if not argument.startswith("-")]
    return "".join(f"{word} " for word in words[: 2 if words and words[0] in groups else 1])


def _forces(arguments: list[str]) -> bool:
    """Whether the command of the line can be told to replace a file."""
    words = [argument for argument in arguments if not argument.startswith("-")]
    groups = {group.name: group.typer_instance for group in app.registered_groups}
    program, name = (groups.get(words[0]) or app, words[1:2] if words[0] in groups else words[:1])
    found = [entry.callback for entry in program.registered_commands if [entry.name] == name]
    return any(callback is not None and "force" in inspect.signature(callback).parameters for callback in found)


def main() -> None:
    """Entry point of the console script: one clear line and the exit status of the contract for every error."""
    arguments = [argument for argument in sys.argv[1:] if argument != DEBUG] or ["--help"]
    stdout = sys.stdout
    _print_anything()
    try:
        _register()
        arguments = _checked(arguments)
        outcome = app(args=arguments, standalone_mode=False)
        # A pipe that was closed or a disk that is full shows only now, while it still can be told.
        sys.stdout.flush()
        sys.exit(outcome if isinstance(outcome, int) else 0)
    except SystemExit as ended:
        # Typer swaps stdout and exits with 1 when a reader stops reading, which is no error.
        sys.exit(ended.code if sys.stdout is stdout else 0)
    except ExistingFileError as error:
        _fail(str(error.asked_by("--force") if _forces(arguments) else error), error.exit_status, error)
    except SurfuseError as error:
        _fail(str(error), error.exit_status, error)
    except ClickUsageError as error:
        option = error.param if isinstance(error, typer.BadParameter) else None
        _fail(_in_words(error.format_message(), tuple(option.opts) if option else (), arguments), 2, error)
    except (typer.Abort, KeyboardInterrupt) as error:
        _fail("interrupted", INTERRUPTED, error)
    except ModuleNotFoundError as error:
        missing = missing_package(error, "this")
        _fail(str(missing), missing.exit_status, error)
    except BrokenPipeError:
        _drop_output()
        sys.exit(0)
    except (OSError, MemoryError) as error:
        _drop_output()
        _fail(f"{type(error).__name__}: {error}", StorageError.exit_status, error)
    except Exception as error:
        _fail(f"internal error: {type(error).__name__}: {error}; run again with {DEBUG} and report it", 1, error)


def _print_anything() -> None:
    """A console or pipe that lacks a character, as those of Windows may, gets a question mark instead of an error."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _drop_output() -> None:
    """What is left in the buffer cannot be written any more: the interpreter must not try it again at its end."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fail(message: str, status: int, error: BaseException) -> NoReturn:
    if DEBUG in sys.argv:
        traceback.print_exception(error)
    print(f"surfuse: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(status)
