"""A pretended rig behind the bridge: an arm over the plane z = height + 0.1 x, camera, sensors, and faults to order.

Run as a program it serves its standard input and output, or a TCP port: `python tilted_plane.py [ADDRESS]`.
"""

from __future__ import annotations

import sys
import threading
import time

import numpy as np

from surfuse.bridge.messages import (
    Ability,
    ArmKind,
    ArmOfBridge,
    BridgeReading,
    CameraOfBridge,
    Envelope,
    Hello,
    Image,
    State,
    SweepAnswer,
)
from surfuse.bridge.server import BridgeServer, serve_stdio
from surfuse.errors import DeviceError, SafetyStopError, UnreachableError
from surfuse.records import Status

CARTESIAN = ArmOfBridge(ArmKind.CARTESIAN)
SIX_JOINTS = ArmOfBridge(ArmKind.JOINTS, 6)
SMALL = CameraOfBridge(4, 3)
SLOPE = 0.1
LOOKING_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])


def above(x_m, y_m=0.0, z_m=0.5):
    pose = LOOKING_DOWN.copy()
    pose[:3, 3] = x_m, y_m, z_m
    return pose


class TiltedPlane:
    """`Bridgeable`. Attributes may be changed while it is served.

    Sensors look along the tool's z from `places` in its frame, by default one a centimetre behind the other.
    """

    name, can, detailed = "tilted plane", frozenset(Ability) - {Ability.STREAMS}, True
    height_m = 0.0

    def __init__(self, arm=CARTESIAN, sensors=("us0", "us1"), camera=SMALL, places=None):
        self.arm, self.sensors, self.camera = arm, tuple(sensors), camera
        behind = [(0.0, 0.0, -0.01 * k) for k in range(len(self.sensors))]
        self.places = [np.array(place) for place in places or behind]
        self.pose, self.joints = above(0.0), np.zeros(6)
        self.clock_back_s = 0.0
        self.ends_off_m, self.ends_off_at = 0.0, None
        self.drifts_m, self.drifts_at = 0.0, -1
        self.move_takes_s = 0.0
        self.moves, self.sweeps, self.stops = 0, 0, 0
        self.status = Status.OK
        self.trouble = None
        self.stopping = threading.Event()

    def now_s(self):
        return time.monotonic() - self.clock_back_s

    def hello(self):
        return Hello(self.name, self.arm, self.sensors, self.camera, self.can)

    def state(self):
        self._fail()
        joints = self.joints if self.arm == SIX_JOINTS else None
        return State(self.now_s(), self.pose, joints)

    def reach(self, world_from_tool):
        return np.abs(world_from_tool[:, 0, 3]) <= 1.0

    def move(self, to):
        self._fail()
        self.moves += 1
        self.stopping.clear()
        if self.stopping.wait(self.move_takes_s):
            raise SafetyStopError("stopped on the way")
        if to.joints_rad is not None:
            self.joints = np.array(to.joints_rad)
        else:
            if abs(to.world_from_tool[0, 3]) > 1.0:
                raise UnreachableError("x is beyond 1 m", cure="stay within")
            self.pose = np.array(to.world_from_tool)
            if self.ends_off_at in (None, self.moves):
                self.pose[0, 3] += self.ends_off_m
        return self.state()

    def sweep(self, sensors):
        self._fail()
        self.sweeps += 1
        answer = SweepAnswer(tuple(self._reading(name) for name in reversed(sensors)))
        if self.sweeps == self.drifts_at:
            self.pose = self.pose.copy()
            self.pose[1, 3] += self.drifts_m
        return answer

    def image(self):
        return Image(self.now_s(), np.arange(12, dtype=np.uint8).reshape(3, 4))

    def stop(self):
        self.stops += 1
        self.stopping.set()
        return State(self.now_s(), self.pose, self.joints)

    def _reading(self, name):
        if self.status is not Status.OK:
            ranges = {Status.NO_ECHO: np.inf, Status.TOO_CLOSE: -np.inf, Status.FAULT: np.nan}
            return BridgeReading(name, self.now_s(), ranges[self.status], self.status)
        start, axis = (self.pose @ np.append(self.places[self.sensors.index(name)], 1.0))[:3], self.pose[:3, 2]
        # start_z + r axis_z = height + slope (start_x + r axis_x)
        range_m = float((self.height_m + SLOPE * start[0] - start[2]) / (axis[2] - SLOPE * axis[0]))
        if not self.detailed:
            return BridgeReading(name, self.now_s(), range_m, Status.OK)
        envelope = Envelope(0.1, 0.001, np.linspace(0.0, 1.0, 50, dtype=np.float32))
        return BridgeReading(name, self.now_s(), range_m, Status.OK, 0.7, 3e-4, ((range_m, 0.7), (0.9, 0.1)), envelope)

    def _fail(self):
        if self.trouble is not None:
            raise self.trouble


class Served:
    """The rig on a free port of this machine, in a thread."""

    def __init__(self, rig, address="tcp://127.0.0.1:0"):
        self.server = BridgeServer(rig, address)

    def __enter__(self):
        self.server.__enter__()
        self.address = self.server.address
        self._thread = threading.Thread(target=self.server.serve_forever, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *error):
        self.server.close()
        self._thread.join()


if __name__ == "__main__":
    rig = TiltedPlane()
    print("tilted plane comes up", file=sys.stderr, flush=True)
    if "dies" in sys.argv:
        print("the motor is on fire\x1b[31m", file=sys.stderr, flush=True)
        sys.exit(7)
    if "fails" in sys.argv:
        rig.trouble = DeviceError("the gripper is stuck")
    addresses = [word for word in sys.argv[1:] if word.startswith("tcp://")]
    if addresses:
        with BridgeServer(rig, addresses[0]) as server:
            print(server.address, flush=True)
            server.serve_forever()
    else:
        print("a library says hello on standard output")
        serve_stdio(rig)
