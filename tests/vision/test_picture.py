"""Reading pictures: conversions, and one clear error for everything that is none."""

import cv2
import numpy as np
import pytest

from surfuse.errors import DataError
from surfuse.vision.picture import grey, read_picture

RAMP = np.tile(np.arange(0, 240, 8, dtype=np.uint8), (20, 1))


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif"])
def test_grey_bytes_come_back_as_they_are(tmp_path, suffix):
    path = tmp_path / f"ramp{suffix}"
    cv2.imwrite(str(path), RAMP)
    assert np.array_equal(read_picture(path), RAMP)


def test_colour_becomes_luma(tmp_path):
    colour = np.zeros((10, 10, 3), np.uint8)
    colour[:, :, 1] = 200
    cv2.imwrite(str(tmp_path / "green.png"), colour)
    assert read_picture(tmp_path / "green.png") == pytest.approx(np.full((10, 10), 0.587 * 200), abs=1.0)


@pytest.mark.parametrize(
    "wide", [RAMP.astype(np.uint16) * 257, RAMP.astype(np.float32) / 232.0, RAMP.astype(np.int32) - 50, RAMP > 100]
)
def test_other_numbers_are_stretched_to_the_full_range(wide):
    result = grey(wide)
    assert result.dtype == np.uint8
    assert (result.min(), result.max()) == (0, 255)
    assert np.all(np.diff(result[0].astype(int)) >= 0)


def test_sixteen_bit_and_float_files(tmp_path):
    cv2.imwrite(str(tmp_path / "deep.png"), RAMP.astype(np.uint16) * 100)
    cv2.imwrite(str(tmp_path / "float.tiff"), RAMP.astype(np.float32) / 100)
    assert np.array_equal(read_picture(tmp_path / "deep.png"), read_picture(tmp_path / "float.tiff"))


@pytest.mark.parametrize(("shown", "ground"), [(30, 255), (220, 0)])
def test_transparent_places_stand_out_from_what_is_visible(shown, ground):
    picture = np.zeros((12, 12, 4), np.uint8)
    picture[4:8, 4:8] = (shown, shown, shown, 255)
    result = grey(picture)
    assert result[5, 5] == shown
    assert result[0, 0] == ground


def test_sixteen_bit_transparency_keeps_its_meaning():
    picture = np.zeros((12, 12, 4), np.uint16)
    picture[4:8, 4:8] = (10, 10, 10, 65535)
    picture[4, 4, :3] = 0
    result = grey(picture)
    assert result[6, 6] == 255
    assert result[0, 0] == 0


def test_constant_picture_of_floats_is_black():
    assert not grey(np.full((9, 9), 3.5)).any()


@pytest.mark.parametrize(
    ("array", "match"),
    [
        (np.zeros((7, 30), np.uint8), "too small"),
        (np.zeros((0, 0), np.uint8), "too small"),
        (np.zeros((20, 20, 2), np.uint8), "not a picture"),
        (np.zeros(20, np.uint8), "not a picture"),
        (np.full((20, 20), np.nan), "not finite"),
        (np.full((20, 20), np.inf), "not finite"),
        (np.zeros((20, 20), np.complex128), "cannot be read"),
        (np.broadcast_to(np.uint8(0), (10_001, 10_000)), "larger than 100 Mpx"),
    ],
)
def test_arrays_that_are_no_picture_are_refused(array, match):
    with pytest.raises(DataError, match=match):
        grey(array)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("share", [0.3, 0.9])
def test_truncated_files_are_refused(tmp_path, suffix, share):
    path = tmp_path / f"cut{suffix}"
    cv2.imwrite(str(path), np.random.default_rng(0).integers(0, 256, (64, 64), dtype=np.uint8))
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(DataError, match="too early") as caught:
        read_picture(path)
    assert str(path) in str(caught.value)


def test_announced_size_is_checked_before_decoding(tmp_path):
    path = tmp_path / "bomb.png"
    cv2.imwrite(str(path), RAMP)
    content = bytearray(path.read_bytes())
    content[16:24] = (60_000).to_bytes(4, "big") * 2
    path.write_bytes(bytes(content))
    with pytest.raises(DataError, match="larger than 100 Mpx"):
        read_picture(path)


@pytest.mark.parametrize("content", [b"", b"hello", b"\x89PNG\r\n\x1a\nIEND", bytes(1000)])
def test_files_that_are_no_picture_are_refused(tmp_path, content):
    path = tmp_path / "thing.png"
    path.write_bytes(content)
    with pytest.raises(DataError):
        read_picture(path)


def test_missing_file_and_folder_are_refused(tmp_path):
    for path in (tmp_path / "none.png", tmp_path):
        with pytest.raises(DataError, match="cannot read the picture"):
            read_picture(path)
