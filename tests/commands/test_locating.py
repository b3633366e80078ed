"""Search and outline in the twin with several parts on the table: each found, in order of angle, one chosen."""

import math

import numpy as np
import pytest
import trimesh

from surfuse.acquisition.search import SearchResult
from surfuse.commands.acquire.acquisition import acquire
from surfuse.commands.acquire.locating import _wanted, locate
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import DataError
from surfuse.rig.simulated.assembly import simulated_rig
from surfuse.settings import load

LEFT_M, RIGHT_M = -0.22, 0.2


class Listening(SilentWatcher):
    """Remembers what it was told."""

    def __init__(self):
        self.notes = []

    def warn(self, text):
        self.notes.append(text)


@pytest.fixture(scope="module")
def two_boxes(tmp_path_factory):
    """A mesh file of two boxes, 8 and 12 cm wide, side by side."""
    boxes = []
    for x, width, height in ((LEFT_M, 0.08, 0.1), (RIGHT_M, 0.12, 0.15)):
        one = trimesh.creation.box((width, 0.02, height))
        one.apply_translation([x, 0.0, 0.5 * height])
        boxes.append(one)
    path = tmp_path_factory.mktemp("parts") / "two.stl"
    trimesh.util.concatenate(boxes).export(path)
    return path


def located(path, *assignments):
    settings = load(None, [f"scene.name={path}", "arm.driver=kinematic", "scene.azimuth_deg=20", *assignments])
    cell, watcher = simulated_rig(settings), Listening()
    with cell.opened():
        return locate(cell, settings, watcher), watcher.notes


def width_mm(part):
    return 1e3 * float(np.ptp(part.outline.vertices_m[:, 0]))


@pytest.fixture(scope="module")
def second(two_boxes):
    """The second of the two, found once."""
    return located(two_boxes, "search.part=2", "search.increment_deg=30")


def test_all_parts_are_found_in_order_of_angle_each_once(second):
    part, notes = second
    assert len(part.parts) == 2
    directions = [math.degrees(found.direction_rad) for found in part.parts]
    assert directions[1] - directions[0] == pytest.approx(21.0, abs=2.0)
    assert all(found.centred and found.detection.confidence > 0.9 for found in part.parts)
    assert len(notes) == 1
    assert "2 parts found: part 1 at" in notes[0]
    assert "part 2 is scanned" in notes[0]


def test_the_chosen_part_is_outlined_and_ranged_itself(second):
    part, _ = second
    assert width_mm(part) == pytest.approx(80.0, abs=10.0)
    assert part.frame is part.parts[1].frame
    # The ranger was turned to it: range and foot agree.
    assert not part.outlined.distance.disagreement > 3.0


def test_a_part_that_is_not_there_is_an_error_that_names_those_that_are(second):
    part, _ = second
    found = SearchResult(part.parts, (-1.0, 0.0, 1.0), part.frame)
    with pytest.raises(DataError, match=r"search.part = 3, but 2 seen in 3 pictures from -57 to 57 degrees: part 1 at"):
        _wanted(found, 3)
    with pytest.raises(DataError, match="no part seen in 3 pictures"):
        _wanted(SearchResult((), (-1.0, 0.0, 1.0), part.frame), 1)


@pytest.mark.parametrize(("number", "width"), [(1, 0.12), (2, 0.08)])
def test_a_part_is_scored_with_its_own_truth_alone(two_boxes, tmp_path, number, width):
    how = [f"scene.name={two_boxes}", "arm.driver=kinematic", "scene.azimuth_deg=20", "scan.step_m=0.02"]
    settings = load(None, [*how, f"search.part={number}", "search.increment_deg=30", 'fusion.method="mean"'])
    outcome = acquire(settings, tmp_path / "run", SilentWatcher())
    assert outcome.summary["coverage"] > 0.6
    mesh = trimesh.load_mesh(tmp_path / "run" / "truth.ply")
    assert sorted(mesh.bounding_box_oriented.extents)[1] == pytest.approx(width, abs=0.004)
