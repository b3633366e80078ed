"""Measures of a division: closed forms and laws."""

import numpy as np
import pytest

from surfuse.errors import ConfigError, DataError
from surfuse.vision.measures import foreground_area_error, misclassification_error, region_non_uniformity
from surfuse.vision.polarity import foreground, named_polarity

TRUTH = np.zeros((10, 20), dtype=bool)
TRUTH[2:6, 5:15] = True  # 40 of 200 pixels


def test_perfect_division_has_no_error():
    image = np.where(TRUTH, 200, 50).astype(np.uint8)
    assert misclassification_error(TRUTH, TRUTH) == 0.0
    assert foreground_area_error(TRUTH, TRUTH) == 0.0
    assert region_non_uniformity(image, TRUTH) == 0.0


def test_known_counts():
    found = TRUTH.copy()
    found[2, 5:10] = False  # 5 missed
    found[9, :] = True  # 20 wrong
    assert misclassification_error(found, TRUTH) == pytest.approx(25 / 200)
    assert foreground_area_error(found, TRUTH) == pytest.approx(15 / 55)
    assert foreground_area_error(TRUTH, found) == pytest.approx(15 / 55)


def test_swapped_classes_are_as_wrong_as_can_be():
    assert misclassification_error(~TRUTH, TRUTH) == 1.0
    assert foreground_area_error(np.zeros_like(TRUTH), TRUTH) == 1.0
    assert foreground_area_error(np.zeros_like(TRUTH), np.zeros_like(TRUTH)) == 0.0


def test_non_uniformity_is_one_when_the_foreground_is_everything():
    image = np.random.default_rng(0).integers(0, 256, TRUTH.shape).astype(np.uint8)
    assert region_non_uniformity(image, np.ones_like(TRUTH)) == pytest.approx(1.0)
    assert region_non_uniformity(image, TRUTH) == pytest.approx(0.2 * image[TRUTH].var() / image.var())
    assert region_non_uniformity(np.full(TRUTH.shape, 7, np.uint8), TRUTH) == 0.0


def test_other_sizes_are_refused():
    with pytest.raises(DataError, match="20 x 10 pixels, the picture 10 x 20"):
        misclassification_error(TRUTH, TRUTH.T)
    with pytest.raises(DataError, match="pixels"):
        region_non_uniformity(TRUTH.T.astype(np.uint8), TRUTH)


def test_foreground_is_the_class_unlike_the_rim():
    image = np.where(TRUTH, 200, 50).astype(np.uint8)
    assert np.array_equal(foreground(image, 100, "auto"), TRUTH)
    assert np.array_equal(foreground(255 - image, 100, "auto"), TRUTH)
    assert np.array_equal(foreground(image, 100, "dark"), ~TRUTH)
    with pytest.raises(ConfigError, match="did you mean 'bright'"):
        named_polarity("brigth")
