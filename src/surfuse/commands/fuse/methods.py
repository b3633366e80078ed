"""Fusion methods by name, with parameters from the configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from types import ModuleType

from surfuse import registry
from surfuse.errors import ConfigError, nearest
from surfuse.interfaces import FusionMethod
from surfuse.settings import FusionSettings, Plain, Settings, load


def create_method(settings: FusionSettings, name: str | None = None) -> FusionMethod:
    """The fusion method of the configuration, or another one by name with its parameters from there.

    Raises
    ------
    UsageError : no such method.
    ConfigError : unknown parameter, wrong type, value out of its limits; or parameters of an unknown method.
    """
    for unknown in set(settings.parameters) - set(registry.names("fusion")):
        raise ConfigError(
            f"fusion.parameters.{unknown}: there is no such method", cure=nearest(unknown, registry.names("fusion"))
        )
    for method_name, values in settings.parameters.items():
        # Also of methods that do not run now: a misspelt parameter must not wait until they do.
        _parameters(registry.load("fusion", method_name), method_name, values)
    chosen = name or settings.method
    module = registry.load("fusion", chosen)
    method: FusionMethod = module.create(_parameters(module, chosen, settings.parameters.get(chosen, {})))
    return method


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


def method_lines() -> list[tuple[str, str]]:
    """Name and summary of every fusion method."""
    return [(name, str(registry.load("fusion", name).SUMMARY)) for name in registry.names("fusion")]


def _parameters(module: ModuleType, method: str, values: Mapping[str, Plain]) -> object:
    known = {field.name: field for field in fields(module.Parameters)}
    for key, value in values.items():
        where = f"fusion.parameters.{method}.{key}"
        if key not in known:
            raise ConfigError(f"unknown key '{where}'", cure=nearest(key, known))
        default = known[key].default
        wanted = (int, float) if isinstance(default, float) else type(default)
        if not isinstance(value, wanted) or (isinstance(value, bool) and not isinstance(default, bool)):
            kind = "number" if isinstance(default, float) else type(default).__name__
            raise ConfigError(f"{where} = {value!r}", cure=f"give a {kind}, for example {default!r}")
    return module.Parameters(**values)
