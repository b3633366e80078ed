"""Whole scans that begin with a picture: of a camera on the tool of an arm of joints, and of a USB camera."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import cv2
import numpy as np
import pytest

from surfuse.bridge.messages import ArmKind, ArmOfBridge, Hello, State
from surfuse.commands.acquire.acquisition import acquire, resume
from surfuse.commands.acquire.consent import FIRST_MOVES_SHARE
from surfuse.commands.machine.doctor import doctor
from surfuse.commands.outcome import SilentWatcher
from surfuse.errors import DeviceError
from surfuse.rig.real.camera import LOOKING_SHARE
from surfuse.runs.log_reader import read_log
from surfuse.settings import load

HERE = Path(__file__).parent


def module_of(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


looking = module_of(HERE / "test_camera_of_a_real_rig.py")
table, pretended = looking.table, looking.pretended
BASE = table.moved(-0.45, 0.0, 0.0)
EYES = (table.above(-0.15, 0.15), table.above(0.0, 0.0))
VIEWS = f"views = [{', '.join(looking.numbers(view) for view in EYES)}]\n"


class JointBoxRig(table.BoxRig):
    """The box before an arm of which the bridge knows the joints alone; `shares` are those of its moves."""

    def __init__(self, kinematics, ready_rad):
        super().__init__([looking.BOX])
        self.can = self.can - {looking.table.Ability.REACH}
        self.kinematics, self.joints_rad, self.shares = kinematics, ready_rad, []
        self.pose = kinematics.forward(ready_rad)

    def hello(self):
        return Hello("joints", ArmOfBridge(ArmKind.JOINTS, len(self.joints_rad)), ("spot",), self.camera, self.can)

    def state(self):
        return State(self._now_s(), None, self.joints_rad)

    def move(self, to):
        self.joints_rad, self.pose = np.array(to.joints_rad), self.kinematics.forward(to.joints_rad)
        self.moves.append(self.pose)
        self.shares.append(to.speed_share)
        return self.state()


@pytest.fixture
def arm_of_joints(tmp_path):
    pytest.importorskip("mujoco")
    from surfuse.arm_models import model_file

    file = tmp_path / "arm.urdf"
    file.write_text(module_of(HERE.parent / "arms" / "test_model_file.py").seven(), "utf-8")
    kinematics = model_file.create(file, "tool", BASE, np.eye(4))
    there, _ = kinematics.inverse(table.above(-0.1, 0.1, 0.5)[None])
    rig = JointBoxRig(kinematics, there[~np.isnan(there).any(axis=-1)][0])
    return rig, f'file = "{file}"\ntool = "tool"\nworld_from_base = {looking.numbers(BASE)}\n'


@pytest.mark.parametrize("by", ["poses", "joints"])
def test_a_camera_on_the_tool_of_an_arm_of_joints_finds_the_part_that_is_scanned(arm_of_joints, tmp_path, by):
    rig, keys = arm_of_joints
    views = VIEWS
    if by == "joints":
        found = [
            solutions[~np.isnan(solutions).any(axis=-1)][0] for solutions in rig.kinematics.inverse(np.array(EYES))[0]
        ]
        views = f"view_joints_deg = {np.degrees(found).tolist()}\n"
    with pretended.Served(rig) as served:
        path = looking.cell(tmp_path, served.address, looking.ON_TOOL, looking.PLANE + views)
        path.write_text(path.read_text("utf-8").replace("[arm]\n", f"[arm]\n{keys}"), "utf-8")
        log = looking.scanned(path, tmp_path / "run")
    assert len(log.frames) == 1
    eye = EYES[1] @ table.TOOL_FROM_CAMERA
    np.testing.assert_allclose(log.frames[0].world_from_camera, eye, atol=1e-6)
    assert looking.distance_of(log.scene.outline, table.shadow(looking.BOX, eye)) < looking.TWO_PIXELS_M
    looking.assert_is_the_box(tmp_path / "run")
    for reached, view in zip(rig.moves, EYES, strict=False):
        np.testing.assert_allclose(reached, view, atol=1e-6)
    # To both views and to where the scan begins it goes slowly, then as fast as the bridge likes.
    assert rig.shares[:3] == [LOOKING_SHARE, LOOKING_SHARE, FIRST_MOVES_SHARE]
    assert set(rig.shares[3:]) == {None}
    assert len(log.sweeps[0].joints_rad) == 7


def test_the_doctor_says_how_an_arm_of_joints_looks_from_where_it_stands(arm_of_joints, tmp_path):
    rig, keys = arm_of_joints
    with pretended.Served(rig) as served:

        def cell(search):
            path = looking.cell(tmp_path, served.address, looking.ON_TOOL, looking.PLANE + search)
            path.write_text(path.read_text("utf-8").replace("[arm]\n", f"[arm]\n{keys}"), "utf-8")
            return path

        line = doctor(cell(""), []).summary["checks"]["view"]["text"].partition("[search] ")[2]
        assert rig.moves == []
        (view,) = load(cell(f"{line}\n")).search.view_joints_deg
        assert "view" not in doctor(cell(f"{line}\n"), []).summary["checks"]
    np.testing.assert_allclose(view, np.degrees(rig.joints_rad), atol=1e-6)


@pytest.fixture
def usb(monkeypatch):
    """A USB camera, number 3, of a rig that is still to be named; what it sees is no business of the bridge."""

    class Capture:
        rig, plugged = None, True

        def __init__(self, index):
            self.index = index

        def isOpened(self):
            return self.plugged and self.index == 3

        def set(self, key, value):
            return True

        def grab(self):
            return self.plugged

        def read(self):
            if not self.plugged:
                return False, None
            rig = Capture.rig
            rig.pictures += 1
            seen = table.picture(rig.boxes, rig.world_from_camera, seed=rig.pictures)
            return True, cv2.cvtColor(seen, cv2.COLOR_GRAY2BGR)

        def release(self):
            pass

    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    return Capture


@pytest.fixture
def without_camera(usb):
    rig = usb.rig = table.BoxRig([looking.BOX])
    rig.camera, rig.can = None, rig.can - {table.Ability.IMAGE}
    with pretended.Served(rig) as served:
        yield rig, served.address


def usb_cell(folder, address, on_tool=True, index=3):
    place = looking.ON_TOOL if on_tool else looking.FIXED
    views = VIEWS if on_tool else ""
    of_usb = place.replace('driver = "bridge"', f'driver = "uvc"\nindex = {index}')
    return looking.cell(folder, address, of_usb, looking.PLANE + views)


@pytest.mark.parametrize("on_tool", [True, False])
def test_a_usb_camera_finds_the_part_that_is_scanned(without_camera, tmp_path, on_tool):
    rig, address = without_camera
    rig.on_tool = on_tool
    log = looking.scanned(usb_cell(tmp_path, address, on_tool), tmp_path / "run")
    eye = EYES[-1] @ table.TOOL_FROM_CAMERA if on_tool else table.WORLD_FROM_CAMERA
    assert looking.distance_of(log.scene.outline, table.shadow(looking.BOX, eye)) < looking.TWO_PIXELS_M
    looking.assert_is_the_box(tmp_path / "run")
    assert rig.pictures >= 1


def test_the_doctor_looks_through_a_usb_camera_and_says_when_it_is_not_there(without_camera, usb, tmp_path):
    rig, address = without_camera
    rig.pose = table.above(0.0, 0.0)
    found = doctor(usb_cell(tmp_path, address), []).summary
    assert found["problems"] == []
    assert "320 x 240 pixels, mean grey level" in found["checks"]["camera"]["text"]
    assert "parts seen whole: 1" in found["checks"]["search"]["text"]
    missing = doctor(usb_cell(tmp_path, address, index=4), []).summary
    assert missing["problems"]
    assert any("camera 4" in check["text"] for check in missing["checks"].values())
    assert rig.moves == []


def test_a_usb_camera_that_is_pulled_out_ends_the_search_and_a_later_one_goes_on(
    without_camera, usb, tmp_path, monkeypatch
):
    rig, address = without_camera
    path, taken = usb_cell(tmp_path, address), rig.move

    def pulled_out(to):
        usb.plugged = False
        return taken(to)

    monkeypatch.setattr(rig, "move", pulled_out)
    with pytest.raises(DeviceError, match=r"camera 3.*stopped answering") as gone:
        acquire(load(path), tmp_path / "run", SilentWatcher(), yes=True)
    assert gone.value.exit_status == 4
    monkeypatch.setattr(rig, "move", taken)
    usb.plugged = True
    assert resume(tmp_path / "run", SilentWatcher(), yes=True).complete
    assert len(read_log(tmp_path / "run").frames) == 1
    looking.assert_is_the_box(tmp_path / "run")
