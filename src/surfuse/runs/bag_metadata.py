"""`metadata.yaml` beside the segments, as rosbag2 writes it, so that a run's log folder is a ROS 2 bag."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

from surfuse import durable


@dataclass(frozen=True)
class SegmentSummary:
    """What rosbag2's metadata says of one file.

    `first_ns` and `last_ns` are times of messages (None: there is no message); `message_count` and `types` go by topic.
    """

    name: str
    first_ns: int | None
    last_ns: int
    message_count: dict[str, int] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)


def _times(summaries: list[SegmentSummary]) -> tuple[int, int]:
    starts = [summary.first_ns for summary in summaries if summary.first_ns is not None]
    start = min(starts, default=0)
    end = max((summary.last_ns for summary in summaries if summary.first_ns is not None), default=start)
    return start, end - start


def bag_metadata(summaries: list[SegmentSummary]) -> str:
    """Text of a version 9 metadata file (ROS 2 Jazzy) over all segments, in order.

    Source: rosbag2_storage's metadata_io; strings are JSON strings, which YAML reads as they are.
    """
    start, duration = _times(summaries)
    topics = {topic: kind for summary in summaries for topic, kind in summary.types.items()}
    total = sum(sum(summary.message_count.values()) for summary in summaries)
    lines = [
        "rosbag2_bagfile_information:",
        "  version: 9",
        "  storage_identifier: mcap",
        f"  duration:\n    nanoseconds: {duration}",
        f"  starting_time:\n    nanoseconds_since_epoch: {start}",
        f"  message_count: {total}",
        "  topics_with_message_count:" + ("" if topics else " []"),
    ]
    for topic, kind in topics.items():
        count = sum(summary.message_count.get(topic, 0) for summary in summaries)
        lines += [
            "    - topic_metadata:",
            f"        name: {json.dumps(topic)}",
            f"        type: {json.dumps(kind)}",
            "        serialization_format: cdr",
            "        offered_qos_profiles: []",
            '        type_description_hash: ""',
            f"      message_count: {count}",
        ]
    lines += ['  compression_format: ""', '  compression_mode: ""', "  relative_file_paths:"]
    lines += [f"    - {json.dumps(summary.name)}" for summary in summaries]
    lines.append("  files:")
    for summary in summaries:
        first, length = _times([summary])
        lines += [
            f"    - path: {json.dumps(summary.name)}",
            f"      starting_time:\n        nanoseconds_since_epoch: {first}",
            f"      duration:\n        nanoseconds: {length}",
            f"      message_count: {sum(summary.message_count.values())}",
        ]
    lines += ["  custom_data: ~", "  ros_distro: jazzy"]
    return "\n".join(lines) + "\n"


def write_bag_metadata(folder: Path, summaries: list[SegmentSummary]) -> None:
    """Replace `metadata.yaml` of a log folder."""
    durable.write_text(folder / "metadata.yaml", bag_metadata(summaries), overwrite=True)
