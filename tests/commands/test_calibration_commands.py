"""`surfuse calibrate` through the real command line: pictures, camera, shoulder, and bad input."""

import json
import sys

import cv2
import numpy as np
import pytest

from surfuse.cli import main
from surfuse.commands.calibrate.hand_eye import POSE_COLUMNS
from surfuse.geometry.poses import inverse, pose, rotation_about
from surfuse.rig.description import camera_model
from surfuse.rig.mounts import Mount, looking_outwards, mount_of
from surfuse.rig.simulated.board_pictures import seen_board
from surfuse.settings import load
from surfuse.vision.calibration_target import Target

TRUTH = """
[camera]
cx_px = 255.0
cy_px = 284.0
distortion = [-0.12, 0.03, 0.0005, -0.0005, 0.0]
left_m = 0.012
yaw_deg = -1.5
pitch_deg = 2.0
roll_deg = 0.7
[ranger]
forward_m = 0.13
"""


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


@pytest.mark.parametrize("fixed", [False, True])
def test_a_camera_on_the_tool_and_a_fixed_one_from_a_table_of_poses(surfuse, tmp_path, fixed):
    """Pictures of the twin's board; the answer is the table of a cell file."""
    (tmp_path / "camera.toml").write_text("[camera]\ncx_px = 255.0\ncy_px = 284.0\n")
    camera, target = camera_model(load(tmp_path / "camera.toml")), Target("checkerboard", 9, 7, 0.03)
    down = np.diag([1.0, -1.0, -1.0])
    true = pose(rotation_about([0, 0, 1], 0.3) @ (down if fixed else np.eye(3)), [0.05, -0.02, 0.9 if fixed else 0.03])
    # Its z points away from the camera: into the table, or into the tool that holds it up.
    board = pose(down, [-0.13, 0.1, 0.05])
    turns = [(0, 0, 0), (0.3, 0, 0.1), (-0.3, 0.1, 0), (0, 0.3, -0.2), (0.1, -0.3, 0.3), (0.2, 0.2, 0)]
    lines = ["image," + ",".join(POSE_COLUMNS)]
    for k, (a, b, c) in enumerate(turns):
        turn = rotation_about([0, 0, 1], c) @ rotation_about([1, 0, 0], a) @ rotation_about([0, 1, 0], b)
        tool = pose(turn, [0.0, 0.0, 0.2]) if fixed else pose(down @ turn, [0.0, 0.0, 0.05] - 0.7 * (down @ turn)[:, 2])
        seen = inverse(true) @ tool @ board if fixed else inverse(tool @ true) @ board
        cv2.imwrite(str(tmp_path / f"{k}.png"), seen_board(camera, target, seen, np.random.default_rng(k)))
        lines.append(f"{k}.png," + ",".join(f"{value:.8f}" for value in tool.ravel()))
    (tmp_path / "views.csv").write_text("\n".join(lines))
    arguments = ["calibrate", "hand-eye", tmp_path / "views.csv", "--camera", tmp_path / "camera.toml"]
    arguments += ["--out", tmp_path / "placed.toml", *(["--fixed"] if fixed else [])]
    status, out, err = surfuse(*arguments, "--json")
    assert (status, err) == (0, "")
    key = "world_from_camera" if fixed else "tool_from_camera"
    np.testing.assert_allclose(np.reshape(json.loads(out)[key], (4, 4)), true, atol=0.003)
    found = load(tmp_path / "placed.toml").camera
    assert (found.driver, found.mounted) == ("bridge", "fixed" if fixed else "tool")
    np.testing.assert_allclose(np.reshape(getattr(found, key), (4, 4)), true, atol=0.003)
    status, out, _ = surfuse(*arguments, "--force")
    assert f"{key} = [" in out
    (tmp_path / "views.csv").write_text("\n".join(line.rpartition(",")[0] for line in lines))
    status, _, err = surfuse(*arguments, "--force")
    assert status == 3
    assert "no column m33" in err


def test_from_pictures_to_cell_file(surfuse, tmp_path):
    cell, views, turned = tmp_path / "true.toml", tmp_path / "views", tmp_path / "turned"
    cell.write_text(TRUTH)
    assert surfuse("calibrate", "pictures", views, "--cell", cell, "--count", 7)[0] == 0
    status, out, err = surfuse(
        "calibrate", "camera", *sorted(views.iterdir()), "--out", tmp_path / "camera.toml", "--json"
    )
    assert (status, err) == (0, "")
    result = json.loads(out)
    assert result["camera"]["fx_px"] == pytest.approx(520.0, abs=1.0)
    assert result["camera"]["cy_px"] == pytest.approx(284.0, abs=1.0)
    assert result["reprojection_px"] < 0.1
    status, out, _ = surfuse(
        "calibrate", "pictures", turned, "--of", "shoulder", "--cell", cell, "--count", 5, "--json"
    )
    corner = ",".join(map(str, json.loads(out)["first_corner_m"]))
    arguments = ["calibrate", "shoulder", turned / "views.csv", "--corner", corner, "--out", tmp_path / "shoulder.toml"]
    status, out, err = surfuse(*arguments, "--camera", tmp_path / "camera.toml", "--json")
    assert (status, err) == (0, "")
    found = load(tmp_path / "shoulder.toml")
    assert found.camera.forward_m == pytest.approx(0.10, abs=0.002)
    assert found.camera.left_m == pytest.approx(0.012, abs=0.002)
    assert found.camera.height_m == pytest.approx(1.30, abs=0.002)
    assert [found.camera.yaw_deg, found.camera.pitch_deg, found.camera.roll_deg] == pytest.approx(
        [-1.5, 2.0, 0.7], abs=0.15
    )
    assert found.ranger.forward_m == pytest.approx(0.13, abs=0.005)
    assert surfuse(*arguments)[0] == 6
    # The reference camera is not this one, and the fit says so.
    status, _, err = surfuse(*arguments, "--force")
    assert status == 3
    assert "px" in err


def blank(path, size=(40, 50)):
    assert cv2.imwrite(str(path), np.full(size, 100, np.uint8))
    return path


def test_bad_sets_of_pictures(surfuse, tmp_path):
    one, other = blank(tmp_path / "a.png"), blank(tmp_path / "b.png", (60, 60))
    out = tmp_path / "camera.toml"
    for arguments, status, word in (
        ([one], 3, "0 usable views"),
        ([one, other], 3, "60 x 60"),
        ([tmp_path / "none.png"], 3, "none.png"),
        ([], 2, "images"),
    ):
        done = surfuse("calibrate", "camera", *arguments, "--out", out)
        assert (done[0], done[1], done[2].count("\n")) == (status, "", 1)
        assert word in done[2]
        assert not out.exists()
    assert surfuse("calibrate", "camera", one, "--out", tmp_path / "camera.txt")[0] == 2
    assert surfuse("calibrate", "camera", one, "--out", out, "--columns", 2)[0] == 3
    assert surfuse("calibrate", "camra", one, "--out", out)[0] == 2


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "image"),
        ("image,angle\nx.png,1\n", "joint1_deg"),
        ("image,joint1_deg\n", "no rows"),
        ("image,joint1_deg\nx.png,\n", "v.csv:2"),
        ("image,joint1_deg\nx.png,left\n", "'left'"),
        ("image,joint1_deg\n,3\n", "no picture"),
        ("image,joint1_deg,range_m\na.png,3,far\n", "'far'"),
        ("image,joint1_deg\na.png,3\n", "the camera has 500 x 582"),
        ("image,joint1_deg\nmissing.png,3\n", "missing.png"),
    ],
)
def test_bad_tables_of_views(surfuse, tmp_path, text, word):
    blank(tmp_path / "a.png")
    table = tmp_path / "v.csv"
    table.write_text(text)
    status, out, err = surfuse("calibrate", "shoulder", table, "--corner", "1,0,1.4", "--out", tmp_path / "s.toml")
    assert (status, out, err.count("\n")) == (3, "", 1)
    assert word in err


def test_bad_corner(surfuse, tmp_path):
    for corner in ("1,2", "a,b,c", "1,2,nan"):
        assert surfuse("calibrate", "shoulder", "v.csv", "--corner", corner, "--out", tmp_path / "s.toml")[0] == 2


def test_mount_and_pose_are_one_thing():
    mount = Mount(0.1, 1.3, -0.02, 0.3, -0.2, 0.1)
    again = mount_of(mount.shoulder_from_device)
    assert [again.yaw_rad, again.pitch_rad, again.roll_rad] == pytest.approx([0.3, -0.2, 0.1])
    assert (again.forward_m, again.left_m, again.height_m) == (0.1, -0.02, 1.3)
    down = Mount(0.0, 0.0, pitch_rad=0.1).shoulder_from_device[:3, 2]
    assert down[2] == pytest.approx(-np.sin(0.1))
    left = Mount(0.0, 0.0, yaw_rad=0.1).shoulder_from_device[:3, 2]
    assert left[1] == pytest.approx(np.sin(0.1))
    straight = [[0, 0, 1, 0.1], [-1, 0, 0, 0], [0, -1, 0, 1.3], [0, 0, 0, 1]]
    assert np.array_equal(looking_outwards(0.1, 1.3), np.array(straight))
