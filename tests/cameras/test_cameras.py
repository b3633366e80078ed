"""Cameras: the twin's, played back, and absent."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from surfuse.cameras import REFERENCE_MODEL, recorded, simulated, uvc
from surfuse.errors import DataError, DeviceError
from surfuse.interfaces import CameraSurroundings
from surfuse.registry import load, names

MODEL = replace(REFERENCE_MODEL, width_px=32, height_px=24)


class Ticker:
    def __init__(self):
        self.t_s = 5.0

    def now_s(self):
        return self.t_s

    def advance(self, duration_s):
        self.t_s += duration_s


class PlainWorld:
    """A world whose picture shows where the camera is."""

    def image(self, camera, world_from_camera):
        return np.full((camera.height_px, camera.width_px), int(world_from_camera[0, 3]), np.uint8)

    def ping(self, world_from_sensor, spec, pings, t_s):
        raise NotImplementedError

    def repeatability(self, joints):
        raise NotImplementedError

    def begin(self, stage, index):
        raise NotImplementedError


def twin_camera(pose, clock):
    around = simulated.Surroundings(model=MODEL, clock=clock, world=PlainWorld(), pose=pose)
    return simulated.create(simulated.Parameters(surroundings=around))


def replay(source, interval_s=0.04):
    return recorded.create(recorded.Parameters(source, interval_s, CameraSurroundings(MODEL)))


def plugged(index=0):
    return uvc.create(uvc.Parameters(index, CameraSurroundings(MODEL)))


def test_folder_holds_the_three_cameras():
    assert {"recorded", "simulated", "uvc"} <= set(names("cameras"))
    for name in ("recorded", "simulated", "uvc"):
        assert callable(load("cameras", name).create)


def test_simulated_camera_takes_the_picture_where_it_is_and_time_goes_on():
    where = np.eye(4)
    clock = Ticker()
    with twin_camera(lambda: where, clock) as camera:
        where[0, 3] = 7.0
        image, t_s = camera.capture()
        where[0, 3] = 9.0
        later, later_s = camera.capture()
    assert camera.model == MODEL
    assert (image[0, 0], later[0, 0]) == (7, 9)
    assert 5.0 < t_s < later_s


def test_folder_is_played_in_the_order_of_names_and_ends_with_an_error(tmp_path):
    for number in (2, 0, 1):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((24, 32), 10 * number, np.uint8))
    (tmp_path / "notes.txt").write_text("no picture")
    with replay(tmp_path, interval_s=0.5) as camera:
        played = [camera.capture() for _ in range(3)]
        assert [int(image[0, 0]) for image, _ in played] == [0, 10, 20]
        assert [t_s for _, t_s in played] == [0.0, 0.5, 1.0]
        with pytest.raises(DeviceError, match="no picture after 3"):
            camera.capture()
    with pytest.raises(DeviceError):
        camera.capture()


def test_opened_again_it_starts_again(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.full((24, 32), 50, np.uint8))
    camera = replay(tmp_path / "a.png")
    for _ in range(2):
        with camera:
            assert camera.capture()[0][0, 0] == 50


def test_video_is_replay(tmp_path):
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, (32, 24))
    assert writer.isOpened()
    for grey in (40, 120, 200):
        writer.write(np.full((24, 32, 3), grey, np.uint8))
    writer.release()
    with replay(path) as camera:
        greys = [float(camera.capture()[0].mean()) for _ in range(3)]
        assert greys == pytest.approx([40, 120, 200], abs=4)
        with pytest.raises(DeviceError):
            camera.capture()


def test_wrong_recordings_are_refused(tmp_path):
    with pytest.raises(DeviceError, match="no such file"), replay(tmp_path / "none"):
        pass
    with pytest.raises(DeviceError, match="no pictures"), replay(tmp_path):
        pass
    (tmp_path / "bad.png").write_bytes(b"nonsense")
    with replay(tmp_path / "bad.png") as camera, pytest.raises(DataError, match="not a picture"):
        camera.capture()
    cv2.imwrite(str(tmp_path / "big.png"), np.zeros((30, 30), np.uint8))
    with replay(tmp_path / "big.png") as camera, pytest.raises(DataError, match="30 x 30"):
        camera.capture()


def test_absent_usb_camera_names_the_cure(capfd):
    with pytest.raises(DeviceError, match="plug it in"), plugged(97):
        pass
    assert capfd.readouterr().err == ""
    with pytest.raises(DeviceError, match="not open"):
        plugged().capture()
