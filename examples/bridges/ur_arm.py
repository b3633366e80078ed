"""Bridge to a Universal Robots arm by the package ur-rtde; the controller solves its own inverse kinematics.

Run: python ur_arm.py ADDRESS_OF_ROBOT, as `command` of the cell file. World is the base frame of the robot. Set the TCP
on the controller so that its z lies along the beams. The sensors have drivers of their own in the cell file.
Checked: the names and arguments of ur-rtde 1.6, and all that it does on a stand-in. Not checked: a real arm, URSim.
"""

import math
import sys
import time

from bridge_lines import RefusedError, serve
from rotations import pose_of_vector, rotation_vector
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

SPEED_M_S, ACCELERATION_M_S2 = 0.25, 0.5


def tcp_of(pose):
    """m, and the rotation vector in rad, as the controller wants them."""
    return [pose[3], pose[7], pose[11], *rotation_vector(pose)]


def reachable(pose):
    """Whether the controller knows joints for it, and its safety planes allow it."""
    tcp = tcp_of(pose)
    return bool(control.getInverseKinematicsHasSolution(tcp) and control.isPoseWithinSafetyLimits(tcp))


def check():
    """Say so when the controller has stopped the arm."""
    if receive.isProtectiveStopped() or receive.isEmergencyStopped():
        raise RefusedError("safety", "the controller has stopped the arm")
    if not receive.isConnected():
        raise RefusedError("device", "the controller sends no data")


def state(ask):
    """Time of the controller and pose of the TCP."""
    check()
    tcp = receive.getActualTCPPose()
    return {"t_s": receive.getTimestamp(), "world_from_tool": pose_of_vector(tcp[:3], tcp[3:])}


def move(ask):
    """On a straight line, until the arm stands."""
    check()
    if not reachable(ask["world_from_tool"]):
        raise RefusedError("unreachable", "no joints within the safety limits")
    tcp, began = tcp_of(ask["world_from_tool"]), time.monotonic()
    if not control.moveL(tcp, SPEED_M_S * ask.get("speed_share", 0.5), ACCELERATION_M_S2, True):
        check()
        raise RefusedError("device", "the controller does not take the move")
    while control.getAsyncOperationProgress() >= 0 or not control.isSteady() or not_begun(tcp, began):
        check()
        time.sleep(0.01)
    return state(ask)


def not_begun(tcp, began):
    """Whether the arm is away from its target because the controller has not yet started."""
    return time.monotonic() - began < 1.0 and math.dist(receive.getActualTCPPose()[:3], tcp[:3]) > 1e-3


def stop(ask):
    """A controlled stop on the line."""
    control.stopL(2.0)
    return state(ask)


DO = {
    "hello": lambda ask: {"protocol": 1, "name": "Universal Robots", **WHAT},
    "state": state,
    "reach": lambda ask: {"reachable": [reachable(pose) for pose in ask["world_from_tool"]]},
    "move": move,
    "stop": stop,
    "bye": lambda ask: {},
}
WHAT = {"arm": {"kind": "cartesian"}, "sensors": [], "camera": None, "can": ["reach", "stop"]}

control, receive = RTDEControlInterface(sys.argv[1]), RTDEReceiveInterface(sys.argv[1])
serve(DO)
control.stopScript()
