"""The same records as standard ROS 2 messages, so that common viewers draw them.

Frames follow sensor_msgs/Range: its sensor looks along +x, so the `<sensor>` frames of /tf carry the beam as x axis
(our own records carry it as z). Ranges keep +inf, -inf and nan (REP-117). Stamps are whole nanoseconds.
"""

from __future__ import annotations

import math
import re

import numpy as np

from surfuse.geometry.poses import FloatArray, pose
from surfuse.records import CameraFrame, SensorSpec, Sweep
from surfuse.runs.log_records import LogEvent
from surfuse.runs.own_messages import Message

_LAST_STAMP_NS = (2**31) * 10**9 - 1


def stamp_ns(t_s: float) -> int:
    """Seconds as whole nanoseconds that a ROS stamp can hold (from 0 to 2038 of a Unix clock); nan becomes 0."""
    if math.isnan(t_s):
        return 0
    return round(min(max(t_s, 0.0), _LAST_STAMP_NS / 1e9 - 1.0) * 1e9)


def _single(value: float) -> float:
    """What a float32 field will hold; beyond its range that is inf, as IEEE 754 has it."""
    with np.errstate(over="ignore"):
        return float(np.float32(value))


def _stamp(t_s: float) -> Message:
    sec, nanosec = divmod(stamp_ns(t_s), 10**9)
    return {"sec": sec, "nanosec": nanosec}


def _header(t_s: float, frame: str) -> Message:
    return {"stamp": _stamp(t_s), "frame_id": frame}


def topic_name(sensor: str) -> str:
    """A ROS topic for a sensor of any name: letters, digits and underscores only."""
    return "/range/" + (re.sub(r"[^A-Za-z0-9_]", "_", sensor) or "_")


def quaternion(rotation: FloatArray) -> tuple[float, float, float, float]:
    """Unit quaternion x, y, z, w of a rotation (3, 3), w >= 0 (Shepperd 1978: largest component first)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    squares = (1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i, 1.0 + a + e + i)
    rows = (
        (squares[0], b + d, c + g, h - f),
        (b + d, squares[1], f + h, c - g),
        (c + g, f + h, squares[2], d - b),
        (h - f, c - g, d - b, squares[3]),
    )
    x, y, z, w = rows[squares.index(max(squares))]
    scale = math.copysign(1.0 / math.sqrt(x * x + y * y + z * z + w * w), w)
    return x * scale, y * scale, z * scale, w * scale


def beam_rotation(axis: FloatArray) -> FloatArray:
    """A rotation (3, 3) whose x axis is the beam; y is horizontal wherever the beam is not vertical."""
    ax, ay, az = axis.tolist()
    # y = up x axis with up = z, or x for a vertical beam; written out because this runs for every reading.
    yx, yy, yz = (-ay, ax, 0.0) if abs(az) < 0.99 else (0.0, -az, ay)
    norm = math.sqrt(yx * yx + yy * yy + yz * yz)
    yx, yy, yz = yx / norm, yy / norm, yz / norm
    zx, zy, zz = ay * yz - az * yy, az * yx - ax * yz, ax * yy - ay * yx
    return np.array([[ax, yx, zx], [ay, yy, zy], [az, yz, zz]])


def transform(t_s: float, parent: str, child: str, parent_from_child: FloatArray) -> Message:
    """One geometry_msgs/TransformStamped.

    `parent_from_child` (4, 4) is the pose of the child frame, `t_s` the time of its header in s.
    """
    x, y, z = parent_from_child[:3, 3].tolist()
    qx, qy, qz, qw = quaternion(parent_from_child[:3, :3])
    return {
        "header": _header(t_s, parent),
        "child_frame_id": child,
        "transform": {"translation": {"x": x, "y": y, "z": z}, "rotation": {"x": qx, "y": qy, "z": qz, "w": qw}},
    }


def sweep_transforms(sweep: Sweep, specs: tuple[SensorSpec, ...]) -> Message:
    """The /tf message of a sweep: world to grip, and world to each sensor at the time of its reading."""
    t_s = float(sweep.t_s[-1]) if len(sweep.t_s) else 0.0
    grip = [transform(t_s, "world", "grip", sweep.world_from_grip)]
    sensors = [
        transform(
            float(sweep.t_s[i]),
            "world",
            specs[int(sweep.sensor[i])].name,
            pose(beam_rotation(sweep.axis[i]), sweep.position_m[i]),
        )
        for i in range(len(sweep.sensor))
    ]
    return {"transforms": grip + sensors}


def range_message(sweep: Sweep, i: int, spec: SensorSpec) -> Message:
    """Reading i of a sweep as sensor_msgs/Range (Jazzy: with variance)."""
    own = float(sweep.sigma_m[i])
    sigma = own if math.isfinite(own) and own > 0.0 else spec.sigma_m
    return {
        "header": _header(float(sweep.t_s[i]), spec.name),
        "radiation_type": 1 if spec.along_axis else 0,
        "field_of_view": _single(spec.beam_full_angle_rad),
        "min_range": _single(spec.range_min_m),
        "max_range": _single(spec.range_max_m),
        "range": _single(sweep.range_m[i]),
        "variance": _single(sigma * sigma),
    }


def joint_message(t_s: float, joints_rad: FloatArray) -> Message:
    """Joint positions (J,) at a time as sensor_msgs/JointState."""
    return {
        "header": _header(t_s, ""),
        "name": [f"joint{j + 1}" for j in range(len(joints_rad))],
        "position": joints_rad.tolist(),
        "velocity": [],
        "effort": [],
    }


def image_message(frame: CameraFrame) -> Message:
    """The pixels as sensor_msgs/Image, mono8."""
    return {
        "header": _header(frame.t_s, "camera"),
        "height": frame.camera.height_px,
        "width": frame.camera.width_px,
        "encoding": "mono8",
        "is_bigendian": 0,
        "step": frame.camera.width_px,
        "data": frame.image.tobytes(),
    }


def camera_info_message(frame: CameraFrame) -> Message:
    """The camera model as sensor_msgs/CameraInfo, plumb_bob."""
    camera = frame.camera
    k = camera.matrix
    return {
        "header": _header(frame.t_s, "camera"),
        "height": camera.height_px,
        "width": camera.width_px,
        "distortion_model": "plumb_bob",
        "d": list(camera.distortion),
        "k": k.ravel().tolist(),
        "r": np.eye(3).ravel().tolist(),
        "p": np.column_stack([k, np.zeros(3)]).ravel().tolist(),
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }


def event_log_message(event: LogEvent) -> Message:
    """An event as rcl_interfaces/msg/Log."""
    return {
        "stamp": _stamp(event.t_s),
        "level": int(event.level),
        "name": event.source,
        "msg": event.text,
        "file": "",
        "function": "",
        "line": 0,
    }
