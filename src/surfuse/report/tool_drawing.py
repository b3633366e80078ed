"""The tool from the side: its frame, the sensors with their beams, and the grip, the axis that they share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surfuse.records import FloatArray
from surfuse.report.axes import AxesFrame, drawing
from surfuse.report.markup import Markup, Value, element

MM = 1000.0
WIDTH, TOP = 420.0, 46.0
STYLE = (
    "text{font:13px sans-serif;fill:#222}.beam{fill:#2a78d6;fill-opacity:.14;stroke:#2a78d6;stroke-width:1}"
    ".axis{stroke:#222;stroke-width:2;fill:none}.grip{stroke:#c43c39;stroke-width:1.5;stroke-dasharray:6 4}"
    ".sensor{fill:#2a78d6}.flange{fill:#d9d9d6;stroke:#777}.red{fill:#c43c39}"
)


@dataclass(frozen=True)
class DrawnSensor:
    """Name, place (3,) and unit axis (3,) in the frame of the tool, full opening of the beam (rad)."""

    name: str
    position_m: FloatArray
    axis: FloatArray
    beam_full_angle_rad: float


def tool_chart(sensors: Sequence[DrawnSensor], tool_from_grip: FloatArray, beam_m: float) -> Markup:
    """The plane of x and z of the tool in millimetres, z downwards; beams are drawn `beam_m` long."""
    frame = _frame(sensors, beam_m)
    layers = [_flange(frame)]
    for sensor in sensors:
        layers += _sensor(frame, sensor, beam_m)
    layers += [*_grip(frame, tool_from_grip, beam_m), *_arrow(frame, 1.0, 0.0, "x"), *_arrow(frame, 0.0, 1.0, "z")]
    title = f"The tool from the side, with {len(sensors)} sensors"
    return drawing(frame.left + frame.width + 20, frame.top + frame.height + 20, title, layers, "tool")


def _frame(sensors: Sequence[DrawnSensor], beam_m: float) -> AxesFrame:
    reach = max(float(np.hypot(*sensor.position_m[:2])) for sensor in sensors) if sensors else 0.0
    wide = max((math.tan(0.5 * min(s.beam_full_angle_rad, 2.0)) for s in sensors), default=0.0)
    half = MM * max(reach + wide * beam_m, 0.25 * beam_m) * 1.15
    return AxesFrame(-half, half, -1.05 * MM * beam_m, 0.0, 20.0, TOP, WIDTH, WIDTH * 1.05 * MM * beam_m / (2.0 * half))


def _at(frame: AxesFrame, x_m: float, z_m: float) -> tuple[float, float]:
    return round(frame.x(MM * x_m), 1), round(frame.y(-MM * z_m), 1)


def _flange(frame: AxesFrame) -> Markup:
    x, y = _at(frame, 0.0, 0.0)
    box: dict[str, Value] = {"x": x - 40, "y": y - 24, "width": 80, "height": 20, "class": "flange"}
    return element("g", None, element("rect", box), _text(x, y - 30, "flange of the arm", "middle"))


def _sensor(frame: AxesFrame, sensor: DrawnSensor, beam_m: float) -> list[Markup]:
    """Its face, and the cut through its beam."""
    start = sensor.position_m[[0, 2]]
    turn = math.atan2(float(sensor.axis[0]), float(sensor.axis[2]))
    half = 0.5 * sensor.beam_full_angle_rad
    ends = [start + beam_m * np.array([math.sin(turn + a), math.cos(turn + a)]) for a in (-half, half)]
    corners = " ".join("{},{}".format(*_at(frame, float(x), float(z))) for x, z in (start, *ends))
    x, y = _at(frame, float(start[0]), float(start[1]))
    face: dict[str, Value] = {"x": x - 8, "y": y - 5, "width": 16, "height": 10, "class": "sensor"}
    return [
        element("polygon", {"points": corners, "class": "beam"}),
        element("rect", face),
        _text(x + 13, y + 5, sensor.name, "start"),
    ]


def _grip(frame: AxesFrame, tool_from_grip: FloatArray, beam_m: float) -> list[Markup]:
    start, along = tool_from_grip[[0, 2], 3], tool_from_grip[[0, 2], 2]
    (x1, y1), (x2, y2) = (_at(frame, *map(float, start + length * along)) for length in (0.0, beam_m))
    line = element("line", {"x1": x1, "y1": y1, "x2": x2, "y2": y2, "class": "grip"})
    return [line, _text(x2 + 6, y2 - 8, "grip axis", "start", "red")]


def _arrow(frame: AxesFrame, right: float, down: float, name: str) -> list[Markup]:
    """An axis of the frame of the tool."""
    x, y = _at(frame, 0.0, 0.0)
    tip_x, tip_y = x + 62 * right, y + 62 * down
    head = (
        f"M{x} {y}L{tip_x} {tip_y}m{-7 * right - 5 * down} {-7 * down - 5 * right}L{tip_x} {tip_y}"
        f"l{-7 * right + 5 * down} {-7 * down + 5 * right}"
    )
    label = _text(tip_x + 8 * right - 18 * down, tip_y + 5 * right, name, "start")
    return [element("path", {"d": head, "class": "axis"}), label]


def _text(x: float, y: float, text: str, anchor: str, kind: str = "") -> Markup:
    attributes: dict[str, Value] = {"x": round(x, 1), "y": round(y, 1), "text-anchor": anchor}
    return element("text", {**attributes, "class": kind} if kind else attributes, text)
