"""Our records as messages and back, every float64 bit kept: what replay and resume start from.

The encoder of mcap-ros2-support takes mappings from field name to value; its decoder returns objects with those fields.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
import numpy.typing as npt

from surfuse.records import (
    CameraFrame,
    CameraModel,
    FusionScene,
    LateTable,
    Outline,
    ScanPlan,
    SensorSpec,
    SkippedStop,
    Sweep,
)
from surfuse.runs import sweep_fields
from surfuse.runs.log_records import FORMAT_VERSION, Level, LogEvent

Message = dict[str, object]


class Decoded(Protocol):
    """A decoded message: fields by name."""

    def __getattr__(self, name: str) -> object: ...


def _flat(array: npt.ArrayLike) -> list[float]:
    flat: list[float] = np.asarray(array, dtype=np.float64).ravel().tolist()
    return flat


def _whole(array: npt.ArrayLike) -> list[int]:
    whole: list[int] = np.asarray(array, dtype=np.int64).ravel().tolist()
    return whole


def _floats(message: Decoded, name: str, *shape: int) -> npt.NDArray[np.float64]:
    return np.array(getattr(message, name), dtype=np.float64).reshape(shape or (-1,))


def _ints(message: Decoded, name: str) -> npt.NDArray[np.int64]:
    return np.array(getattr(message, name), dtype=np.int64)


def _number(message: Decoded, name: str) -> float:
    value = getattr(message, name)
    if not isinstance(value, int | float):
        raise ValueError(f"{name} is not a number")
    return value


def _text(message: Decoded, name: str) -> str:
    return str(getattr(message, name))


def _has(message: Decoded, name: str) -> bool:
    return getattr(message, name, None) is not None


def _list(message: Decoded, name: str) -> list[Decoded]:
    return list(getattr(message, name))


def sweep_message(sweep: Sweep) -> Message:
    """One stop with all its readings."""
    return sweep_fields.sweep_message(sweep)


def sweep_record(message: Decoded) -> Sweep:
    """Inverse of `sweep_message`; logs from before a column existed do not hold it."""
    return sweep_fields.sweep_of(lambda name: getattr(message, name, None))


def outline_message(outline: Outline) -> Message:
    """Vertices, pose, margin and holes of an outline."""
    return {
        "vertices_m": _flat(outline.vertices_m),
        "world_from_part": _flat(outline.world_from_part),
        "margin_m": outline.margin_m,
        "sigma_m": _flat(outline.sigma_m),
        "hole_size": [len(hole) for hole in outline.holes_m],
        "hole_vertices_m": [x for hole in outline.holes_m for x in _flat(hole)],
        "viewpoint_m": [] if outline.viewpoint_m is None else _flat(outline.viewpoint_m),
    }


def outline_record(message: Decoded) -> Outline:
    """Inverse of `outline_message`."""
    ends = np.cumsum(_ints(message, "hole_size"))
    vertices = _floats(message, "hole_vertices_m", -1, 2)
    viewpoint = _floats(message, "viewpoint_m")
    return Outline(
        vertices_m=_floats(message, "vertices_m", -1, 2),
        world_from_part=_floats(message, "world_from_part", 4, 4),
        margin_m=_number(message, "margin_m"),
        sigma_m=_floats(message, "sigma_m"),
        holes_m=tuple(np.split(vertices, ends[:-1])) if len(ends) else (),
        viewpoint_m=viewpoint if len(viewpoint) else None,
    )


def _sensor_message(spec: SensorSpec) -> Message:
    return {
        "name": spec.name,
        "kind": spec.kind,
        "range_min_m": spec.range_min_m,
        "range_max_m": spec.range_max_m,
        "beam_full_angle_rad": spec.beam_full_angle_rad,
        "sigma_m": spec.sigma_m,
        "incidence_limit_rad": spec.incidence_limit_rad,
        "firing_time_s": spec.firing_time_s,
        "frequency_hz": math.nan if spec.frequency_hz is None else spec.frequency_hz,
        "aperture_m": math.nan if spec.aperture_m is None else spec.aperture_m,
        "dead_length_m": spec.dead_length_m,
        "late": [] if spec.late is None else [_late_message(spec.late)],
    }


def _late_message(late: LateTable) -> Message:
    return {"tilt_rad": list(late.tilt_rad), "bias_m": list(late.bias_m), "scatter_m": list(late.scatter_m)}


def _late_record(message: Decoded) -> LateTable:
    return LateTable(*(tuple(_floats(message, name).tolist()) for name in ("tilt_rad", "bias_m", "scatter_m")))


def _sensor_record(message: Decoded) -> SensorSpec:
    frequency, aperture = _number(message, "frequency_hz"), _number(message, "aperture_m")
    # Logs from before sensors had such a table do not hold the field.
    late = [_late_record(one) for one in _list(message, "late")] if _has(message, "late") else []
    dead_length_m = _number(message, "dead_length_m")
    return SensorSpec(
        name=_text(message, "name"),
        kind=_text(message, "kind"),
        # Version 0.1.0 wrote what the blanking left, also where that lay inside of the tube.
        range_min_m=max(_number(message, "range_min_m"), dead_length_m),
        range_max_m=_number(message, "range_max_m"),
        beam_full_angle_rad=_number(message, "beam_full_angle_rad"),
        sigma_m=_number(message, "sigma_m"),
        incidence_limit_rad=_number(message, "incidence_limit_rad"),
        firing_time_s=_number(message, "firing_time_s"),
        frequency_hz=None if math.isnan(frequency) else frequency,
        aperture_m=None if math.isnan(aperture) else aperture,
        dead_length_m=dead_length_m,
        late=late[0] if late else None,
    )


def scene_message(scene: FusionScene) -> Message:
    """Sensors, part frame, outline and depth limit, with the version of the log format."""
    return {
        "format_version": FORMAT_VERSION,
        "sensors": [_sensor_message(spec) for spec in scene.specs],
        "world_from_part": _flat(scene.world_from_part),
        "outline": [] if scene.outline is None else [outline_message(scene.outline)],
        "depth_max_m": scene.depth_max_m,
    }


def scene_version(message: Decoded) -> int:
    """Version of the log format that wrote this scene."""
    return int(_number(message, "format_version"))


def scene_record(message: Decoded) -> FusionScene:
    """Inverse of `scene_message`."""
    outlines = [outline_record(outline) for outline in _list(message, "outline")]
    return FusionScene(
        specs=tuple(_sensor_record(sensor) for sensor in _list(message, "sensors")),
        world_from_part=_floats(message, "world_from_part", 4, 4),
        outline=outlines[0] if outlines else None,
        depth_max_m=_number(message, "depth_max_m"),
    )


def plan_message(plan: ScanPlan) -> Message:
    """Targets in visiting order, the enlarged outline and what was left out."""
    return {
        "world_from_grip": _flat(plan.world_from_grip),
        "uv_m": _flat(plan.uv_m),
        "row": _whole(plan.row),
        "joints_rad": _flat(plan.joints_rad),
        "joints": int(plan.joints_rad.shape[1]),
        "outline": outline_message(plan.outline),
        "step_m": plan.step_m,
        "standoff_m": plan.standoff_m,
        "skipped_uv_m": [x for stop in plan.skipped for x in (stop.u_m, stop.v_m)],
        "skipped_reason": [stop.reason for stop in plan.skipped],
    }


def plan_record(message: Decoded) -> ScanPlan:
    """Inverse of `plan_message`."""
    uv = _floats(message, "uv_m", -1, 2)
    joints = int(_number(message, "joints"))
    outline = getattr(message, "outline")  # noqa: B009 - a field of a generated class
    reasons = [str(reason) for reason in _list(message, "skipped_reason")]
    return ScanPlan(
        world_from_grip=_floats(message, "world_from_grip", -1, 4, 4),
        uv_m=uv,
        row=_ints(message, "row"),
        joints_rad=_floats(message, "joints_rad", len(uv), joints),
        outline=outline_record(outline),
        step_m=_number(message, "step_m"),
        standoff_m=_number(message, "standoff_m"),
        skipped=tuple(
            SkippedStop(u_m=float(u), v_m=float(v), reason=reason)
            for (u, v), reason in zip(_floats(message, "skipped_uv_m", -1, 2), reasons, strict=True)
        ),
    )


def view_message(frame: CameraFrame) -> Message:
    """Everything of a camera frame but its pixels, which go into a sensor_msgs/Image beside it."""
    camera = frame.camera
    return {
        "t_s": frame.t_s,
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "fx_px": camera.fx_px,
        "fy_px": camera.fy_px,
        "cx_px": camera.cx_px,
        "cy_px": camera.cy_px,
        "distortion": list(camera.distortion),
        "world_from_camera": _flat(frame.world_from_camera),
    }


def frame_record(view: Decoded, pixels: bytes) -> CameraFrame:
    """A camera frame from its view and the bytes of its mono8 image."""
    k1, k2, p1, p2, k3 = _floats(view, "distortion").tolist()
    camera = CameraModel(
        width_px=int(_number(view, "width_px")),
        height_px=int(_number(view, "height_px")),
        fx_px=_number(view, "fx_px"),
        fy_px=_number(view, "fy_px"),
        cx_px=_number(view, "cx_px"),
        cy_px=_number(view, "cy_px"),
        distortion=(k1, k2, p1, p2, k3),
    )
    image = np.frombuffer(pixels, dtype=np.uint8).reshape(camera.height_px, camera.width_px)
    return CameraFrame(
        image=image,
        t_s=_number(view, "t_s"),
        camera=camera,
        world_from_camera=_floats(view, "world_from_camera", 4, 4),
    )


def event_message(event: LogEvent) -> Message:
    """An event with its time to the last bit."""
    return {"t_s": event.t_s, "level": int(event.level), "source": event.source, "text": event.text}


def event_record(message: Decoded) -> LogEvent:
    """Inverse of `event_message`."""
    return LogEvent(
        t_s=_number(message, "t_s"),
        level=Level(int(_number(message, "level"))),
        source=_text(message, "source"),
        text=_text(message, "text"),
    )
