"""The study of thresholds: known masks, the same numbers for the same seed, a table that can be read."""

import csv
import json
import sys

import numpy as np
import pytest

from surfuse.cameras import REFERENCE_MODEL
from surfuse.cli import main
from surfuse.commands.pictures.threshold_study import CONDITIONS, study
from surfuse.rig.mounts import looking_outwards
from surfuse.twin.materials import Material
from surfuse.twin.optics import OpticsParameters, render, visible
from surfuse.twin.scene import Scene
from surfuse.twin.shapes import box, cylinder, standing
from surfuse.vision.threshold import METHODS


@pytest.fixture(scope="module")
def rows():
    return study(2, 5)


def test_every_method_meets_every_condition(rows):
    assert {(row.condition, row.method) for row in rows} == {(c, m) for c in CONDITIONS for m in METHODS}
    for row in rows:
        assert 0.0 <= row.misclassification_error <= 1.0
        assert 0.0 <= row.failed_share <= 1.0


def test_otsu_divides_plain_scenes(rows):
    (row,) = (row for row in rows if (row.condition, row.method) == ("plain", "otsu"))
    assert row.misclassification_error < 0.01
    assert row.failed_share == 0.0


def test_same_seed_same_numbers(rows):
    again = study(2, 5)
    for one, other in zip(rows, again, strict=True):
        assert (one.misclassification_error, one.separability) == (other.misclassification_error, other.separability)


def test_true_mask_is_where_the_part_is():
    # A box whose front is 1 m ahead of the camera, 0.2 m wide, its foot 0.1 m below the axis.
    part = standing(box(0.2, 0.05, 0.3), Material.PART, 0.0, 1.1, 1.2)
    mask = visible(Scene((part,)), REFERENCE_MODEL, looking_outwards(0.1, 1.3), 0)
    rows_seen, columns = np.nonzero(mask)
    assert columns.mean() == pytest.approx(249.5, abs=0.6)
    assert np.ptp(columns) + 1 == pytest.approx(0.2 * 520.0, abs=1.1)
    assert rows_seen.max() == pytest.approx(290.5 + 0.1 * 760.0, abs=1.0)
    assert rows_seen.min() == pytest.approx(290.5 - 0.2 * 760.0, abs=1.0)


def test_highlight_brightens_smooth_parts_alone():
    place = looking_outwards(0.1, 1.3)
    for material, brighter in ((Material.PART_SMOOTH, True), (Material.PART, False)):
        scene = Scene((standing(cylinder(0.05, 0.3), material, 0.0, 1.0, 1.15),))
        lights = [OpticsParameters((0.0, 0.0, 1.6), exposure=150.0, gloss=gloss) for gloss in (0.0, 200.0)]
        pictures = [render(scene, REFERENCE_MODEL, place, np.random.default_rng(0), light) for light in lights]
        assert (int(pictures[1].max()) > int(pictures[0].max()) + 20) is brighter
        assert np.array_equal(*pictures) is not brighter


@pytest.mark.parametrize("solid", [box(0.1, 0.04, 0.2), cylinder(0.05, 0.2)])
def test_solids_are_watertight_and_stand_on_their_foot(solid):
    body = standing(solid, Material.PART, 0.7, 1.1, 1.0, yaw_rad=0.3, lean_rad=0.2)
    corners = body.world_vertices()[body.triangles]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    assert volume == pytest.approx(0.1 * 0.04 * 0.2 if len(solid.vertices_m) < 20 else np.pi * 0.05**2 * 0.2, rel=0.01)
    assert corners[..., 2].min() == pytest.approx(1.0)


def test_command(monkeypatch, capsys, tmp_path):
    out = tmp_path / "study.csv"
    arguments = ["surfuse", "threshold-study", "--scenes", "1", "--out", str(out), "--json"]
    for expected in (0, 6):
        monkeypatch.setattr(sys, "argv", arguments)
        with pytest.raises(SystemExit) as stop:
            main()
        assert stop.value.code == expected
        if expected == 0:
            result = json.loads(capsys.readouterr().out)
    assert result["best"] in METHODS
    with out.open() as file:
        table = list(csv.DictReader(file))
    assert len(table) == len(result["rows"]) == 24
