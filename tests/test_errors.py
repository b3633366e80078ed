"""Errors: one exit status each, messages with where, what and cure."""

from __future__ import annotations

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surfuse import errors
from surfuse.errors import ConfigError, DataError, SurfuseError, nearest

KINDS = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, SurfuseError)]


def test_exit_statuses_are_those_of_the_contract():
    statuses = {kind.__name__: kind.exit_status for kind in KINDS}
    assert statuses == {
        "SurfuseError": 1,
        "UsageError": 2,
        "ConfigError": 3,
        "DataError": 3,
        "DeviceError": 4,
        "SafetyStopError": 5,
        "UnreachableError": 5,
        "StorageError": 6,
        "InterruptError": 130,
    }


@pytest.mark.parametrize("kind", KINDS)
def test_a_message_has_where_what_and_cure_in_this_order(kind):
    assert str(kind("seed = -1", where="cell.toml", cure="give 0 or more")) == "cell.toml: seed = -1; give 0 or more"
    assert str(kind("seed = -1")) == "seed = -1"


@pytest.mark.parametrize("kind", KINDS)
def test_errors_pass_between_processes(kind):
    error = pickle.loads(pickle.dumps(kind("what", cure="cure", where="where")))
    assert type(error) is kind
    assert str(error) == "where: what; cure"


def test_bad_data_and_bad_configuration_are_told_apart():
    assert not issubclass(DataError, ConfigError)
    assert not issubclass(ConfigError, DataError)


def test_the_nearest_name_is_proposed_and_all_are_listed():
    assert nearest("reliev", ["tilted", "relief", "flat"]) == "did you mean 'relief'? valid: flat, relief, tilted"
    assert nearest("fx", ["fx_px", "fixed"]).startswith("did you mean 'fx_px'?")
    assert nearest("tfminiplus", ["tfmini", "tfmini-plus"]).startswith("did you mean 'tfmini-plus'?")
    assert nearest("cube", ["tilted", "relief", "flat"]) == "valid: flat, relief, tilted"


@given(st.lists(st.text(max_size=20), max_size=8), st.text(max_size=20))
def test_what_is_proposed_is_valid(valid, name):
    text = nearest(name, valid)
    if text.startswith("did you mean '"):
        assert any(text.startswith(f"did you mean '{one}'?") for one in valid)
