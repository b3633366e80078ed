"""Bridge to an SO-100 or SO-101 arm by the package lerobot: five joints, the gripper stays as it is.

Run: python so101_lerobot.py /dev/ttyACM0 ID, as `command` of the cell file, after `lerobot-calibrate` with the same id.
lerobot's degrees count from the middle of the calibrated range; ZERO_DEG says where the joints of your arm model have
their zero. The servos hold to a degree or two, so give the arm of the cell file `angle_tolerance_rad = 0.05`.
Checked against a stand-in with the methods of lerobot 0.4 and later. Not checked: a real arm, the zeros, the tolerance.
"""

import math
import sys
import threading
import time

from bridge_lines import RefusedError, serve
from lerobot.robots.so_follower import SO101Follower, SO101FollowerConfig

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
ZERO_DEG = (0.0, 0.0, 0.0, 0.0, 0.0)
SPEED_DEG_S, PERIOD_S = 40.0, 0.02
ARRIVED_DEG, STILL_DEG, LONGEST_S = 3.0, 0.2, 3.0
stopping = threading.Event()


def joints_deg():
    """Where the servos are, in the degrees of lerobot."""
    seen = robot.get_observation()
    return [float(seen[f"{name}.pos"]) for name in JOINTS]


def send(degrees):
    """Let the servos go there."""
    robot.send_action({f"{name}.pos": angle for name, angle in zip(JOINTS, degrees, strict=True)})


def state(ask):
    """Where the joints are."""
    angles = [math.radians(angle - zero) for angle, zero in zip(joints_deg(), ZERO_DEG, strict=True)]
    return {"t_s": time.monotonic(), "joints_rad": angles}


def move(ask):
    """In small steps, all joints together, until they stand still near the target."""
    stopping.clear()
    start = joints_deg()
    target = [math.degrees(angle) + zero for angle, zero in zip(ask["joints_rad"], ZERO_DEG, strict=True)]
    longest = max(abs(there - here) for here, there in zip(start, target, strict=True))
    steps = max(1, math.ceil(longest / (SPEED_DEG_S * ask.get("speed_share", 1.0) * PERIOD_S)))
    for step in range(1, steps + 1):
        if stopping.is_set():
            raise RefusedError("safety", "stopped on the way")
        send([here + (there - here) * step / steps for here, there in zip(start, target, strict=True)])
        time.sleep(PERIOD_S)
    began, before = time.monotonic(), joints_deg()
    while time.monotonic() - began < LONGEST_S:
        time.sleep(5 * PERIOD_S)
        now = joints_deg()
        still = max(abs(a - b) for a, b in zip(now, before, strict=True)) < STILL_DEG
        if still and max(abs(a - b) for a, b in zip(now, target, strict=True)) < ARRIVED_DEG:
            return state(ask)
        before = now
    raise RefusedError("device", f"the joints are at {now} degrees, wanted {target}")


def stop(ask):
    """Hold where it is."""
    stopping.set()
    send(joints_deg())
    return state(ask)


DO = {
    "hello": lambda ask: {"protocol": 1, "name": "SO-101", **WHAT},
    "state": state,
    "move": move,
    "stop": stop,
    "bye": lambda ask: {},
}
WHAT = {"arm": {"kind": "joints", "joints": len(JOINTS)}, "sensors": [], "camera": None, "can": ["stop"]}

robot = SO101Follower(SO101FollowerConfig(port=sys.argv[1], id=sys.argv[2], use_degrees=True))
robot.connect(calibrate=False)
serve(DO)
robot.disconnect()
