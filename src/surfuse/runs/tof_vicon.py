"""Import of time-of-flight frames of 8 x 8 zones with motion-capture poses of their carrier and of a flat target.

A folder holds `state_ToF.csv` (blocks of 65 rows: `t_ms,0,0`, then 64 rows `distance_mm,targets,status`) and
`state_Vicon.csv` (`name,t_ms,position x y z in m,quaternion w x y z`; names `Drone` and `Surface`). The 64 zones
become 64 sensors. Recorded by ETH-PBL/Matrix_ToF_Drones with an ST VL53L5CX, whose data sheet (DS13754) gives the
field of view of 45 x 45 degrees. The sensor reports the distance along its optical axis (the other reading of the
numbers, along the zone, leaves twice the scatter about the target); it is turned into a range along the zone here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surfuse.errors import DataError
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import FloatArray, IntArray, Readings, SensorSpec, Status
from surfuse.runs.log_files import read_whole
from surfuse.runs.scan_log import ScanLog
from surfuse.runs.sweep_grouping import estimate_part_frame

TOF_NAME, POSES_NAME = "state_ToF.csv", "state_Vicon.csv"
SIDE = 8
FIELD_DEG = 45.0
VALID_STATUS = (5, 9)
FARTHEST_M = 4.0
MOUNT_PITCH_RAD, MOUNT_YAW_RAD = -0.085, 0.028
"""How the sensor sits in the frame of the carrier's markers: fitted to the target in both published recordings."""
TARGET_HALF_M = 0.35
"""Half the side of the flat target, from where its echoes end."""


@dataclass(frozen=True)
class Track:
    """Poses of one body: times (K,) strictly increasing in s, positions (K, 3), unit quaternions (K, 4) w x y z.

    The quaternions turn vectors of the body into the world; positions in m in the world.
    """

    t_s: FloatArray
    position_m: FloatArray
    quaternion: FloatArray

    def at(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions (N, 3) and rotations (N, 3, 3) at times (N,): linear, and normalised linear between quaternions."""
        place = np.column_stack([np.interp(t_s, self.t_s, self.position_m[:, i]) for i in range(3)])
        turned = np.column_stack([np.interp(t_s, self.t_s, self.quaternion[:, i]) for i in range(4)])
        return place, rotations(turned / np.linalg.norm(turned, axis=1, keepdims=True))


@dataclass(frozen=True)
class TofScan:
    """The scan, and the flat target by motion capture: its centre (3,) and its normal (3,) towards the carrier.

    `target_m` in m; both in the world frame of the motion capture.
    """

    scan: ScanLog
    target_m: FloatArray
    normal: FloatArray

    def target_mesh(self) -> tuple[FloatArray, IntArray]:
        """The target as a square of two triangles: vertices (4, 3) in the world, faces (2, 3)."""
        side = np.cross([0.0, 0.0, 1.0], self.normal)
        side = TARGET_HALF_M * side / np.linalg.norm(side)
        up = TARGET_HALF_M * np.cross(self.normal, side / np.linalg.norm(side))
        corners = self.target_m + np.array([-side - up, side - up, side + up, -side + up])
        return corners, np.array([[0, 1, 2], [0, 2, 3]])


def is_tof_vicon(folder: Path) -> bool:
    """Whether a folder holds the two files of such a recording."""
    return (folder / TOF_NAME).is_file() and (folder / POSES_NAME).is_file()


def zone_directions() -> FloatArray:
    """Directions (64, 3) of the zones in the carrier's frame (x forward, y left, z up); length 1 / cos(off-axis angle).

    Zone 0 looks down and left; the zones of a row follow one another to the right, the rows upwards (fitted to the
    recordings: the three other ways to turn the matrix leave a larger scatter about the target).
    """
    tangent = np.tan(np.radians((np.arange(SIDE) - (SIDE - 1) / 2.0) * FIELD_DEG / SIDE))
    up, across = np.divmod(np.arange(SIDE * SIDE), SIDE)
    towards = np.column_stack([np.ones(SIDE * SIDE), -tangent[across], tangent[up]])
    mount = rotation_about([0.0, 0.0, 1.0], MOUNT_YAW_RAD) @ rotation_about([0.0, 1.0, 0.0], MOUNT_PITCH_RAD)
    return np.asarray(towards @ mount.T, dtype=np.float64)


def rotations(quaternion: FloatArray) -> FloatArray:
    """Rotation matrices (N, 3, 3) of unit quaternions (N, 4) w x y z."""
    w, x, y, z = quaternion.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def read_tof_vicon(folder: Path) -> TofScan:
    """Read one recording; a sweep is a frame, a zone without exactly one valid target has no echo.

    Raises
    ------
    DataError : other columns, text, incomplete frames, no pose of the carrier or of the target.
    StorageError : a file cannot be read.
    """
    t_s, zones = _frames(folder / TOF_NAME)
    tracks = _tracks(folder / POSES_NAME)
    for name in ("Drone", "Surface"):
        if name not in tracks:
            raise DataError(f"no poses of '{name}'", where=str(folder / POSES_NAME), cure="give a whole recording")
    inside = (t_s >= tracks["Drone"].t_s[0]) & (t_s <= tracks["Drone"].t_s[-1])
    t_s, zones = t_s[inside], zones[inside]
    place, turned = tracks["Drone"].at(t_s)
    readings = _readings(t_s, zones, place, turned)
    target = np.median(tracks["Surface"].position_m, axis=0)
    normal = np.median(rotations(tracks["Surface"].quaternion)[:, :, 0], axis=0)
    normal = normal / np.linalg.norm(normal)
    normal = normal if (np.median(place, axis=0) - target) @ normal > 0.0 else -normal
    frame = estimate_part_frame(place, -normal, readings.range_m)
    frame[:3, 3] = target
    outside = int((~inside).sum())
    notes = (f"{outside} frames lie outside of the recorded poses",) if outside else ()
    return TofScan(ScanLog(readings, frame, frame_estimated=False, warnings=notes), target, normal)


def _numbers(path: Path, text: str, columns: int) -> FloatArray:
    try:
        table = np.array([line.split(",") for line in text.split()], dtype=np.float64)
    except ValueError as error:
        raise DataError(f"not a table of numbers ({error})", where=str(path), cure="give a whole recording") from error
    if table.ndim != 2 or table.shape[1] != columns or not np.all(np.isfinite(table)):
        raise DataError(f"a table {table.shape}, wanted {columns} finite columns", where=str(path))
    return table


def _frames(path: Path) -> tuple[FloatArray, FloatArray]:
    """Times (F,) in s and zones (F, 64, 3), repeated and backward times left out."""
    table = _numbers(path, read_whole(path).decode("utf-8", "replace"), 3)
    block = SIDE * SIDE + 1
    if len(table) == 0 or len(table) % block:
        raise DataError(f"{len(table)} rows are no whole number of frames of {block}", where=str(path))
    blocks = table.reshape(-1, block, 3)
    new = _increasing(blocks[:, 0, 0])
    return 1e-3 * blocks[new, 0, 0], blocks[new, 1:]


def _increasing(t: FloatArray) -> IntArray:
    """Rows whose time is later than all before: what was repeated, or came after a jump back, is left out."""
    before = np.concatenate([[-np.inf], np.maximum.accumulate(t)[:-1]])
    return np.flatnonzero(t > before)


def _tracks(path: Path) -> dict[str, Track]:
    lines = [line.split(",", 1) for line in read_whole(path).decode("utf-8", "replace").split()[1:]]
    tracks = {}
    for name in {line[0] for line in lines}:
        rows = "\n".join(line[1] for line in lines if line[0] == name and len(line) == 2)
        table = _numbers(path, rows, 8)
        table = table[_increasing(table[:, 0])]
        quaternion = table[:, 4:] / np.linalg.norm(table[:, 4:], axis=1, keepdims=True)
        # q and -q are one rotation: neighbours must have the same sign to be interpolated.
        turns = np.cumprod(np.where(np.sum(quaternion[1:] * quaternion[:-1], axis=1) < 0.0, -1.0, 1.0))
        quaternion[1:] *= turns[:, None]
        tracks[name] = Track(1e-3 * table[:, 0], table[:, 1:4], quaternion)
    return tracks


def _readings(t_s: FloatArray, zones: FloatArray, place: FloatArray, turned: FloatArray) -> Readings:
    frames, count = len(t_s), SIDE * SIDE
    towards = zone_directions()
    length = np.linalg.norm(towards, axis=1)
    valid = np.isin(zones[..., 2], VALID_STATUS) & (zones[..., 1] == 1) & (zones[..., 0] > 0)
    ranges = np.where(valid, 1e-3 * zones[..., 0] * length, np.inf)
    axis = np.einsum("fij,zj->fzi", turned, towards / length[:, None])
    # The carrier looks along x; the grip frame has z along the beam.
    grip = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    grips = np.array([pose(rotation @ grip, point) for rotation, point in zip(turned, place, strict=True)])
    return Readings(
        specs=tuple(_spec(f"zone{k:02d}") for k in range(count)),
        t_s=np.repeat(t_s, count),
        sensor=np.tile(np.arange(count), frames),
        position_m=np.repeat(place, count, axis=0),
        axis=axis.reshape(-1, 3),
        range_m=ranges.ravel(),
        status=np.where(valid, int(Status.OK), int(Status.NO_ECHO)).ravel(),
        start=np.arange(frames + 1) * count,
        stop=np.arange(frames),
        row=np.zeros(frames, dtype=np.int64),
        world_from_grip=grips.reshape(-1, 4, 4),
    )


def _spec(name: str) -> SensorSpec:
    # Ranging accuracy of the data sheet in 8 x 8 mode beyond 200 mm: about 4 % of 0.5 m.
    return SensorSpec(name, "tof", 0.02, FARTHEST_M, math.radians(FIELD_DEG / SIDE), 0.02)
