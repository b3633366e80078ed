"""A camera finds the part of a real rig: on the tool and fixed, over the bridge, with pictures made by other rays."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from surfuse.arm_models.puma560 import READY_RAD, Puma560
from surfuse.bridge.shared import SharedBridge
from surfuse.commands.acquire.acquisition import acquire, resume
from surfuse.commands.acquire.dry_run import dry_run
from surfuse.commands.acquire.finding_on_plane import parts_seen, sightings
from surfuse.commands.acquire.locating import finder
from surfuse.commands.acquire.looking import look_from_here
from surfuse.commands.machine.doctor import doctor
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import ConfigError, DataError, DeviceError, InterruptError, UnreachableError, UsageError
from surfuse.exporters import nc
from surfuse.geometry.polygons import signed_distance
from surfuse.records import CameraFrame, JointState
from surfuse.rig.assembled import assembled
from surfuse.rig.description import camera_model
from surfuse.rig.devices import JointMotion, Rig
from surfuse.rig.real.assembly import real_rig
from surfuse.rig.real.camera import real_lookout
from surfuse.rig.real.recordings import Recordings
from surfuse.runs.log_reader import read_log
from surfuse.settings import load
from surfuse.vision.support_plane import plane_frame

HERE = Path(__file__).parent


def module_of(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


pretended, table = module_of(HERE / "pretended_rig.py"), module_of(HERE / "box_on_a_table.py")

INTRINSICS = (
    f"width_px = {table.WIDTH}\nheight_px = {table.HEIGHT}\n"
    f"fx_px = {table.FX}\nfy_px = {table.FY}\ncx_px = {table.CX}\ncy_px = {table.CY}\n"
)
SENSOR = (
    '[[sensor]]\nname = "spot"\nkind = "laser"\nbeam_full_angle_deg = 1.0\nrange_min_m = 0.05\nrange_max_m = 1.5\n'
    "sigma_m = 0.001\n"
)
PLANE = f"plane = {{ origin_m = [0.0, 0.0, {table.TABLE_M}] }}\n"
REST = '[scan]\nstep_m = 0.01\nstandoff_m = 0.4\n[fusion]\nmethod = "mean"\n'
BOX = table.Box(0.05, -0.02)
TWO_PIXELS_M = 0.004


def numbers(pose) -> str:
    return str([round(float(value), 9) for value in np.asarray(pose).ravel()])


def camera(place: str) -> str:
    return f'[camera]\ndriver = "bridge"\n{place}\n{INTRINSICS}'


ON_TOOL = camera(f'mounted = "tool"\ntool_from_camera = {numbers(table.TOOL_FROM_CAMERA)}')
FIXED = camera(f'mounted = "fixed"\nworld_from_camera = {numbers(table.WORLD_FROM_CAMERA)}')
VIEWS = f"views = [{numbers(table.above(-0.3, 0.3))}, {numbers(table.above(0.0, 0.0))}]\n"


def cell(folder: Path, address: str, looking: str, search: str = PLANE, more: str = "") -> Path:
    path = folder / "rig.toml"
    arm = f'[arm]\ndriver = "bridge"\naddress = "{address}"\ngive_up_s = 1.0\n'
    path.write_text(f"{arm}{SENSOR}{looking}[search]\n{search}{REST}{more}", "utf-8")
    return path


@pytest.fixture
def rig():
    return table.BoxRig([BOX])


@pytest.fixture
def served(rig):
    with pretended.Served(rig) as found:
        yield found


class Notes(SilentWatcher):
    def __init__(self):
        self.notes = []

    def warn(self, text):
        self.notes.append(text)


def distance_of(outline, shadow) -> float:
    """Largest distance between an outline on the table and the hull of what the rays throw there, either way."""
    world = outline.vertices_m @ outline.world_from_part[:2, :2].T + outline.world_from_part[:2, 3]
    hull = shadow[ConvexHull(shadow).vertices]
    return max(np.abs(signed_distance(world, hull)).max(), np.abs(signed_distance(hull, world)).max())


def scanned(path: Path, run: Path, watcher=None):
    outcome = acquire(load(path), run, watcher or SilentWatcher(), yes=True)
    assert outcome.complete
    return read_log(run)


def assert_is_the_box(run: Path, box=BOX) -> None:
    """The map shows the top where the box is, and the table where it is not, in the frame of the part."""
    surface = nc.read(run / "surface.nc")
    u, v = np.meshgrid(surface.grid.u_m, surface.grid.v_m)
    pose = surface.grid.world_from_part
    np.testing.assert_allclose(pose[:3, :3], np.eye(3), atol=1e-12)
    assert pose[2, 3] == pytest.approx(table.TABLE_M)
    world = np.stack([u.ravel(), v.ravel(), 0 * u.ravel(), 1 + 0 * u.ravel()]).T @ pose.T
    inner = np.abs((np.linalg.inv(box.pose) @ world.T)[:2].T)
    away = (inner - box.size[:2] / 2).max(axis=1).reshape(u.shape)
    known = surface.mask
    top, ground = known & (away < -0.006), known & (away > 0.006)
    assert top.sum() >= 4
    # Every node on the box is scanned, and one sensor along its axis is exact.
    assert known[away < -0.006].all()
    np.testing.assert_allclose(surface.height_m[top], box.size[2], atol=1e-9)
    np.testing.assert_allclose(surface.height_m[ground], 0.0, atol=1e-9)


@pytest.mark.parametrize(("looking", "on_tool"), [(ON_TOOL, True), (FIXED, False)])
def test_the_part_is_found_outlined_and_scanned(served, rig, tmp_path, looking, on_tool):
    rig.on_tool = on_tool
    log = scanned(cell(tmp_path, served.address, looking, PLANE + (VIEWS if on_tool else "")), tmp_path / "run")
    eye = table.above(0.0, 0.0) @ table.TOOL_FROM_CAMERA if on_tool else table.WORLD_FROM_CAMERA
    assert distance_of(log.scene.outline, table.shadow(BOX, eye)) < TWO_PIXELS_M
    np.testing.assert_allclose(
        (log.scene.outline.world_from_part @ np.append(log.scene.outline.viewpoint_m, 1.0))[:3], eye[:3, 3], atol=1e-9
    )
    assert_is_the_box(tmp_path / "run")
    assert len(log.frames) == 1
    page = (tmp_path / "run" / "report.html").read_text("utf-8")
    assert 'id="search"' in page
    assert "Outline in the part frame" in page


def test_the_outline_holds_the_true_one_within_its_sigma_whatever_the_place(served, rig, tmp_path):
    """Sigma is honest: over places and turns of the box, what is off is a few standard deviations and half a corner."""
    settings = load(cell(tmp_path, served.address, ON_TOOL))
    for place, degrees in (((0.06, -0.05), 0.0), ((0.04, 0.03), 77.0), ((0.1, -0.06), 45.0)):
        rig.boxes, rig.pose = [table.Box(*place, degrees=degrees)], table.above(0.0, 0.0)
        outline = found_outline(settings)
        off = distance_of(outline, table.shadow(rig.boxes[0], rig.world_from_camera))
        assert off < 4.0 * outline.sigma_m.max() + 0.001
        assert outline.sigma_m.max() < 0.004


def found_outline(settings):
    rig = assembled(settings)
    with rig.opened():
        return look_from_here(rig, settings, SilentWatcher()).outline


def test_from_view_to_view_until_a_whole_part_is_seen(served, rig, tmp_path):
    scanned(cell(tmp_path, served.address, ON_TOOL, PLANE + VIEWS), tmp_path / "run")
    np.testing.assert_allclose(rig.moves[0], table.above(-0.3, 0.3), atol=1e-9)
    np.testing.assert_allclose(rig.moves[1], table.above(0.0, 0.0), atol=1e-9)
    assert rig.pictures == 2
    assert (read_log(tmp_path / "run").events[0].text) == "part found after 2 pictures"


def test_several_parts_are_counted_by_size_and_each_once(served, rig, tmp_path):
    small = table.Box(-0.06, 0.05, (0.05, 0.04, 0.02), 10.0)
    rig.boxes = [BOX, small]
    views = f"views = [{numbers(table.above(0.0, 0.0))}, {numbers(table.above(-0.02, 0.01))}]\n"
    watcher = Notes()
    log = scanned(cell(tmp_path, served.address, ON_TOOL, PLANE + views + "part = 2\n"), tmp_path / "run", watcher)
    eye = table.above(0.0, 0.0) @ table.TOOL_FROM_CAMERA
    assert distance_of(log.scene.outline, table.shadow(small, eye)) < TWO_PIXELS_M
    assert sum("2 parts found: part 1 of" in note and "part 2 is scanned" in note for note in watcher.notes) == 1
    assert_is_the_box(tmp_path / "run", small)
    page = (tmp_path / "run" / "report.html").read_text("utf-8")
    assert "The 2 parts" in page
    with pytest.raises(DataError, match=r"search.part = 3, but 2 seen whole in 2 pictures: part 1 of 1\d\d x"):
        scanned(cell(tmp_path, served.address, ON_TOOL, PLANE + views + "part = 3\n"), tmp_path / "more")


def test_a_region_of_the_picture_hides_what_is_beside_the_part(served, rig, tmp_path):
    small = table.Box(-0.06, 0.05, (0.05, 0.04, 0.02), 10.0)
    rig.boxes, rig.pose = [BOX, small], table.above(0.0, 0.0)
    whole = load(cell(tmp_path, served.address, ON_TOOL))
    eye = rig.world_from_camera
    there = np.linalg.inv(eye) @ np.append(small.pose[:3, 3], 1.0)
    x, y = int(table.FX * there[0] / there[2] + table.CX), int(table.FY * there[1] / there[2] + table.CY)
    region = f"region_px = [{max(x - 40, 0)}, {max(y - 45, 0)}, 80, 90]\n"
    part = load(cell(tmp_path, served.address, ON_TOOL, PLANE + region))
    assert distance_of(found_outline(whole), table.shadow(BOX, eye)) < TWO_PIXELS_M
    assert distance_of(found_outline(part), table.shadow(small, eye)) < TWO_PIXELS_M
    beyond = load(cell(tmp_path, served.address, ON_TOOL, PLANE + "region_px = [300, 0, 80, 90]\n"))
    with pytest.raises(ConfigError, match=r"region_px .* ends at \(380, 90\), the picture has 320 x 240"):
        found_outline(beyond)


def test_a_table_whose_edges_are_seen_is_not_the_part(served, rig, tmp_path):
    """The floor beside the table fills most of the picture's rim, so that the table looks like a part that is cut."""
    settings = load(cell(tmp_path, served.address, ON_TOOL))
    eye = table.above(0.0, 0.0) @ table.TOOL_FROM_CAMERA
    image = table.picture([BOX], eye)
    image[:, :60] = image[:30] = 20
    camera_of_cell = camera_model(settings)
    frame = CameraFrame(image, 0.0, camera_of_cell, eye)
    (found,) = sightings(frame, finder(settings)(frame), settings)
    assert found.whole
    assert distance_of(found.outline, table.shadow(BOX, eye)) < TWO_PIXELS_M
    assert parts_seen([found, found]) == (found,)


def test_a_dry_run_and_the_doctor_take_a_picture_and_move_nothing(served, rig, tmp_path):
    rig.pose = table.above(0.0, 0.0)
    path = cell(tmp_path, served.address, ON_TOOL)
    outcome = dry_run(load(path), tmp_path / "dry", SilentWatcher())
    assert outcome.summary["stops"] > 50
    found = doctor(path, []).summary
    assert found["problems"] == []
    told = found["checks"]["camera"]["text"]
    assert "320 x 240 pixels, mean grey level" in told
    assert "parts seen whole: 1" in found["checks"]["search"]["text"]
    # The line that it prints makes a cell file that looks from there.
    line = found["checks"]["view"]["text"].partition("[search] ")[2]
    assert load(cell(tmp_path, served.address, ON_TOOL, f"{PLANE}{line}\n")).search.views is not None
    assert rig.moves == []


@pytest.mark.parametrize(("light", "told"), [(0.01, "too dark"), (2.0, "too bright")])
def test_the_doctor_says_when_nothing_can_be_seen(served, rig, tmp_path, light, told):
    rig.light = light
    found = doctor(cell(tmp_path, served.address, FIXED), []).summary
    assert "camera" in found["problems"]
    assert told in found["checks"]["camera"]["text"]


def test_nothing_moves_to_a_view_without_a_yes(served, rig, tmp_path):
    class Refusing(SilentWatcher):
        attended = True
        asked = ()

        def ask(self, question):
            self.asked = (*self.asked, question)
            return "no"

    user = Refusing()
    settings = load(cell(tmp_path, served.address, ON_TOOL, PLANE + VIEWS))
    with pytest.raises(InterruptError, match="has not moved"):
        acquire(settings, tmp_path / "run", user)
    assert "2 places to look for the part" in user.asked[0]
    with pytest.raises(UsageError, match="--yes"):
        acquire(settings, tmp_path / "other", SilentWatcher())
    assert rig.moves == []
    assert resume(tmp_path / "run", SilentWatcher(), yes=True).complete
    assert_is_the_box(tmp_path / "run")


def test_an_interrupted_scan_goes_on_without_looking_again(served, rig, tmp_path):
    class StopsAt(SilentWatcher):
        left = 30

        def advance(self, steps=1):
            self.left -= steps

        def stop_requested(self):
            return self.left <= 0

    path = cell(tmp_path, served.address, ON_TOOL, PLANE + VIEWS)
    assert not acquire(load(path), tmp_path / "run", StopsAt(), yes=True).complete
    pictures = rig.pictures
    assert resume(tmp_path / "run", SilentWatcher(), yes=True).complete
    assert rig.pictures == pictures
    rig.pictures = 0  # so that the pictures have the same noise
    scanned(path, tmp_path / "whole")
    one, other = nc.read(tmp_path / "run" / "surface.nc"), nc.read(tmp_path / "whole" / "surface.nc")
    np.testing.assert_array_equal(one.mask, other.mask)
    np.testing.assert_array_equal(one.height_m, other.height_m)


def test_a_wall_before_the_camera_is_as_normal_as_a_table():
    """The same geometry, turned: the plane's frame is that of a plate before the arm, v up, w at the camera."""
    frame = plane_frame(np.array([1.0, 0.0, 0.3]), np.array([-1.0, 0.0, 0.0]), None)
    np.testing.assert_allclose(frame[:3, :3], [[0, 0, -1], [-1, 0, 0], [0, 1, 0]], atol=1e-12)
    lying = plane_frame(np.zeros(3), np.array([0.0, 0.6, 0.8]), None)
    np.testing.assert_allclose(lying[:3, 0], [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.cross(lying[:3, 0], lying[:3, 1]), [0.0, 0.6, 0.8], atol=1e-12)


def test_recorded_pictures_are_a_camera_too(served, rig, tmp_path):
    rig.on_tool = False
    cv2.imwrite(str(tmp_path / "seen.png"), table.picture([BOX], table.WORLD_FROM_CAMERA))
    looking = FIXED.replace('driver = "bridge"', f'driver = "recorded"\nsource = "{tmp_path / "seen.png"}"')
    scanned(cell(tmp_path, served.address, looking), tmp_path / "run")
    assert rig.pictures == 0
    assert_is_the_box(tmp_path / "run")
    wrong = looking.replace("width_px = 320", "width_px = 322")
    with pytest.raises(DataError, match=r"320 x 240 pixels, the camera 322 x 240"):
        acquire(load(cell(tmp_path, served.address, wrong)), tmp_path / "wrong", SilentWatcher(), yes=True)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (('mounted = "fixed"\n', ""), r"camera.driver = 'bridge', but nothing says where it sits; give mounted"),
        (('mounted = "fixed"', 'mounted = "tool"'), r"camera.mounted = 'tool' without tool_from_camera"),
        (("world_from_camera = [", "world_from_camera = [0.5, "), r"the pose of the camera has 17 numbers, wanted 16"),
        (("fx_px = 300.0\n", ""), r"camera.driver = 'bridge', but fx_px of it are not given; 'surfuse calibrate"),
        (('driver = "bridge"\n', ""), r"camera.mounted = 'fixed' without the driver of a real camera"),
    ],
)
def test_a_camera_of_which_something_is_missing_is_refused(tmp_path, change, told):
    path = cell(tmp_path, "tcp://127.0.0.1:1", FIXED.replace(*change))
    with pytest.raises(ConfigError, match=told):
        load(path)


def test_a_pose_that_is_no_turn_is_refused_and_four_digits_are_enough(tmp_path):
    pose = np.array(table.WORLD_FROM_CAMERA)

    def loaded(matrix):
        looking = camera(f'mounted = "fixed"\nworld_from_camera = {numbers(matrix)}')
        return load(cell(tmp_path, "tcp://127.0.0.1:1", looking)).camera.world_from_camera

    kept = np.array(loaded(np.round(pose, 4))).reshape(4, 4)
    np.testing.assert_allclose(kept, pose, atol=2e-4)
    np.testing.assert_allclose(kept[:3, :3] @ kept[:3, :3].T, np.eye(3), atol=1e-12)
    with pytest.raises(ConfigError, match=r"not rigid: its axes are 3 off"):
        loaded(pose * np.array([[2.0], [2.0], [2.0], [1.0]]))
    with pytest.raises(ConfigError, match="left-handed"):
        loaded(pose @ np.diag([1.0, -1.0, 1.0, 1.0]))
    mirrored = pose.copy()
    mirrored[:3, 3] *= 1e3
    with pytest.raises(ConfigError, match=r"limit 30 m; give metres"):
        loaded(mirrored)


def refused(settings, folder, kind, told):
    with pytest.raises(kind, match=told):
        acquire(settings, folder, SilentWatcher(), yes=True)


def test_a_driver_or_key_that_is_not_there_is_named_with_the_nearest(served, tmp_path):
    for old, new, kind, told in (
        ('driver = "bridge"', 'driver = "bridgge"', UsageError, "did you mean 'bridge'"),
        ('driver = "bridge"', 'driver = "uvc"\nindx = 1', ConfigError, "'camera.indx'; did you mean 'index'"),
        ("cx_px", "cx_pix", ConfigError, "'camera.cx_pix'; did you mean 'cx_px'"),
    ):
        refused(load(cell(tmp_path, served.address, FIXED.replace(old, new, 1))), tmp_path / "run", kind, told)


def test_a_bridge_without_a_camera_or_of_another_size_is_refused_before_anything_moves(served, rig, tmp_path):
    settings = load(cell(tmp_path, served.address, ON_TOOL.replace("width_px = 320", "width_px = 640"), PLANE + VIEWS))
    refused(settings, tmp_path / "a", ConfigError, r"has 320 x 240 pixels, camera.width_px and height_px say 640 x 240")
    for camera_of_bridge, can in ((None, rig.can), (rig.camera, frozenset())):
        lame = table.BoxRig([BOX])
        lame.camera, lame.can = camera_of_bridge, can
        with pretended.Served(lame) as other:
            settings = load(cell(tmp_path, other.address, ON_TOOL, PLANE + VIEWS))
            refused(settings, tmp_path / f"b{len(can)}", DeviceError, r"has no camera: .*; let it answer 'image'")
        assert lame.moves == []
    assert rig.moves == []


def test_what_cannot_be_scanned_is_one_clear_error(served, rig, tmp_path):
    rig.boxes = []
    refused(
        load(cell(tmp_path, served.address, ON_TOOL, PLANE + VIEWS)),
        tmp_path / "nothing",
        DataError,
        r"no part seen in 2 pictures; the last one has grey levels 1\d\d to 1\d\d, median 1\d\d of 255; put a part",
    )
    rig.boxes, rig.pose = [table.Box(0.36, 0.0)], table.above(0.0, 0.0)
    here = load(cell(tmp_path, served.address, ON_TOOL))
    refused(here, tmp_path / "cut", DataError, r"seen in 1 picture, and the border .* cuts it in each; look from")
    rig.boxes, rig.farthest_x_m = [BOX], -0.5
    told = r"not one of \d+ stops .* the camera puts the part at \(0.0[45]\d, -0.02\d, 0.050\) m: move it into"
    refused(here, tmp_path / "far", DataError, told)
    views = load(cell(tmp_path, served.address, ON_TOOL, PLANE + VIEWS))
    refused(views, tmp_path / "views", UnreachableError, r"take none of the 2 views .*beyond the end of the rail")


def test_a_plane_that_cannot_be_is_refused(served, rig, tmp_path):
    rig.pose = table.above(0.0, 0.0)
    looking = load(cell(tmp_path, served.address, ON_TOOL, "plane = { normal = [0.0, 0.0, -1.0] }\n"))
    refused(looking, tmp_path / "down", DataError, r"mm behind the plane of the part, wanted before it; check")
    with pytest.raises(ConfigError, match=r"search.plane.normal = \[0.0, 0.0, 90.0\] has the length 90, wanted 1"):
        load(cell(tmp_path, served.address, ON_TOOL, "plane = { normal = [0.0, 0.0, 90.0] }\n"))
    with pytest.raises(ConfigError, match=r"search.plane.origin_m .* limit 30 m; give metres"):
        load(cell(tmp_path, served.address, ON_TOOL, "plane = { origin_m = [0.0, 0.0, 50.0] }\n"))
    without = load(cell(tmp_path, served.address, ON_TOOL, ""))
    refused(without, tmp_path / "without", ConfigError, r"mounted = 'tool', and nothing says how far away the part is")


class JointArm:
    """An arm that takes joints, as the one of a file."""

    def __init__(self):
        self.kinematics, self.joints = Puma560(np.eye(4), np.eye(4)), READY_RAD.copy()

    def joint_state(self):
        return JointState(self.joints, 0.0)

    def move_to(self, joints_rad, speed_share=None):
        self.joints = np.array(joints_rad)
        return self.joint_state()


def test_an_arm_of_joints_brings_its_camera_to_poses_and_to_joints(served, tmp_path):
    arm, offset = JointArm(), "position_m = [0.03, -0.02, 0.05]\n"
    grip_from_tool = np.linalg.inv(table.moved(0.03, -0.02, 0.05))
    view = arm.kinematics.forward(READY_RAD + 0.1) @ grip_from_tool

    def lookout(search):
        path = cell(tmp_path, served.address, ON_TOOL, PLANE + search)
        path.write_text(path.read_text("utf-8").replace("sigma_m = 0.001\n", f"sigma_m = 0.001\n{offset}"), "utf-8")
        settings = load(path)
        rig = real_rig(settings)
        joints = Rig(clock=rig.clock, array=rig.array, motion=JointMotion(arm))
        return real_lookout(settings, joints, SharedBridge(lambda: None), rig.clock, Recordings({}))

    seen = lookout(f"views = [{numbers(view)}]\n")
    seen.moves[0]()
    np.testing.assert_allclose(seen.place(), view @ table.TOOL_FROM_CAMERA, atol=1e-6)
    degrees = np.degrees(READY_RAD + 0.2).tolist()
    lookout(f"view_joints_deg = [{degrees}]\n").moves[0]()
    np.testing.assert_allclose(arm.joints, READY_RAD + 0.2)
    with pytest.raises(UnreachableError, match="cannot bring the grip to"):
        lookout(f"views = [{numbers(table.above(5.0, 0.0))}]\n").moves[0]()


def test_without_area_and_without_camera_the_error_says_both(served, tmp_path):
    refused(load(cell(tmp_path, served.address, "")), tmp_path / "run", ConfigError, "nothing says where to scan; add")


def test_a_shoulder_needs_joints_that_are_commanded(served, tmp_path):
    looking = camera('mounted = "shoulder"\nheight_m = 1.0\nforward_m = 0.1')
    refused(load(cell(tmp_path, served.address, looking)), tmp_path / "run", DeviceError, "does not say the joints")
