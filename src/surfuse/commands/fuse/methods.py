"""Fusion methods by name, with parameters from the configuration."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from surfuse import registry
from surfuse.errors import ConfigError, nearest
from surfuse.interfaces import FusionMethod
from surfuse.settings import FusionSettings, Settings, load


def create_method(settings: FusionSettings, name: str | None = None) -> FusionMethod:
    """The fusion method of the configuration, or another one by name with its parameters from there.

    Raises
    ------
    UsageError : no method of that name.
    ConfigError : the configuration names no method that there is; unknown parameter, wrong type, value out of its
        limits; or parameters of an unknown method.
    """
    if name is None and settings.method not in registry.names("fusion"):
        cure = nearest(settings.method, registry.names("fusion"))
        raise ConfigError(f"fusion.method = '{settings.method}': there is no such method", cure=cure)
    for unknown in set(settings.parameters) - set(registry.names("fusion")):
        raise ConfigError(
            f"fusion.parameters.{unknown}: there is no such method", cure=nearest(unknown, registry.names("fusion"))
        )
    for method_name, values in settings.parameters.items():
        # Also of methods that do not run now: a misspelt parameter must not wait until they do.
        registry.parameters("fusion", method_name, values, f"fusion.parameters.{method_name}")
    chosen = name or settings.method
    values = settings.parameters.get(chosen, {})
    parameters = registry.parameters("fusion", chosen, values, f"fusion.parameters.{chosen}")
    method: FusionMethod = registry.load("fusion", chosen).create(parameters)
    return method


def usable_methods(warn: Callable[[str], None]) -> tuple[str, ...]:
    """Names of all fusion methods; `warn` is told of each that another package brings and that cannot be used."""
    listing = registry.listing("fusion")
    for line in listing.left_out:
        warn(line)
    return listing.names


def fusion_settings(overrides: Sequence[str], command: str, method_counts: bool = True) -> Settings:
    """The settings of a command that only fuses; `method_counts` is false where every method runs.

    Raises
    ------
    ConfigError : an override that this command does nothing with, or that is none.
    """
    settings = load(None, overrides)
    for text in overrides:
        key = text.partition("=")[0].strip()
        if key.split(".")[0] not in ("fusion", "seed"):
            raise ConfigError(
                f"--set {key}: 'surfuse {command}' does not use it, the readings are what they are",
                cure="only fusion.* counts here; acquire again to change how a scan is made",
            )
        if key == "fusion.method" and not method_counts:
            raise ConfigError(f"--set {key}: 'surfuse {command}' runs every method", cure="leave it out")
    return settings


def method_lines(warn: Callable[[str], None]) -> list[tuple[str, str]]:
    """Name and summary of every fusion method; `warn` as in `usable_methods`."""
    usable_methods(warn)
    return [(one.name, one.summary) for one in registry.listing("fusion").plug_ins]
