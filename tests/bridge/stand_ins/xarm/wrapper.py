"""What xarm-python-sdk offers in XArmAPI, as far as the example uses it: mm, degrees unless is_radian."""

import math
import time

from journal import fault, note

from motion import Traveller

print("SDK_VERSION: 1.18.4")  # as the real one does


class XArmAPI:
    def __init__(self, port=None, is_radian=False, do_not_open=False):
        note("connect", port)
        self.default_is_radian = is_radian
        self.error_code = 0
        self._tcp, self._turn, self._stopped = Traveller([400.0, 0.0, 400.0]), [math.pi, 0.0, 0.0], False
        self._enabled, self._mode, self._state = False, None, 4

    def motion_enable(self, enable=True, servo_id=None):
        self._enabled = enable
        return 0

    def set_mode(self, mode=0):
        self._mode = mode
        return 0

    def set_state(self, state=0):
        self._state = state
        return 0

    def get_position(self, is_radian=None):
        return 0, [*self._tcp.where(), *self._angles(self._turn, is_radian)]

    def get_inverse_kinematics(self, pose, input_is_radian=None, return_is_radian=None):
        assert len(pose) == 6
        return (0, [0.0] * 7) if math.hypot(*pose[:3]) <= 700.0 else (-2, [])

    def set_position(self, x=None, y=None, z=None, roll=None, pitch=None, yaw=None, radius=None, speed=None, **how):
        assert set(how) == {"mvacc", "is_radian", "wait"}
        assert how["is_radian"] is True
        if not (self._enabled and self._mode == 0 and self._state == 0):
            return 9  # not ready to move
        note("set_position", [x, y, z, roll, pitch, yaw], speed)
        if fault("collision"):
            self.error_code = 31
            return 1
        self._stopped = False
        self._tcp.go([x, y, z], speed)
        self._turn = [roll, pitch, yaw]
        while how["wait"] and self._tcp.moves():
            time.sleep(0.005)
        return -8 if self._stopped else 0  # -8: emergency stop

    def emergency_stop(self):
        note("emergency_stop")
        self._stopped = True
        self._tcp.halt()

    def disconnect(self):
        note("disconnect")

    def _angles(self, turn, is_radian):
        radian = self.default_is_radian if is_radian is None else is_radian
        return turn if radian else [math.degrees(angle) for angle in turn]
