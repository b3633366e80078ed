"""The search over rendered pictures: several parts, one half out of view, nothing, clutter."""

import math

import numpy as np
import pytest

from surfuse.acquisition.search import SearchParameters, search
from surfuse.records import CameraFrame, CameraModel
from surfuse.rig.mounts import looking_outwards, world_from_shoulder
from surfuse.twin.materials import Material
from surfuse.twin.optics import OpticsParameters, render
from surfuse.twin.scene import Scene, table_bodies
from surfuse.twin.shapes import box, cylinder, standing
from surfuse.vision.part_finder import FindParameters, find_parts
from surfuse.vision.table import TableRing

# Half the pixels of the reference camera, so that a turn takes a second.
CAMERA = CameraModel(250, 291, 260.0, 380.0, 124.5, 145.0)
FIND = FindParameters(area_min_px=30.0)
LIGHT = OpticsParameters(noise_levels=8.0, gradient_x=0.5, edge_samples=2)


def turned(*bodies, lower=-60.0, upper=60.0, all_parts=True):
    scene = Scene((*table_bodies(), *bodies))
    taken = [0]

    def capture(angle):
        taken[0] += 1
        place = world_from_shoulder(angle) @ looking_outwards(0.1, 1.3)
        image = render(scene, CAMERA, place, np.random.default_rng(taken[0]), LIGHT)
        return CameraFrame(image, 0.0, CAMERA, place)

    return search(
        capture,
        lambda frame: find_parts(frame, FIND, TableRing()),
        math.radians(lower),
        math.radians(upper),
        SearchParameters(all_parts=all_parts),
    )


def degrees(result):
    return [math.degrees(part.direction_rad) for part in result.parts]


def part(azimuth_deg, solid, yaw=0.0, radius=1.05):
    return standing(solid, Material.PART, math.radians(azimuth_deg), radius, 1.0, yaw)


def test_several_parts_come_in_order_of_angle():
    result = turned(
        part(38.0, cylinder(0.05, 0.1)), part(-31.0, box(0.03, 0.03, 0.04)), part(5.0, box(0.2, 0.02, 0.2), 0.3)
    )
    assert degrees(result) == pytest.approx([-31.0, 5.0, 38.0], abs=1.0)
    assert all(found.centred for found in result.parts)


def test_part_half_out_of_view_is_centred_by_turning():
    # At the first station the part is cut by the left side of the picture.
    result = turned(part(22.0, box(0.15, 0.02, 0.15)), lower=0.0, upper=40.0, all_parts=False)
    (found,) = result.parts
    assert found.centred
    assert not found.detection.touches_border
    assert degrees(result) == pytest.approx([22.0], abs=1.0)


def test_empty_table_and_clutter_have_no_parts():
    tall = standing(box(0.4, 0.3, 1.6), Material.PART, 0.3, 2.2, 0.0)
    hanging = standing(box(0.4, 0.1, 0.4), Material.PART, -0.4, 2.5, 1.5)
    assert turned().parts == ()
    assert turned(tall, hanging).parts == ()
    assert degrees(turned(tall, hanging, part(-2.0, box(0.06, 0.04, 0.08)))) == pytest.approx([-2.0], abs=1.5)
