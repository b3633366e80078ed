"""Which optional package belongs to which extra of the distribution, and what a user is told when one is missing."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from surfuse.errors import ConfigError


@dataclass(frozen=True)
class Extra:
    """One extra: its name in `pip install 'surfuse[name]'`, the modules that it brings, and what they are for."""

    name: str
    modules: tuple[str, ...]
    purpose: str

    @property
    def command(self) -> str:
        """The command that installs it."""
        return f"pip install 'surfuse[{self.name}]'"

    @property
    def missing(self) -> tuple[str, ...]:
        """Its modules that are not installed."""
        return tuple(module for module in self.modules if not installed(module))


EXTRAS = (
    Extra("surface", ("sdfio", "x3pio"), "maps as .sdf and .x3p"),
    Extra("dynamics", ("mujoco",), "arm files, acquire --arm"),
    Extra("closed-form", ("eaik",), "faster inverse kinematics of arm files"),
    Extra("serial", ("serial",), "rangers on a serial port"),
    Extra("gpio", ("gpiozero",), "rangers on pins"),
    Extra("ur", ("rtde_receive",), "arms of Universal Robots"),
    Extra("plot", ("matplotlib",), "plots from Python"),
    Extra("xarray", ("xarray",), "labelled datasets from Python"),
)


def installed(module: str) -> bool:
    """Whether a module can be found, without importing it."""
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def install_command(module: str | None) -> str:
    """The command that brings a missing module: that of its extra, or of this package again when it is no extra's."""
    top = (module or "").partition(".")[0]
    return next((extra.command for extra in EXTRAS if top in extra.modules), "pip install --force-reinstall surfuse")


def missing_package(error: ModuleNotFoundError, what: str, where: str = "") -> ConfigError:
    """The one line about a package that `what` needs and that is not there."""
    return ConfigError(
        f"{what} needs the package '{error.name}', which is not installed",
        cure=install_command(error.name),
        where=where,
    )


@contextmanager
def needed_by(what: str, where: str = "") -> Iterator[None]:
    """Imports inside of the block that fail because a package is missing say what needs it, and how to get it.

    Raises
    ------
    ConfigError : a package is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise missing_package(error, what, where) from error
