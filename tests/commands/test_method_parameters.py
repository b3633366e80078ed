"""Fusion methods by name, with parameters checked before anything runs."""

from __future__ import annotations

from dataclasses import fields

import pytest

from surfuse import registry
from surfuse.commands.fuse.methods import create_method, method_lines
from surfuse.errors import ConfigError, UsageError
from surfuse.settings import FusionSettings

NAMES = registry.names("fusion")


def settings(method: str = "mean", **parameters: dict) -> FusionSettings:
    return FusionSettings(method=method, parameters=parameters)


@pytest.mark.parametrize("name", NAMES)
def test_every_method_is_made_by_its_name(name):
    assert create_method(settings(name)).name == name
    assert create_method(settings("mean"), name).name == name


@pytest.mark.parametrize("name", NAMES)
def test_every_parameter_may_be_set_to_its_default(name):
    module = registry.load("fusion", name)
    plain = {
        field.name: getattr(module.Parameters(), field.name)
        for field in fields(module.Parameters)
        if isinstance(getattr(module.Parameters(), field.name), str | int | float | bool)
    }
    assert create_method(settings(name, **{name: plain})).name == name


@pytest.mark.parametrize("name", NAMES)
def test_every_parameter_is_explained_and_has_a_unit_or_none(name):
    module = registry.load("fusion", name)
    documented = " ".join(str(kind.__doc__) for kind in module.Parameters.__mro__)
    for field in fields(module.Parameters):
        assert field.name in documented, field.name


def test_an_unknown_method_gets_the_nearest():
    """A name in a file is a wrong value of the configuration, one that was asked for is a wrong word."""
    with pytest.raises(ConfigError, match=r"fusion.method = 'medain': .*did you mean 'median'"):
        create_method(FusionSettings(method="medain"))
    with pytest.raises(UsageError, match="did you mean 'median'"):
        create_method(FusionSettings(), "medain")


def test_an_unknown_parameter_gets_the_nearest():
    with pytest.raises(ConfigError, match=r"fusion\.parameters\.weighted_average\.use_dc4'.*did you mean 'use_dc"):
        create_method(settings("weighted_average", weighted_average={"use_dc4": True}))


def test_parameters_of_methods_that_do_not_run_are_checked_too():
    with pytest.raises(ConfigError, match="use_dc4"):
        create_method(settings("mean", weighted_average={"use_dc4": True}))
    with pytest.raises(ConfigError, match="did you mean 'mean'"):
        create_method(settings("mean", maen={}))


@pytest.mark.parametrize("value", ["yes", 1, 0.5])
def test_a_switch_takes_only_true_and_false(value):
    with pytest.raises(ConfigError, match=r"use_dc1 = .*true or false"):
        create_method(settings("weighted_average", weighted_average={"use_dc1": value}))


@pytest.mark.parametrize("value", ["1", True])
def test_a_number_takes_neither_text_nor_a_switch(value):
    with pytest.raises(ConfigError, match=r"change_m = .*number"):
        create_method(settings("weighted_average", weighted_average={"change_m": value}))


def test_a_number_out_of_its_limits_is_refused_by_the_method():
    with pytest.raises(ConfigError, match="change_m"):
        create_method(settings("weighted_average", weighted_average={"change_m": -1.0}))


def test_a_whole_number_may_stand_for_a_length():
    assert create_method(settings("weighted_average", weighted_average={"change_m": 1})).name == "weighted_average"


def test_each_method_has_one_line():
    lines = dict(method_lines(print))
    assert set(lines) == set(NAMES)
    assert all(text and "\n" not in text for text in lines.values())
