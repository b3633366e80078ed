"""Parts of many shapes are found in the simulated cell, at their true size; what stands behind the table is not."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from surfuse.commands.acquire.locating import locate
from surfuse.commands.outcome import SilentWatcher
from surfuse.records import CameraFrame, CameraModel
from surfuse.rig.simulated.assembly import simulated_rig
from surfuse.settings import load
from surfuse.vision.dim_foot import with_dim_foot
from surfuse.vision.part_finder import FindParameters, find_regions

make, turned = trimesh.creation, trimesh.transformations.rotation_matrix
ACROSS, RADIAL = turned(np.pi / 2, [0, 1, 0]), turned(np.pi / 2, [1, 0, 0])
SHAPES = {
    "a large sphere": make.icosphere(4, 0.09),
    "a small sphere": make.icosphere(3, 0.04),
    "a cone": make.cone(0.08, 0.2, sections=48),
    "a cone on its tip": make.cone(0.08, 0.2, sections=48).apply_transform(turned(np.pi, [1, 0, 0])),
    "a standing cylinder": make.cylinder(0.05, 0.2, sections=48),
    "a cylinder that lies across": make.cylinder(0.06, 0.2, sections=48).apply_transform(ACROSS),
    "a cylinder that points at the arm": make.cylinder(0.06, 0.2, sections=48).apply_transform(RADIAL),
    "a pyramid": make.cone(0.1, 0.15, sections=4),
    "a standing ring": make.torus(0.08, 0.02).apply_transform(RADIAL),
    "a lying ring": make.torus(0.08, 0.02),
    "a thin standing rod": make.cylinder(0.006, 0.2, sections=24),
    "a thin lying rod": make.cylinder(0.01, 0.2, sections=24).apply_transform(ACROSS),
}
QUICK = ["arm.driver=kinematic", "scene.azimuth_deg=-120.0"]


@pytest.mark.parametrize("shape", SHAPES)
def test_it_is_found_where_it_stands(shape, tmp_path):
    mesh = SHAPES[shape].copy()
    mesh.export(tmp_path / "part.stl")
    # The deep ones stand nearer, so that the ring carries them.
    depth = float(np.ptp(mesh.vertices[:, 1]))
    radius_m = min(1.12, 1.23 - depth)
    settings = load(None, [f'scene.name="{tmp_path / "part.stl"}"', f"scene.radius_m={radius_m}", *QUICK])
    rig = simulated_rig(settings)
    with rig.opened():
        part = locate(rig, settings, SilentWatcher())
    size, true = np.ptp(part.outline.vertices_m, axis=0), np.ptp(mesh.vertices, axis=0)[[0, 2]]
    origin = part.outline.world_from_part[:2, 3]
    assert np.degrees(np.arctan2(origin[1], origin[0])) == pytest.approx(-120.0, abs=1.5)
    assert size[0] == pytest.approx(true[0], rel=0.12, abs=0.004)
    # A deep low part is seen from above: its picture is higher than it.
    assert 0.85 * true[1] - 0.004 <= size[1] <= 1.15 * true[1] + 0.35 * depth


def picture(foot: float, ground_below: float) -> CameraFrame:
    """A bright bar whose lower part has the level `foot`, on a ground that has another one below row 60."""
    image = np.full((100, 100), 20.0)
    image[60:] = ground_below
    image[30:60, 40:60] = 220.0
    image[60:75, 40:60] = foot
    camera = CameraModel(100, 100, 100.0, 100.0, 49.5, 49.5)
    return CameraFrame(image.astype(np.uint8), 0.0, camera, np.eye(4))


@pytest.mark.parametrize(
    ("foot", "ground", "last"), [(80.0, 50.0, 74), (62.0, 50.0, 74), (55.0, 50.0, None), (50.0, 50.0, None)]
)
def test_a_region_goes_on_where_it_is_unlike_what_is_beside_it(foot, ground, last):
    image = picture(foot, ground).image
    (region,) = [one for one in find_regions(image, FindParameters(blur_px=0.0)) if one.contour_px[:, 0].max() < 80]
    assert region.contour_px[:, 1].max() < 61
    found = with_dim_foot(region, image, 12.0)
    if last is None:
        assert found is None
    else:
        mask, bright = found
        assert bright
        assert np.flatnonzero(mask.any(axis=1))[-1] == last


def test_threads_of_noise_are_no_foot():
    image = picture(50.0, 50.0).image.copy()
    image[60:75, 50:52] = 90
    (region,) = [one for one in find_regions(image, FindParameters(blur_px=0.0)) if one.contour_px[:, 0].max() < 80]
    assert with_dim_foot(region, image, 12.0) is None


def test_a_region_at_the_lower_border_has_nothing_below_it():
    image = np.full((60, 100), 20, dtype=np.uint8)
    image[30:, 40:60] = 220
    (region,) = find_regions(image, FindParameters(blur_px=0.0))
    assert with_dim_foot(region, image, 12.0) is None
