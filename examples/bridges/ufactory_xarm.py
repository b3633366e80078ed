"""Bridge to a UFACTORY xArm, Lite 6 or 850 by the package xarm-python-sdk.

Run: python ufactory_xarm.py ADDRESS_OF_ROBOT, as `command` of the cell file. World is the base frame of the robot. Set
the TCP offset so that the tool's z lies along the beams. The sensors have drivers of their own in the cell file. The
SDK speaks mm, and radians where told; its rotation is Rz(yaw) Ry(pitch) Rx(roll) (user manual, "Motion parameters").
Checked: the names and arguments of xarm-python-sdk 1.18, and all that it does on a stand-in. Not checked: a real arm,
its error codes, its speeds.
"""

import math
import sys
import time

from bridge_lines import RefusedError, serve
from xarm.wrapper import XArmAPI

SPEED_MM_S, ACCELERATION_MM_S2 = 100.0, 500.0


def sdk_pose(m):
    """Mm and rad of a pose (16 numbers, row by row)."""
    pitch = math.atan2(-m[8], math.hypot(m[0], m[4]))
    if math.hypot(m[0], m[4]) > 1e-9:
        roll, yaw = math.atan2(m[9], m[10]), math.atan2(m[4], m[0])
    else:  # straight up or down in pitch: only one of both is determined
        roll, yaw = 0.0, math.atan2(-m[1], m[5])
    return [1e3 * m[3], 1e3 * m[7], 1e3 * m[11], roll, pitch, yaw]


def pose_of(x, y, z, roll, pitch, yaw):
    """16 numbers of mm and rad."""
    (a, b, c), (sa, sb, sc) = map(math.cos, (roll, pitch, yaw)), map(math.sin, (roll, pitch, yaw))
    return [
        *(c * b, c * sb * sa - sc * a, c * sb * a + sc * sa, 1e-3 * x),
        *(sc * b, sc * sb * sa + c * a, sc * sb * a - c * sa, 1e-3 * y),
        *(-sb, b * sa, b * a, 1e-3 * z),
        *(0.0, 0.0, 0.0, 1.0),
    ]


def good(code, what):
    """Every call of the SDK gives a code; 0 is success."""
    if code != 0:
        error = arm.error_code
        raise RefusedError("safety" if error in (1, 2, 3, 22, 31) else "device", f"{what}: code {code}, error {error}")


def reachable(pose):
    """Whether the controller finds joints."""
    code, _ = arm.get_inverse_kinematics(sdk_pose(pose), input_is_radian=True, return_is_radian=True)
    return code == 0


def state(ask):
    """Where the TCP is."""
    code, where = arm.get_position(is_radian=True)
    good(code, "get_position")
    return {"t_s": time.monotonic(), "world_from_tool": pose_of(*where)}


def move(ask):
    """On a straight line, until the arm stands."""
    if not reachable(ask["world_from_tool"]):
        raise RefusedError("unreachable", "the controller finds no joints")
    x, y, z, roll, pitch, yaw = sdk_pose(ask["world_from_tool"])
    speed = SPEED_MM_S * ask.get("speed_share", 1.0)
    how = {"speed": speed, "mvacc": ACCELERATION_MM_S2, "is_radian": True, "wait": True}
    good(arm.set_position(x=x, y=y, z=z, roll=roll, pitch=pitch, yaw=yaw, **how), "set_position")
    return state(ask)


def stop(ask):
    """Stop at once; the next move may follow."""
    arm.emergency_stop()
    return state(ask)


DO = {
    "hello": lambda ask: {"protocol": 1, "name": "xArm", **WHAT},
    "state": state,
    "reach": lambda ask: {"reachable": [reachable(pose) for pose in ask["world_from_tool"]]},
    "move": move,
    "stop": stop,
    "bye": lambda ask: {},
}
WHAT = {"arm": {"kind": "cartesian"}, "sensors": [], "camera": None, "can": ["reach", "stop"]}

arm = XArmAPI(sys.argv[1], is_radian=True)
arm.motion_enable(True)
arm.set_mode(0)  # position control
arm.set_state(0)  # ready
serve(DO)
arm.disconnect()
