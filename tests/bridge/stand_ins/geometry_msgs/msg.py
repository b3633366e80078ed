"""Messages as rclpy makes them: fields with defaults, numbers only where numbers belong."""

from typing import ClassVar


class _Numbers:
    _fields: ClassVar = {}

    def __init__(self):
        for name, value in self._fields.items():
            object.__setattr__(self, name, value)

    def __setattr__(self, name, value):
        assert name in self._fields, name
        assert isinstance(value, float), f"{name} must be a float"
        object.__setattr__(self, name, value)


class Point(_Numbers):
    _fields: ClassVar = {"x": 0.0, "y": 0.0, "z": 0.0}


class Quaternion(_Numbers):
    _fields: ClassVar = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


class Pose:
    def __init__(self):
        self.position, self.orientation = Point(), Quaternion()


class Header:
    def __init__(self):
        self.frame_id = ""


class PoseStamped:
    def __init__(self):
        self.header, self.pose = Header(), Pose()
