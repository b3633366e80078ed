"""A pretended cartesian rig behind the bridge, over the plane z = height + slope x, with faults to order.

Run as a program it serves a TCP port of this machine: `python pretended_rig.py PORT [SENSOR ...]`.
"""

from __future__ import annotations

import sys
import threading
import time

import numpy as np

from surfuse.bridge.messages import ArmKind, ArmOfBridge, BridgeReading, Hello, State, SweepAnswer
from surfuse.bridge.server import BridgeServer
from surfuse.errors import UnreachableError
from surfuse.records import Status

HEIGHT_M, SLOPE = 0.05, 0.1
LOOKING_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])


class PretendedRig:
    """`Bridgeable`; sensors look along the tool's z from `places` in its frame. Attributes may change at any time."""

    def __init__(self, sensors=("us0",), places=((0.0, 0.0, 0.0),)):
        self.sensors, self.places = tuple(sensors), [np.array(place) for place in places]
        self.pose = LOOKING_DOWN.copy()
        self.pose[:3, 3] = 0.0, 0.0, 0.6
        self.moves = self.sweeps = 0
        self.refused_x_m = np.inf
        self.ends_off_m = 0.0
        self.ends_off_at = -1
        self.drifts_m, self.drifts_at = 0.0, -1
        self.began_s = time.monotonic()

    def hello(self):
        return Hello("pretended", ArmOfBridge(ArmKind.CARTESIAN), self.sensors)

    def state(self):
        return State(time.monotonic() - self.began_s, self.pose)

    def reach(self, world_from_tool):
        return np.ones(len(world_from_tool), dtype=np.bool_)

    def move(self, to):
        if to.world_from_tool[0, 3] > self.refused_x_m:
            raise UnreachableError("beyond the end of the rail", cure="stay within")
        self.moves += 1
        self.pose = np.array(to.world_from_tool)
        if self.moves == self.ends_off_at:
            self.pose[0, 3] += self.ends_off_m
        return self.state()

    def sweep(self, sensors):
        self.sweeps += 1
        answer = SweepAnswer(tuple(self._reading(name) for name in sensors))
        if self.sweeps == self.drifts_at:
            self.pose = self.pose.copy()
            self.pose[1, 3] += self.drifts_m
        return answer

    def _reading(self, name):
        start = (self.pose @ np.append(self.places[self.sensors.index(name)], 1.0))[:3]
        axis = self.pose[:3, 2]
        # start_z + r axis_z = height + slope (start_x + r axis_x)
        range_m = (HEIGHT_M + SLOPE * start[0] - start[2]) / (axis[2] - SLOPE * axis[0])
        return BridgeReading(name, time.monotonic() - self.began_s, float(range_m), Status.OK)


class Served:
    """A rig on a port of this machine, in a thread."""

    def __init__(self, rig, port=0):
        self.server = BridgeServer(rig, f"tcp://127.0.0.1:{port}")

    def __enter__(self):
        self.server.__enter__()
        self.address = self.server.address
        self._thread = threading.Thread(target=self.server.serve_forever, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *ended):
        self.server.close()
        self._thread.join()


if __name__ == "__main__":
    names = tuple(sys.argv[2:]) or ("us0",)
    with Served(PretendedRig(names, [(0.0, 0.0, 0.0)] * len(names)), int(sys.argv[1])) as served:
        print(served.address, flush=True)
        threading.Event().wait()
