"""`surfuse threshold` and `surfuse outline` through the real command line, on good and on bad pictures."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from surfuse.cli import main
from surfuse.commands.pictures.picture_outline import _corners as corners_of
from surfuse.errors import DataError
from surfuse.geometry.polygons import is_simple, signed_area

IMAGES = Path(__file__).parents[1] / "data" / "images"


@pytest.fixture
def surfuse(monkeypatch, capsys):
    """The command line in this process: (status, stdout, stderr)."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["surfuse", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
        printed = capsys.readouterr()
        return stop.value.code, printed.out, printed.err

    return run


def disc(side=120, radius=30, noise=4.0, grey=(40, 200)):
    y, x = np.mgrid[:side, :side]
    inside = (x - 0.45 * side) ** 2 + (y - 0.55 * side) ** 2 <= radius**2
    values = np.where(inside, grey[1], grey[0]) + np.random.default_rng(0).normal(0, noise, (side, side))
    return np.clip(values, 0, 255).astype(np.uint8), inside


def saved(path, picture):
    assert cv2.imwrite(str(path), picture)
    return path


def rows_of(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_four_methods_against_a_mask(surfuse, tmp_path):
    picture, inside = disc()
    image = saved(tmp_path / "disc.png", picture)
    mask = saved(tmp_path / "mask.png", inside.astype(np.uint8))
    status, out, err = surfuse("threshold", image, "--mask", mask, "--json")
    assert (status, err) == (0, "")
    result = json.loads(out)
    assert [row["method"] for row in result["methods"]] == [
        "otsu", "maximum_entropy", "uniform_error", "minimum_error",
    ]  # fmt: skip
    for row in result["methods"]:
        assert 40 < row["threshold"] < 200
        sharp = row["method"] in ("otsu", "minimum_error")
        assert row["separability"] > 0.9 or not sharp
        assert row["misclassification_error"] < (0.001 if sharp else 0.05)
        assert row["foreground_area_error"] < (0.005 if sharp else 0.2)
        assert 0.0 < row["region_non_uniformity"] < 0.2
        assert 0.0 < row["ms"] < 100.0
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["disc.png", "mask.png"]


def test_errors_need_a_mask_and_one_method_can_be_asked_for(surfuse):
    status, out, _ = surfuse("threshold", IMAGES / "coins.png", "--method", "otsu", "--json")
    (row,) = json.loads(out)["methods"]
    assert status == 0
    assert (row["threshold"], row["misclassification_error"]) == (107, None)


def test_picture_is_written_once(surfuse, tmp_path):
    out = tmp_path / "methods.png"
    arguments = ["threshold", IMAGES / "horse.png", "--out", out]
    assert surfuse(*arguments)[0] == 0
    content = out.read_bytes()
    shown = cv2.imread(str(out))
    assert shown.shape[1] > 4 * 300
    status, _, err = surfuse(*arguments)
    assert status == 6
    assert "--force" in err
    assert out.read_bytes() == content
    assert surfuse(*arguments, "--force")[0] == 0


def test_mask_of_another_size_is_refused(surfuse, tmp_path):
    mask = saved(tmp_path / "mask.png", np.zeros((20, 30), np.uint8))
    status, out, err = surfuse("threshold", IMAGES / "coins.png", "--mask", mask)
    assert (status, out) == (3, "")
    assert err.count("\n") == 1
    assert "30 x 20" in err
    assert "384 x 303" in err


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["threshold", "x.png", "--method", "otsi"], "otsu"),
        (["threshold", "x.png", "--out", "x.jpg"], ".png"),
        (["threshold"], "image"),
        (["outline", "x.png", "--out", "x.csv"], "--scale"),
        (["outline", "x.png", "--scale", "0", "--out", "x.csv"], "--scale"),
        (["outline", "x.png", "--scale", "nan", "--out", "x.csv"], "scale"),
        (["outline", "x.png", "--scale", "1", "--out", "x.txt"], ".csv"),
    ],
)
def test_usage(surfuse, arguments, word):
    status, out, err = surfuse(*arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert word in err


def bad_pictures(folder):
    good = (IMAGES / "coins.png").read_bytes()
    huge = bytearray(good)
    huge[16:24] = (20000).to_bytes(4, "big") * 2
    (folder / "truncated.png").write_bytes(good[: len(good) // 2])
    (folder / "empty.png").write_bytes(b"")
    (folder / "text.png").write_text("not a picture")
    (folder / "huge.png").write_bytes(bytes(huge))
    saved(folder / "tiny.png", np.zeros((7, 300), np.uint8))
    saved(folder / "nan.tiff", np.full((20, 20), np.nan, np.float32))
    (folder / "folder.png").mkdir()
    names = ["truncated.png", "empty.png", "text.png", "huge.png", "tiny.png", "nan.tiff", "folder.png", "missing.png"]
    return [folder / name for name in names]


def test_bad_pictures_give_one_clear_line(surfuse, tmp_path):
    for image in bad_pictures(tmp_path):
        for arguments in (["threshold", image], ["outline", image, "--scale", "1", "--out", tmp_path / "out.csv"]):
            status, out, err = surfuse(*arguments)
            assert (status, out, err.count("\n")) == (3, "", 1), image
            assert image.name in err
            assert "internal" not in err
    assert not (tmp_path / "out.csv").exists()
    assert not (tmp_path / "out.png").exists()


@pytest.mark.parametrize("kind", ["colour", "16 bit", "float", "transparent"])
def test_other_kinds_of_pictures_are_read(surfuse, tmp_path, kind):
    grey, inside = disc()
    picture = {
        "colour": lambda: cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR),
        "16 bit": lambda: grey.astype(np.uint16) * 200,
        "float": lambda: grey.astype(np.float32) / 17.0,
        "transparent": lambda: np.dstack([grey, grey, grey, np.where(inside, 255, 0).astype(np.uint8)]),
    }[kind]()
    image = saved(tmp_path / ("picture.tiff" if kind == "float" else "picture.png"), picture)
    out = tmp_path / "out.csv"
    status, _, err = surfuse("outline", image, "--scale", "2", "--out", out)
    assert (status, err) == (0, "")
    points = np.array([[float(row["u"]), float(row["v"])] for row in rows_of(out)])
    assert np.ptp(points, axis=0) == pytest.approx([0.12, 0.12], abs=0.003)


def test_outline_of_a_disc_in_metres(surfuse, tmp_path):
    image, out = saved(tmp_path / "disc.png", disc()[0]), tmp_path / "outline.csv"
    status, text, err = surfuse("outline", image, "--scale", "0.5", "--out", out, "--tolerance", "0.5", "--json")
    assert (status, err) == (0, "")
    (part,) = json.loads(text)["parts"]
    assert list(rows_of(out)[0]) == ["u", "v"]
    points = np.array([[float(row["u"]), float(row["v"])] for row in rows_of(out)])
    assert points.min(axis=0).tolist() == [0.0, 0.0]
    assert signed_area(points) == pytest.approx(np.pi * 0.015**2, rel=0.02)
    assert part["dominant_points"] == len(points)
    assert part["width_m"] == pytest.approx(0.030, abs=7e-4)
    overlay = cv2.imread(str(tmp_path / "outline.png"))
    assert np.any(np.ptp(overlay.astype(int), axis=2) > 50)


def test_v_points_up(surfuse, tmp_path):
    picture = np.full((100, 100), 30, np.uint8)
    cv2.fillPoly(picture, [np.array([[20, 80], [80, 80], [50, 20]])], 220)  # a triangle that stands on its base
    image, out = saved(tmp_path / "triangle.png", picture), tmp_path / "o.csv"
    assert surfuse("outline", image, "--scale", "1", "--out", out)[0] == 0
    points = np.array([[float(row["u"]), float(row["v"])] for row in rows_of(out)])
    assert points[np.argmax(points[:, 1])] == pytest.approx([0.03, 0.06], abs=0.002)


def test_all_coins_with_one_origin(surfuse, tmp_path):
    out = tmp_path / "coins.csv"
    status, text, _ = surfuse("outline", IMAGES / "coins.png", "--scale", "0.5", "--out", out, "--all", "--json")
    assert status == 0
    result = json.loads(text)
    assert len(result["parts"]) == 24
    rows = rows_of(out)
    assert {int(row["part"]) for row in rows} == set(range(24))
    assert min(float(row["u"]) for row in rows) == 0.0
    for number in range(24):
        own = np.array([[float(row["u"]), float(row["v"])] for row in rows if int(row["part"]) == number])
        assert is_simple(own)
        assert signed_area(own) > 0.0


def test_outputs_are_not_overwritten(surfuse, tmp_path):
    image, out = saved(tmp_path / "disc.png", disc()[0]), tmp_path / "outline.csv"
    out.with_suffix(".png").write_bytes(b"mine")
    arguments = ["outline", image, "--scale", "1", "--out", out]
    status, _, err = surfuse(*arguments)
    assert status == 6
    assert "outline.png" in err
    assert out.with_suffix(".png").read_bytes() == b"mine"
    assert not out.exists()
    assert surfuse(*arguments, "--force")[0] == 0
    assert surfuse(*arguments)[0] == 6


def test_overlay_never_replaces_the_picture_itself(surfuse, tmp_path):
    image = saved(tmp_path / "disc.png", disc()[0])
    before = image.read_bytes()
    status, _, err = surfuse("outline", image, "--scale", "1", "--out", tmp_path / "disc.csv", "--force")
    assert status == 2
    assert "disc.png" in err
    status, _, err = surfuse("threshold", image, "--out", image, "--force")
    assert status == 2
    assert image.read_bytes() == before


def test_part_cut_by_the_border(surfuse, tmp_path):
    picture, _ = disc()
    image, out = saved(tmp_path / "cut.png", picture[:, 40:]), tmp_path / "o.csv"
    status, _, err = surfuse("outline", image, "--scale", "1", "--out", out)
    assert status == 3
    assert "border" in err
    assert "--cut" in err
    assert not out.exists()
    status, text, _ = surfuse("outline", image, "--scale", "1", "--out", out, "--cut")
    assert status == 0
    assert "not complete" in text


@pytest.mark.parametrize("kind", ["black", "noise", "speck"])
def test_nothing_to_outline(surfuse, tmp_path, kind):
    generator = np.random.default_rng(1)
    picture = {
        "black": lambda: np.zeros((60, 80), np.uint8),
        "noise": lambda: generator.normal(128, 10, (60, 80)).astype(np.uint8),
        "speck": lambda: np.pad(np.full((1, 2), 255, np.uint8), 30),
    }[kind]()
    image, out = saved(tmp_path / "p.png", picture), tmp_path / "o.csv"
    status, _, err = surfuse("outline", image, "--scale", "1", "--out", out)
    assert (status, err.count("\n")) == (3, 1)
    assert "nothing stands out" in err
    assert not out.exists()


def test_flat_picture_is_called_not_bimodal(surfuse, tmp_path):
    image = saved(tmp_path / "p.png", np.full((50, 50), 99, np.uint8))
    status, out, _ = surfuse("threshold", image)
    assert status == 0
    assert "mean nothing" in out


def test_console_script(tmp_path):
    image = saved(tmp_path / "disc.png", disc()[0])
    code = "from surfuse.cli import main; main()"
    command = [sys.executable, "-c", code, "outline", str(image), "--scale", "1", "--out", str(tmp_path / "o.csv")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=500, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "o.png").exists()


def test_ring_that_crosses_itself_for_good_is_one_clear_error(tmp_path):
    # A ribbon drawn as a long figure of eight: without its loops there is hardly anything left of it.
    t = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    eight = np.column_stack([200.0 + 150.0 * np.sin(t), 100.0 + 60.0 * np.sin(2.0 * t)])
    with pytest.raises(DataError, match="crosses itself"):
        corners_of(eight, 1.0)
