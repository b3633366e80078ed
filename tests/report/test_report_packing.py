import base64

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surfuse.report.packing import KINDS, pack, pack_share, stride_for, thinned


def unpack(packed, n):
    """What the page's script does with packed numbers."""
    if packed["t"] == "c":
        values = np.full(n, np.nan if packed["v"] is None else packed["v"])
    else:
        values = np.frombuffer(base64.b64decode(packed["b"]), dtype=KINDS[packed["t"]])
    if "s" not in packed:
        return values
    return np.where(values == 65535, np.nan, packed["s"] * values / 65534.0)


@pytest.mark.parametrize("values", [[1.5, np.nan, -2.0], [np.inf, np.inf], [np.nan, np.nan], [0.25, 0.25], [-np.inf]])
def test_floats_come_back(values):
    assert np.array_equal(unpack(pack(values, "f4"), len(values)), np.float32(values), equal_nan=True)


def test_integers_come_back_and_constants_are_one_number():
    assert np.array_equal(unpack(pack([0, 7, 65535], "u2"), 3), [0, 7, 65535])
    assert pack(np.full(1000, 4), "u1") == {"t": "c", "v": 4.0}


@given(st.lists(st.floats(0, 1) | st.just(float("nan")), min_size=1, max_size=30))
def test_shares_come_back_to_the_last_step(values):
    back = unpack(pack_share(values), len(values))
    assert np.array_equal(np.isnan(back), np.isnan(values))
    assert np.nanmax(np.abs(back - np.array(values)), initial=0.0) <= 0.5 / 65534 + 1e-12


@given(st.integers(1, 5000), st.integers(1, 5000))
def test_thinning_keeps_both_ends_and_the_budget(count, most):
    stride = stride_for(count, most)
    index = thinned(count, stride)
    assert index[0] == 0
    assert index[-1] == count - 1
    assert np.all(np.diff(index) > 0)
    assert len(index) <= most + 1
    assert stride == 1 or count > most


def test_thinning_two_axes_keeps_the_budget_of_nodes():
    stride = stride_for(1000 * 1000, 5000, 2)
    assert len(thinned(1000, stride)) ** 2 < 5000 * 1.1
