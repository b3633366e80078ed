"""Search: order, centring, ends of the turn, nothing found. The pictures are drawn by hand, the vision is real."""

import math
from dataclasses import replace

import numpy as np
import pytest

from surfuse.acquisition.search import SearchParameters, search
from surfuse.errors import ConfigError
from surfuse.geometry.poses import pose
from surfuse.records import CameraFrame, CameraModel, Detection
from surfuse.vision.part_finder import find_parts

CAMERA = CameraModel(250, 291, 260.0, 380.0, 124.5, 145.0)
LOWER, UPPER = math.radians(-160.0), math.radians(160.0)


def cell(*azimuths_deg, width=16, forward=0.1, radius=1.05):
    """`capture` for parts at azimuths, seen by a camera on an arm of `forward` metres."""

    def capture(angle_rad):
        image = np.full((CAMERA.height_px, CAMERA.width_px), 20, np.uint8)
        for azimuth in np.radians(azimuths_deg):
            offset = math.remainder(azimuth - angle_rad, 2 * math.pi)
            ahead, left = radius * math.cos(offset) - forward, radius * math.sin(offset)
            if ahead > 0.1:
                x = CAMERA.cx_px - CAMERA.fx_px * left / ahead
                low, high = (int(np.clip(round(x + side * width), 0, CAMERA.width_px)) for side in (-1, 1))
                image[110:200, low:high] = 190
        ahead = np.array([math.cos(angle_rad), math.sin(angle_rad), 0.0])
        right = np.array([math.sin(angle_rad), -math.cos(angle_rad), 0.0])
        return CameraFrame(image, 0.0, CAMERA, pose(np.column_stack([right, [0, 0, -1.0], ahead]), forward * ahead))

    return capture


@pytest.mark.parametrize("azimuth", [-150.0, -20.0, 0.0, 33.3, 158.0])
def test_first_part_is_found_and_centred(azimuth):
    result = search(cell(azimuth), find_parts, LOWER, UPPER)
    (part,) = result.parts
    assert part.centred
    assert math.degrees(part.angle_rad) == pytest.approx(azimuth, abs=0.6)
    assert abs(part.detection.centroid_px[0] - CAMERA.cx_px) <= 2.0
    assert part.angle_rad == result.visited_rad[-1]
    assert part.frame is result.last_frame


def test_search_stops_at_the_first_part():
    result = search(cell(-100.0, 100.0), find_parts, LOWER, UPPER)
    assert len(result.parts) == 1
    assert max(result.visited_rad) < 0.0


def test_all_parts_are_found_in_order_of_angle():
    azimuths = (120.0, -140.0, 5.0, 17.0)
    result = search(cell(*azimuths), find_parts, LOWER, UPPER, SearchParameters(all_parts=True))
    assert [math.degrees(part.direction_rad) for part in result.parts] == pytest.approx(sorted(azimuths), abs=0.6)
    assert all(part.centred for part in result.parts)
    assert all(abs(part.detection.centroid_px[0] - CAMERA.cx_px) <= 2.0 for part in result.parts)


def test_part_behind_the_ends_of_a_full_turn_is_one_part():
    result = search(cell(180.0), find_parts, -math.pi, math.pi, SearchParameters(all_parts=True))
    assert len(result.parts) == 1


def test_nothing_found_is_an_answer_after_the_whole_turn():
    result = search(cell(), find_parts, LOWER, UPPER, SearchParameters(increment_rad=math.radians(30.0)))
    assert result.parts == ()
    assert result.visited_rad[0] == LOWER
    assert result.visited_rad[-1] == UPPER
    assert np.all(np.diff(result.visited_rad) <= math.radians(30.0) + 1e-9)


def test_part_beyond_the_limit_is_reported_as_not_centred():
    result = search(cell(100.0), find_parts, math.radians(-90.0), math.radians(90.0))
    (part,) = result.parts
    assert not part.centred
    assert part.angle_rad <= math.radians(90.0)
    assert math.degrees(part.direction_rad) == pytest.approx(100.0, abs=2.0)


def test_part_half_out_of_view_is_turned_into_it():
    result = search(cell(35.0, width=30), find_parts, math.radians(10.0), UPPER)
    (part,) = result.parts
    assert part.centred
    assert not part.detection.touches_border


def test_a_part_that_the_picture_cuts_is_turned_to_although_its_piece_looks_like_a_known_one():
    """What is seen of it lies where another part is; where its middle is, only the turn shows."""

    def sighting(angle_rad, direction_deg, cut=False):
        x = CAMERA.cx_px + CAMERA.fx_px * math.tan(angle_rad - math.radians(direction_deg))
        contour = np.array([[x - 9.0, 100.0], [x + 9.0, 100.0], [x, 130.0]])
        return Detection(contour, np.array([x, 110.0]), 270.0, cut, 50, 1.0, 1.0)

    def find(frame):
        angle = math.atan2(frame.world_from_camera[1, 2], frame.world_from_camera[0, 2])
        known, wanted = sighting(angle, 0.0), sighting(angle, 5.0)
        far_end = abs(angle - math.radians(15.0)) < 1e-6
        return (sighting(angle, 2.9, cut=True),) if far_end else (known,) if abs(angle) < 1e-6 else (known, wanted)

    all_of_them = SearchParameters(increment_rad=math.radians(15.0), all_parts=True)
    result = search(cell(), find, 0.0, math.radians(15.0), all_of_them)
    assert [math.degrees(part.direction_rad) for part in result.parts] == pytest.approx([0.0, 5.0])


def test_sighting_that_vanishes_when_turned_to_is_no_part():
    once = cell(20.0)
    empty = cell()
    visited = []

    def capture(angle_rad):
        visited.append(angle_rad)
        return once(angle_rad) if len(visited) == 1 else empty(angle_rad)

    result = search(capture, find_parts, 0.0, 1.0)
    assert result.parts == ()
    assert result.visited_rad == tuple(visited)


def test_single_angle_is_looked_at_once():
    result = search(cell(), find_parts, 0.3, 0.3)
    assert result.visited_rad == (0.3,)


@pytest.mark.parametrize(("lower", "upper"), [(1.0, 0.0), (math.nan, 1.0), (0.0, math.inf)])
def test_impossible_limits_are_refused(lower, upper):
    with pytest.raises(ConfigError):
        search(cell(), find_parts, lower, upper)


@pytest.mark.parametrize(
    "values", [{"increment_rad": 0.0}, {"centred_px": 0.0}, {"centring_turns": 0}, {"same_part_rad": -1.0}]
)
def test_impossible_parameters_are_refused(values):
    with pytest.raises(ConfigError):
        replace(SearchParameters(), **values)
