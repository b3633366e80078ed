"""Writing the log of a run: what is appended is on the disk, checksummed and synced, when the call returns."""

from __future__ import annotations

import math
from pathlib import Path
from types import TracebackType
from typing import Self

from surfuse.durable import storage_error
from surfuse.errors import DataError
from surfuse.records import CameraFrame, FusionScene, JointSamples, ScanPlan, SensorSpec, Sweep
from surfuse.records.checks import check_sensors
from surfuse.runs import definitions as msg
from surfuse.runs import own_messages as own
from surfuse.runs import ros_messages as ros
from surfuse.runs.bag_metadata import SegmentSummary, write_bag_metadata
from surfuse.runs.log_files import next_segment, segment_paths
from surfuse.runs.log_records import LogEvent
from surfuse.runs.log_repair import seal_segment, summarise
from surfuse.runs.own_topics import EVENT_TOPIC, OWN_TOPICS, PLAN_TOPIC, SCENE_TOPIC, SWEEP_TOPIC, VIEW_TOPIC
from surfuse.runs.segment import Segment

SWEEPS_PER_SEGMENT = 300
"""A new segment begins after this many sweeps: damage to one file then costs one segment at most."""


class LogWriter:
    """Appends records to `folder`, in a new segment each time it is opened (MCAP files cannot be appended to).

    Use it as a context manager. Every `append_*` returns when its record is synced to disk.

    Parameters
    ----------
    folder : the log folder; it is created when missing. Segments that an earlier, killed writer left without an end
        are given one first, so that every reader opens them.

    Raises
    ------
    StorageError : disk full, read-only, or folder gone; all that was appended before stays readable.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._segment: Segment | None = None
        self._sweeps = 0
        self._latest_ns = 0
        self._scene: FusionScene | None = None
        self._range_topics: tuple[str, ...] = ()
        self._summaries: list[SegmentSummary] = []

    def __enter__(self) -> Self:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for path in segment_paths(self.folder):
                seal_segment(path)
                self._summaries.append(summarise(path))
        except OSError as error:
            raise storage_error(error, self.folder, "open the log folder") from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._close_segment()
        except Exception:
            # The first error is the one to report; the segment stays readable without its end.
            if error is None:
                raise

    def append_scene(self, scene: FusionScene) -> None:
        """What fusion knows before the first reading; repeated at the head of every later segment."""
        self._scene = scene
        self._range_topics = _range_topics(scene.specs)
        if self._segment is None:
            self._open_segment()
        else:
            self._segment.put(SCENE_TOPIC, own.scene_message(scene), self._latest_ns)
            self._segment.commit()

    def append_plan(self, plan: ScanPlan) -> None:
        """The plan of the scan, bit by bit, so that `resume` walks the same one."""
        segment = self._current()
        segment.put(PLAN_TOPIC, own.plan_message(plan), self._latest_ns)
        segment.commit()

    def append_frame(self, frame: CameraFrame) -> None:
        """A camera image with its model and pose, for us and for viewers."""
        segment, now = self._current(), self._tick(frame.t_s)
        segment.put(VIEW_TOPIC, own.view_message(frame), now)
        _put(segment, "/camera/image", msg.IMAGE, ros.image_message(frame), now)
        _put(segment, "/camera/camera_info", msg.CAMERA_INFO, ros.camera_info_message(frame), now)
        pose = ros.transform(frame.t_s, "world", "camera", frame.world_from_camera)
        _put(segment, "/tf", msg.TF, {"transforms": [pose]}, now)
        segment.commit()

    def append_event(self, event: LogEvent) -> None:
        """One line of what happened."""
        segment, now = self._current(), self._tick(event.t_s)
        segment.put(EVENT_TOPIC, own.event_message(event), now)
        _put(segment, "/events", msg.LOG, ros.event_log_message(event), now)
        segment.commit()

    def append_sweep(self, sweep: Sweep, samples: JointSamples | None = None) -> None:
        """One stop: its own checksummed chunk, synced before this returns.

        `samples` are the joints on the way to it, for an arm that did not stop; None: the joints of the sweep.

        Raises
        ------
        DataError : no scene was appended, or the sweep names a sensor that the scene does not have.
        """
        scene = self._scene
        if scene is None:
            raise DataError("a sweep needs the scene before it", cure="call append_scene first")
        check_sensors(sweep.sensor, len(scene.specs))
        if self._sweeps >= SWEEPS_PER_SEGMENT:
            self._close_segment()
        segment = self._current()
        self._put_sweep(segment, sweep, scene.specs)
        self._put_joints(segment, sweep, samples)
        segment.put(SWEEP_TOPIC, own.sweep_message(sweep), self._latest_ns)
        segment.commit()
        self._sweeps += 1

    def _put_sweep(self, segment: Segment, sweep: Sweep, specs: tuple[SensorSpec, ...]) -> None:
        times = [self._tick(float(t_s)) for t_s in sweep.t_s]
        if times:
            _put(segment, "/tf", msg.TF, ros.sweep_transforms(sweep, specs), times[0])
        for i, at in enumerate(times):
            sensor = int(sweep.sensor[i])
            _put(segment, self._range_topics[sensor], msg.RANGE, ros.range_message(sweep, i, specs[sensor]), at)

    def _put_joints(self, segment: Segment, sweep: Sweep, samples: JointSamples | None) -> None:
        if samples is not None:
            for t_s, joints in zip(samples.t_s.tolist(), samples.position_rad, strict=True):
                _put(segment, "/joint_states", msg.JOINT_STATE, ros.joint_message(t_s, joints), self._tick(t_s))
        elif len(sweep.joints_rad):
            began_s = float(sweep.t_s[0]) if len(sweep.t_s) else 0.0
            joint_state = ros.joint_message(began_s, sweep.joints_rad)
            _put(segment, "/joint_states", msg.JOINT_STATE, joint_state, self._latest_ns)

    def _tick(self, t_s: float) -> int:
        """Log time of a record; one without a usable time gets that of the record before it."""
        if math.isfinite(t_s):
            self._latest_ns = ros.stamp_ns(t_s)
        return self._latest_ns

    def _current(self) -> Segment:
        return self._segment or self._open_segment()

    def _open_segment(self) -> Segment:
        segment = Segment(next_segment(self.folder))
        self._segment, self._sweeps = segment, 0
        # Our own topics come first and in a fixed order: see `own_topics`.
        for topic, definition in OWN_TOPICS:
            segment.announce(topic, definition)
        if self._scene is not None:
            segment.put(SCENE_TOPIC, own.scene_message(self._scene), self._latest_ns)
            segment.commit()
        return segment

    def _close_segment(self) -> None:
        segment, self._segment = self._segment, None
        if segment is None:
            return
        segment.close()
        summary = SegmentSummary(
            segment.path.name, segment.first_ns, segment.last_ns, segment.message_count, segment.types
        )
        self._summaries.append(summary)
        write_bag_metadata(self.folder, self._summaries)


def _put(segment: Segment, topic: str, definition: msg.Definition, message: own.Message, time_ns: int) -> None:
    segment.announce(topic, definition)
    segment.put(topic, message, time_ns)


def _range_topics(specs: tuple[SensorSpec, ...]) -> tuple[str, ...]:
    """One topic a sensor; names that ROS cannot tell apart get the sensor's number."""
    names = [ros.topic_name(spec.name) for spec in specs]
    return tuple(name if names.count(name) == 1 else f"{name}_{i}" for i, name in enumerate(names))
