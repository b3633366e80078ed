"""A stand-in for OpenCV's capture: noisy pictures until it is unplugged."""

from contextlib import contextmanager
from dataclasses import replace

import cv2
import numpy as np
import pytest
from plug_in_bench import CameraBench, TickingClock

from surfuse.cameras import REFERENCE_MODEL
from surfuse.cameras.uvc import Parameters
from surfuse.interfaces import CameraSurroundings

MODEL = replace(REFERENCE_MODEL, width_px=32, height_px=24)


class Capture:
    plugged = True

    def __init__(self, index):
        self.index, self.rng = index, np.random.default_rng(1)

    def isOpened(self):
        return self.plugged and self.index == 3

    def set(self, key, value):
        return True

    def grab(self):
        return self.plugged

    def read(self):
        if not Capture.plugged:
            return False, None
        return True, self.rng.integers(0, 255, (24, 32, 3), dtype=np.uint8)

    def release(self):
        self.index = None


def unplug():
    Capture.plugged = False


@contextmanager
def bench(folder):
    Capture.plugged = True
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cv2, "VideoCapture", Capture)
        yield CameraBench(Parameters(3, CameraSurroundings(MODEL, TickingClock())), {"index": 3}, unplug)
