"""Draws docs/images/rig_tool.svg and rig_area.svg from a cell file: `python docs/make_rig_pictures.py`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from surfuse.geometry.sensor_array import tool_from_grip
from surfuse.plan.pose_plan import pose_plan
from surfuse.plan.scan_plan import PlanParameters
from surfuse.report.content import plan_view
from surfuse.report.markup import Markup, element
from surfuse.report.plan_drawing import plan_chart
from surfuse.report.tool_drawing import STYLE, DrawnSensor, tool_chart
from surfuse.rig.area import area_of, outline_of
from surfuse.rig.real.sensors import places
from surfuse.settings import Settings, load

HERE = Path(__file__).parent
BEAM_M = 0.2
CELL = HERE / "how-to" / "real_rig_cell.toml"
PLAN_STYLE = (
    "text{font:13px sans-serif;fill:#222}.grid{stroke:#e3e3e0}.frame{fill:none;stroke:#999}"
    ".outline{fill:none;stroke:#c43c39;stroke-width:2}.enlarged{fill:none;stroke:none}"
    ".route{fill:none;stroke:#9ab8dd;stroke-width:1}.stops{stroke:#2a78d6;stroke-width:5;stroke-linecap:round}"
    ".first-stop{fill:none;stroke:#c43c39;stroke-width:2}"
)


def pictures() -> dict[Path, str]:
    """Both pictures as they should be."""
    settings = load(CELL)
    return {
        HERE / "images" / "rig_tool.svg": alone(tool_picture(settings), STYLE),
        HERE / "images" / "rig_area.svg": alone(area_picture(settings), PLAN_STYLE),
    }


def tool_picture(settings: Settings) -> Markup:
    position, axis = places(settings.sensor)
    drawn = [
        DrawnSensor(one.name, position[i], axis[i], np.radians(one.beam_full_angle_deg))
        for i, one in enumerate(settings.sensor)
    ]
    return tool_chart(drawn, tool_from_grip(position, axis), BEAM_M)


def area_picture(settings: Settings) -> Markup:
    outline = outline_of(area_of(settings))
    parameters = PlanParameters(settings.step_m, settings.scan.standoff_m, settings.scan.margin_m)
    plan = pose_plan(outline, lambda poses: np.ones(len(poses), dtype=bool), outline.world_from_part, parameters)
    return plan_chart(plan_view(plan, outline.vertices_m, ""))


def alone(picture: Markup, style: str) -> str:
    """A drawing of a page as a file of its own."""
    text = str(picture).replace("<svg", '<svg xmlns="http://www.w3.org/2000/svg"', 1)
    rest = text.index(">") + 1
    return f"{text[:rest]}{element('style', None, Markup(style))}{text[rest:]}\n"


if __name__ == "__main__":
    for path, text in pictures().items():
        path.write_text(text, "utf-8")
