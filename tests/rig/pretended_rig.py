"""A pretended cartesian rig that says no more than it must, over the plane z = height + slope x, with faults to order.

Run as a program it serves a TCP port of this machine: `python pretended_rig.py PORT [SENSOR ...]`.
"""

from __future__ import annotations

import sys
import threading
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "bridge"))
import tilted_plane
from tilted_plane import LOOKING_DOWN, SLOPE, TiltedPlane

from surfuse.errors import UnreachableError

__all__ = ["HEIGHT_M", "LOOKING_DOWN", "SLOPE", "PretendedRig", "Served"]
HEIGHT_M = 0.05


class PretendedRig(TiltedPlane):
    """Its clock begins with it. A move beyond `refused_x_m` is refused; `ends_off_at` and `drifts_at` say which move
    ends elsewhere, and after which sweep the arm slips."""

    name, can, detailed = "pretended", frozenset(), False
    height_m = HEIGHT_M

    def __init__(self, sensors=("us0",), places=((0.0, 0.0, 0.0),)):
        super().__init__(sensors=sensors, camera=None, places=places)
        self.pose[2, 3] = 0.6
        self.clock_back_s = self.began_s = time.monotonic()
        self.refused_x_m = np.inf

    def reach(self, world_from_tool):
        return np.ones(len(world_from_tool), dtype=np.bool_)

    def move(self, to):
        if to.world_from_tool[0, 3] > self.refused_x_m:
            raise UnreachableError("beyond the end of the rail", cure="stay within")
        return super().move(to)


class Served(tilted_plane.Served):
    """A rig on a port of this machine, in a thread."""

    def __init__(self, rig, port=0):
        super().__init__(rig, f"tcp://127.0.0.1:{port}")


if __name__ == "__main__":
    names = tuple(sys.argv[2:]) or ("us0",)
    with Served(PretendedRig(names, [(0.0, 0.0, 0.0)] * len(names)), int(sys.argv[1])) as served:
        print(served.address, flush=True)
        threading.Event().wait()
