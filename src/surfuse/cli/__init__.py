"""The command line: one file a command, no logic.

Nothing heavy is imported here, so that `surfuse --help` answers at once: every command imports its work when it runs.
"""

from __future__ import annotations

import importlib
import pkgutil
import sys

import typer
from typer.core import TyperGroup

from surfuse import __version__
from surfuse.errors import SurfuseError

INTERRUPTED = 130


class _Commands(TyperGroup):
    """Turns errors into one clear line and the exit status of the contract."""

    def invoke(self, ctx: typer.Context) -> object:  # type: ignore[override]
        try:
            return super().invoke(ctx)
        except SurfuseError as error:
            _fail(str(error), error.exit_status, error)
        except KeyboardInterrupt as error:
            _fail("interrupted; what was scanned is on disk: surfuse resume RUN goes on", INTERRUPTED, error)
        except BrokenPipeError:
            sys.stderr.close()
            sys.exit(0)
        except (OSError, MemoryError) as error:
            _fail(f"{type(error).__name__}: {error}", 6, error)
        except (ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError) as error:
            _fail(f"internal error: {type(error).__name__}: {error}; run again with --debug and report it", 1, error)
        return None


def _fail(message: str, status: int, error: BaseException) -> None:
    if DEBUG.enabled:
        raise error
    print(f"surfuse: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(status)


class _Debug:
    enabled = False


DEBUG = _Debug()

app = typer.Typer(
    cls=_Commands,
    name="surfuse",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
    help=(
        "A surface profiler from a robot arm, a camera and cheap range sensors.\n\n"
        "Start with: **surfuse acquire** (the simulated cell) or **surfuse fuse readings.csv** (a log of your own).\n\n"
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
    debug: bool = typer.Option(False, "--debug", help="Show tracebacks."),
) -> None:
    DEBUG.enabled = debug


def _register() -> None:
    """Every module of this folder registers its command under its own name."""
    for module in sorted(entry.name for entry in pkgutil.iter_modules(__path__)):
        if not module.startswith("_"):
            importlib.import_module(f"{__name__}.{module}").register(app)


def main() -> None:
    """Entry point of the console script."""
    _register()
    app()
