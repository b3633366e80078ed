"""What every plug-in module has, whatever its kind; and that every device and control law has a bench."""

from __future__ import annotations

import dataclasses
import inspect
import sys
import typing
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from plug_in_bench import names_of, opened_bench

from surfuse import registry
from surfuse.interfaces import GIVEN_BY_RIG

BENCHED = ("arms", "cameras", "control_laws", "sensors")
DEVICES = [(kind, name) for kind in BENCHED for name in registry.found(kind).built_in]
MADE = [*DEVICES, *(("fusion", name) for name in registry.found("fusion").built_in)]


@pytest.mark.parametrize("kind", BENCHED)
def test_every_built_in_plug_in_has_a_bench(kind):
    assert names_of(kind) == set(registry.found(kind).built_in)


@pytest.mark.parametrize(("kind", "name"), MADE)
def test_the_module_has_one_line_parameters_and_create(kind, name):
    module = registry.load(kind, name)
    assert isinstance(module.SUMMARY, str)
    assert 0 < len(module.SUMMARY) <= 110
    assert "\n" not in module.SUMMARY
    assert dataclasses.is_dataclass(module.Parameters)
    assert module.Parameters.__dataclass_params__.frozen
    assert module.Parameters.__doc__
    assert list(inspect.signature(module.create).parameters) == ["parameters"]
    assert typing.get_type_hints(module.create).get("parameters", module.Parameters) is module.Parameters
    assert all(isinstance(package, str) for package in getattr(module, "NEEDS", ()))


@pytest.mark.parametrize(("kind", "name"), MADE)
def test_every_field_is_explained_and_only_the_last_comes_from_the_rig(kind, name):
    module = registry.load(kind, name)
    fields = dataclasses.fields(module.Parameters)
    told = " ".join(str(record.__doc__) for record in module.Parameters.__mro__)
    for field in fields:
        given = bool(field.metadata.get("given_by_rig"))
        assert given == (field.name == "surroundings"), field.name
        assert given or field.name in told, field.name
        assert not given or (field.metadata is GIVEN_BY_RIG or dict(field.metadata) == dict(GIVEN_BY_RIG))
    assert "surroundings" not in [field.name for field in fields[:-1]]
    if kind == "fusion":
        module.Parameters()


@pytest.mark.parametrize(("kind", "name"), DEVICES)
def test_a_file_says_all_that_parameters_say(kind, name, tmp_path):
    with opened_bench(kind, name, tmp_path) as bench:
        parameters = bench.parameters
        read = registry.parameters(kind, name, bench.values, "table", parameters.surroundings)
    assert dataclasses.replace(read, surroundings=parameters.surroundings) == parameters
    assert read.surroundings is parameters.surroundings


@pytest.mark.parametrize(("kind", "name"), DEVICES)
def test_no_file_can_name_the_surroundings(kind, name, tmp_path):
    from surfuse.errors import ConfigError

    with opened_bench(kind, name, tmp_path) as bench, pytest.raises(ConfigError, match=r"unknown key 'table\.surround"):
        registry.parameters(kind, name, {**bench.values, "surroundings": {}}, "table")


# What the table of a sensor says about its place and its beam is read by the rig, for every driver.
OF_THE_RIG = {
    "aperture_m",
    "axis",
    "beam_full_angle_deg",
    "burst_cycles",
    "dead_length_m",
    "driver",
    "frequency_hz",
    "kind",
    "lag_s",
    "name",
    "plugin",
    "position_m",
    "range_max_m",
    "range_min_m",
    "sigma_m",
    "threshold_ratio",
}


@pytest.mark.parametrize("name", registry.found("sensors").built_in)
def test_no_sensor_driver_takes_a_key_of_the_rig(name):
    fields = dataclasses.fields(registry.load("sensors", name).Parameters)
    assert OF_THE_RIG.isdisjoint(field.name for field in fields)
