"""What ur_rtde 1.6 offers in RTDEControlInterface, as far as the example uses it: m, rotation vectors in rad."""

import math

import ur_controller
from journal import fault, note


class RTDEControlInterface:
    def __init__(self, hostname, frequency=-1.0):
        note("connect", hostname)
        self._pending = 0

    def getInverseKinematicsHasSolution(self, x, qnear=(), max_position_error=1e-10, max_orientation_error=1e-10):
        return math.hypot(*_six(x)[:3]) <= 0.85

    def isPoseWithinSafetyLimits(self, pose):
        return _six(pose)[2] > 0.0

    def moveL(self, pose, speed=0.25, acceleration=1.2, asynchronous=False):
        assert type(asynchronous) is bool
        assert asynchronous, "a blocking move could not be stopped"
        note("moveL", _six(pose), speed, acceleration)
        if fault("protective stop"):
            ur_controller.STOPPED.append(True)
            return False
        ur_controller.ROBOT.go(pose[:3], speed)
        ur_controller.TURN[:] = pose[3:]
        return True

    def getAsyncOperationProgress(self):
        return 0 if ur_controller.ROBOT.moves() else -1

    def isSteady(self):
        return not ur_controller.ROBOT.moves()

    def stopL(self, a=10.0, asynchronous=False):
        note("stopL", a)
        ur_controller.ROBOT.halt()

    def stopScript(self):
        note("stopScript")


def _six(pose):
    assert isinstance(pose, list)
    assert len(pose) == 6
    return [float(number) for number in pose]
