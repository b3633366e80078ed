import numpy as np
import pytest

from surfuse.report.colours import ANCHORS, CATEGORIES, anchors, colourise


def lightness(rgb):
    """CIE 1976 L* of sRGB colours (..., 3) in 0..255, after IEC 61966-2-1."""
    value = np.asarray(rgb, dtype=float) / 255.0
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    y = linear @ np.array([0.2126, 0.7152, 0.0722])
    return np.where(y > (6 / 29) ** 3, 116 * np.cbrt(y) - 16, y * (29 / 3) ** 3)


@pytest.mark.parametrize("name", ["viridis", "magma", "cividis"])
def test_sequential_maps_gain_lightness_evenly(name):
    steps = np.diff(lightness(anchors(name)))
    assert np.all(steps > 0)
    assert steps.max() < 2.0 * steps.mean()


def test_diverging_map_is_lightest_in_the_middle_and_falls_to_both_sides():
    light = lightness(anchors("diverging"))
    assert np.argmax(light) == 8
    assert np.all(np.diff(light[:9]) > 0)
    assert np.all(np.diff(light[8:]) < 0)
    assert abs(light[0] - light[-1]) < 5


def test_all_maps_have_seventeen_anchors_and_categories_differ():
    assert {len(anchors(name)) for name in ANCHORS} == {17}
    assert len(set(CATEGORIES)) == len(CATEGORIES) == 8


def test_colourise_hits_the_ends_clips_beyond_and_greys_nan():
    colours = colourise(np.array([0.0, 1.0, -5.0, 9.0, np.nan, 0.5]), 0.0, 1.0)
    table = np.array(anchors("viridis"))
    assert np.array_equal(colours[[0, 2]], table[[0, 0]])
    assert np.array_equal(colours[[1, 3]], table[[-1, -1]])
    assert np.array_equal(colours[4], [150, 150, 150])
    assert np.array_equal(colours[5], table[8])


def test_colourise_of_a_constant_is_defined():
    assert colourise(np.full((2, 3), 4.0), 4.0, 4.0).shape == (2, 3, 3)
