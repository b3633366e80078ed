"""A folder of three pictures, which ends."""

from contextlib import contextmanager
from dataclasses import replace

import cv2
import numpy as np
from plug_in_bench import CameraBench

from surfuse.cameras import REFERENCE_MODEL
from surfuse.cameras.recorded import Parameters
from surfuse.interfaces import CameraSurroundings

MODEL = replace(REFERENCE_MODEL, width_px=32, height_px=24)


@contextmanager
def bench(folder):
    for number in range(3):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((24, 32), 50 * number, np.uint8))
    around = CameraSurroundings(MODEL)
    values = {"source": str(folder), "interval_s": 0.5}

    def take_away():
        for picture in folder.glob("*.png"):
            picture.unlink()

    yield CameraBench(Parameters(folder, 0.5, around), values, take_away)
