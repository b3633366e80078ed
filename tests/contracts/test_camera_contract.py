"""What every camera does, whatever drives it: each against its stand-in."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from plug_in_bench import CameraBench, nothing_opened, opened_bench

from surfuse import registry
from surfuse.errors import DataError, DeviceError
from surfuse.records import CameraModel


@pytest.fixture(params=registry.found("cameras").built_in)
def name(request) -> str:
    return request.param


@pytest.fixture
def bench(name, tmp_path) -> Iterator[CameraBench]:
    with opened_bench("cameras", name, tmp_path) as made:
        yield made


@pytest.fixture
def create(name):
    return registry.load("cameras", name).create


def assert_picture(image: np.ndarray, model: CameraModel) -> None:
    assert image.dtype == np.uint8
    assert image.shape == (model.height_px, model.width_px)


def test_making_one_opens_nothing(bench, create):
    with nothing_opened():
        assert create(bench.parameters).model == bench.parameters.surroundings.model


def test_pictures_have_the_size_of_the_model_and_times_that_go_forward(bench, create):
    with create(bench.parameters) as camera:
        (first, first_s), (second, second_s) = camera.capture(), camera.capture()
        for image in (first, second):
            assert_picture(image, camera.model)
    assert second_s > first_s
    assert np.isfinite([first_s, second_s]).all()


def test_closing_twice_is_fine_and_it_opens_again(bench, create):
    camera = create(bench.parameters)
    with camera:
        camera.capture()
    camera.__exit__(None, None, None)
    with camera:
        assert_picture(camera.capture()[0], camera.model)


def test_one_that_is_not_open_is_a_device_error(bench, create):
    if not bench.always_open:
        with pytest.raises(DeviceError, match="open"):
            create(bench.parameters).capture()


def test_one_that_vanishes_is_a_device_error_and_so_is_one_that_is_not_there(bench, create):
    if bench.vanish is None:
        return
    with create(bench.parameters) as camera:
        camera.capture()
        bench.vanish()
        with pytest.raises((DeviceError, DataError)):
            [camera.capture() for _ in range(5)]
    with pytest.raises(DeviceError) as caught, create(bench.parameters):
        pass
    assert caught.value.cure
