"""A ROS 2 log of someone else's rig (MCAP): sensor_msgs/Range with the frames of /tf and /tf_static, as a scan.

A Range is measured along +x of its frame (sensor_msgs/Range). Where /tf does not reach back or forward to a reading,
the reading has no pose; it is left out and told.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from mcap.exceptions import McapError
from mcap_ros2.decoder import DecoderFactory

from surfuse.errors import DataError, nearest
from surfuse.records import ReadingColumns, SensorSpec
from surfuse.runs.assembly import SingleReadings, assemble, status_of_range
from surfuse.runs.log_files import log_segments, read_whole
from surfuse.runs.log_walk import Walk, walk
from surfuse.runs.scan_log import AssumedSensor, ScanLog
from surfuse.runs.side_files import METRES_LIMIT, read_corrections, read_part, read_sensors
from surfuse.runs.transform_tree import TransformTree

_RANGE = "sensor_msgs/msg/Range"
_TF = "tf2_msgs/msg/TFMessage"
_NEEDED = f"needed are {_RANGE} and {_TF} (topics /tf and /tf_static), CDR with ros2msg schemas"


@dataclass
class _Gathered:
    tree: TransformTree = field(default_factory=TransformTree)
    time_ns: list[int] = field(default_factory=list)
    log_ns: list[int] = field(default_factory=list)
    frame: list[str] = field(default_factory=list)
    range_m: list[float] = field(default_factory=list)
    sigma_m: list[float] = field(default_factory=list)
    sample: dict[str, SimpleNamespace] = field(default_factory=dict)
    topics: dict[str, str] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)


def read_foreign_log(
    path: Path,
    sensors: Path | None = None,
    frame: Path | None = None,
    outline: Path | None = None,
    assumed: AssumedSensor | None = None,
) -> ScanLog:
    """Read a ROS 2 bag (one MCAP file, or a folder of them) into a scan; frames are named by `frame_id`.

    Sensor limits come from the messages unless `sensors` is given. Sweeps and part frame as for the readings CSV.

    Raises
    ------
    DataError : no Range, no transform for it, or no common root; the message says what was found and what is needed.
    """
    gathered = _Gathered()
    for segment in log_segments(path):
        found = walk(read_whole(segment))
        gathered.warnings += [f"{segment.name}: {text}" for _, _, text in found.damage]
        _gather(found, gathered, path)
    if not gathered.frame:
        if not gathered.topics:
            cure = "give a run folder, an .mcap that was closed properly, or a .csv file"
            raise DataError("nothing in it can be read as an MCAP log", where=str(path), cure=cure)
        listing = ", ".join(f"{topic} ({kind})" for topic, kind in list(gathered.topics.items())[:12])
        raise DataError(f"the log has no {_RANGE}; found: {listing}", where=str(path), cure=_NEEDED)
    specs = _specs(gathered, sensors, assumed or AssumedSensor())
    single = _single(gathered, specs, path)
    if sensors is not None:
        single = replace(single, corrections=read_corrections(sensors))
    return assemble(single, read_part(frame, outline), gathered.warnings)


def _decoders(found: Walk, gathered: _Gathered) -> Iterator[tuple[int, str, str, Callable[[bytes], SimpleNamespace]]]:
    factory = DecoderFactory()
    for number, channel in found.channels.items():
        schema = found.schemas.get(channel.schema_id)
        gathered.topics[channel.topic] = schema.name if schema else "no schema"
        if schema is None or schema.name not in (_RANGE, _TF):
            continue
        decode = factory.decoder_for(channel.message_encoding, schema)
        if decode is None:
            gathered.topics[channel.topic] = f"{schema.name}, encoded as {channel.message_encoding}/{schema.encoding}"
            continue
        yield number, schema.name, channel.topic, decode


def _gather(found: Walk, gathered: _Gathered, path: Path) -> None:
    decoders = {number: (kind, topic, decode) for number, kind, topic, decode in _decoders(found, gathered)}
    for message in found.messages:
        if message.channel_id not in decoders:
            continue
        kind, topic, decode = decoders[message.channel_id]
        try:
            decoded = decode(message.data)
            if kind == _TF:
                _take_transforms(decoded, topic.endswith("tf_static"), gathered.tree)
            else:
                _take_range(decoded, message.log_time, gathered)
        except DataError as error:
            raise DataError(error.what, where=str(path), cure=error.cure) from error
        except (McapError, struct.error, ValueError, TypeError, IndexError, AttributeError, EOFError) as error:
            raise DataError(f"a message of {topic} cannot be decoded: {error}", where=str(path)) from error


def _nanoseconds(stamp: SimpleNamespace) -> int:
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _take_transforms(message: SimpleNamespace, static: bool, tree: TransformTree) -> None:
    for item in message.transforms:
        t, q = item.transform.translation, item.transform.rotation
        tree.add(
            parent=item.header.frame_id.lstrip("/"),
            child=item.child_frame_id.lstrip("/"),
            time_ns=_nanoseconds(item.header.stamp),
            value=(t.x, t.y, t.z, q.x, q.y, q.z, q.w),
            static=static,
        )


def _take_range(message: SimpleNamespace, log_ns: int, gathered: _Gathered) -> None:
    name = message.header.frame_id.lstrip("/")
    gathered.sample.setdefault(name, message)
    gathered.time_ns.append(_nanoseconds(message.header.stamp))
    gathered.log_ns.append(log_ns)
    gathered.frame.append(name)
    gathered.range_m.append(float(message.range))
    # ROS 2 Humble and older have no variance; 0 means unknown.
    variance = float(getattr(message, "variance", 0.0))
    gathered.sigma_m.append(variance**0.5 if 0.0 < variance < float("inf") else float("nan"))


def _specs(gathered: _Gathered, sensors: Path | None, assumed: AssumedSensor) -> tuple[SensorSpec, ...]:
    if sensors is not None:
        specs = read_sensors(sensors)
        names = [spec.name for spec in specs]
        for name in gathered.sample:
            if name not in names:
                raise DataError(
                    f"sensor frame '{name[:40]}' is not in the file", where=str(sensors), cure=nearest(name[:40], names)
                )
        return specs
    return tuple(_spec_of(name, message, gathered, assumed) for name, message in gathered.sample.items())


def _spec_of(name: str, message: SimpleNamespace, gathered: _Gathered, assumed: AssumedSensor) -> SensorSpec:
    low, high, angle = float(message.min_range), float(message.max_range), float(message.field_of_view)
    if not 0.0 <= low < high:
        low, high = assumed.range_min_m, assumed.range_max_m
        gathered.warnings.append(f"sensor '{name}' gives no range limits: {low:g} to {high:g} m assumed")
    if not 0.0 < angle <= np.pi:
        angle = assumed.beam_full_angle_rad
        gathered.warnings.append(f"sensor '{name}' gives no field of view: {np.degrees(angle):g} degrees assumed")
    variance = float(getattr(message, "variance", 0.0))
    if not 0.0 < variance < float("inf"):
        gathered.warnings.append(f"sensor '{name}' gives no variance: sigma {assumed.sigma_m * 1e3:g} mm assumed")
    return SensorSpec(
        name=name,
        kind="ultrasonic" if message.radiation_type == 0 else "infrared",
        range_min_m=low,
        range_max_m=high,
        beam_full_angle_rad=angle,
        sigma_m=variance**0.5 if 0.0 < variance < float("inf") else assumed.sigma_m,
    )


def _single(gathered: _Gathered, specs: tuple[SensorSpec, ...], path: Path) -> SingleReadings:
    time_ns = np.array(gathered.time_ns, dtype=np.int64)
    if not np.any(time_ns):
        time_ns = np.array(gathered.log_ns, dtype=np.int64)
        gathered.warnings.append("the ranges carry no stamps: the times of recording are used")
    number = {spec.name: i for i, spec in enumerate(specs)}
    sensor = np.array([number[name] for name in gathered.frame], dtype=np.int64)
    poses, known = _poses(gathered, specs, sensor, time_ns, path)
    key = np.column_stack([time_ns, sensor])
    _, first = np.unique(key, axis=0, return_index=True)
    if len(first) < len(key):
        gathered.warnings.append(f"{len(key) - len(first)} ranges are repeated (same sensor, same stamp)")
    kept = first[known[first]]
    if len(kept) < len(first):
        gathered.warnings.append(f"{len(first) - len(kept)} ranges lie outside the time of /tf and have no pose")
    if len(kept) == 0:
        raise DataError("no range lies within the time that /tf covers", where=str(path), cure="check the two clocks")
    kept = kept[np.argsort(time_ns[kept], kind="stable")]
    range_m = np.array(gathered.range_m)[kept]
    if np.any(np.abs(range_m[np.isfinite(range_m)]) > METRES_LIMIT):
        raise DataError(f"ranges beyond {METRES_LIMIT:g} m: millimetres?", where=str(path), cure="record metres")
    columns = ReadingColumns(
        t_s=time_ns[kept] / 1e9,
        sensor=sensor[kept],
        position_m=poses[kept, :3, 3],
        axis=poses[kept, :3, 0],
        range_m=range_m,
        status=status_of_range(range_m),
        sigma_m=np.array(gathered.sigma_m)[kept],
    )
    return SingleReadings(specs, columns)


def _poses(
    gathered: _Gathered,
    specs: tuple[SensorSpec, ...],
    sensor: np.ndarray[tuple[int, ...], np.dtype[np.int64]],
    time_ns: np.ndarray[tuple[int, ...], np.dtype[np.int64]],
    path: Path,
) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.float64]], np.ndarray[tuple[int, ...], np.dtype[np.bool_]]]:
    """Root-from-sensor poses (N, 4, 4) of all ranges, and which are known."""
    poses, known = np.tile(np.eye(4), (len(sensor), 1, 1)), np.zeros(len(sensor), dtype=np.bool_)
    names = [specs[i].name for i in np.unique(sensor)]
    unplaced = [name for name in names if name not in gathered.tree.frames]
    if unplaced:
        frames = ", ".join(gathered.tree.frames[:12]) or "none"
        raise DataError(
            f"no transform leads to the sensor frame '{unplaced[0]}'; frames in the log: {frames}",
            where=str(path),
            cure=_NEEDED,
        )
    roots = {gathered.tree.root(name) for name in names}
    if len(roots) > 1:
        if not gathered.topics:
            cure = "give a run folder, an .mcap that was closed properly, or a .csv file"
            raise DataError("nothing in it can be read as an MCAP log", where=str(path), cure=cure)
        listing = ", ".join(sorted(roots))
        raise DataError(f"the sensors hang on different frames ({listing})", where=str(path), cure="join them in /tf")
    for i in np.unique(sensor):
        mine = np.flatnonzero(sensor == i)
        poses[mine], known[mine] = gathered.tree.poses(specs[i].name, time_ns[mine])
    return poses, known
