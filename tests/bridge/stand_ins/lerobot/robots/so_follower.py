"""What lerobot offers for an SO-101 follower, as far as the example uses it: degrees about the middle of the range."""

import dataclasses

from journal import fault, note

from motion import Traveller

NAMES = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")


@dataclasses.dataclass
class SO101FollowerConfig:
    port: str
    id: str | None = None
    use_degrees: bool = True
    max_relative_target: float | None = None


class SO101Follower:
    def __init__(self, config):
        self._config, self._connected = config, False
        self._servos = Traveller([0.0] * 6)

    def connect(self, calibrate=True):
        assert not calibrate, "calibration asks questions on the terminal"
        assert self._config.use_degrees
        note("connect", self._config.port, self._config.id)
        self._connected = True

    def get_observation(self):
        assert self._connected
        droop = 20.0 if fault("droop") else 0.7  # the servos hang a little under load
        angles = self._servos.where()
        angles[1] -= droop
        return {f"{name}.pos": angle for name, angle in zip(NAMES, angles, strict=True)}

    def send_action(self, action):
        assert self._connected
        assert all(key.removesuffix(".pos") in NAMES[:5] for key in action)
        note("send_action", action)
        goal = self._servos.where()
        for key, angle in action.items():
            goal[NAMES.index(key.removesuffix(".pos"))] = angle
        self._servos.go(goal, 100.0)
        return action

    def disconnect(self):
        note("disconnect")
