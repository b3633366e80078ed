"""What ur_rtde 1.6 offers in RTDEReceiveInterface, as far as the example uses it."""

import time

import ur_controller


class RTDEReceiveInterface:
    def __init__(self, hostname, frequency=-1.0):
        self._began_s = time.monotonic()

    def getTimestamp(self):
        return time.monotonic() - self._began_s

    def getActualTCPPose(self):
        return [*ur_controller.ROBOT.where(), *ur_controller.TURN]

    def isProtectiveStopped(self):
        return bool(ur_controller.STOPPED)

    def isEmergencyStopped(self):
        return False

    def isConnected(self):
        return True
