"""surfuse: a surface profiler from a robot arm, a camera and cheap range sensors.

>>> import surfuse as sf
>>> log = sf.read("readings.csv")
>>> surface = sf.fuse(log)
>>> surface.height_m, surface.sigma_m

The names of this module are loaded when they are used (PEP 562): importing it loads nothing else.
"""

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from surfuse.commands.explain.explanation import CellExplanation
    from surfuse.commands.judge.evaluation import MapScore
    from surfuse.door.acquiring import Run, acquire, resume
    from surfuse.door.logs import Frame, Log, log, read
    from surfuse.door.maps import evaluate, fuse, methods, open_map
    from surfuse.door.sensor import Sensor
    from surfuse.door.surface_map import SurfaceMap
    from surfuse.errors import SurfuseError
    from surfuse.records.findings import Finding

__all__ = [
    "CellExplanation",
    "Finding",
    "Frame",
    "Log",
    "MapScore",
    "Run",
    "Sensor",
    "SurfaceMap",
    "SurfuseError",
    "__version__",
    "acquire",
    "evaluate",
    "fuse",
    "log",
    "methods",
    "open_map",
    "read",
    "resume",
]

_HOMES = {
    "CellExplanation": "commands.explain.explanation",
    "Finding": "records.findings",
    "Frame": "door.logs",
    "Log": "door.logs",
    "MapScore": "commands.judge.evaluation",
    "Run": "door.acquiring",
    "Sensor": "door.sensor",
    "SurfaceMap": "door.surface_map",
    "SurfuseError": "errors",
    "acquire": "door.acquiring",
    "evaluate": "door.maps",
    "fuse": "door.maps",
    "log": "door.logs",
    "methods": "door.maps",
    "open_map": "door.maps",
    "read": "door.logs",
    "resume": "door.acquiring",
}

if not TYPE_CHECKING:
    # Hidden from type checkers, which would take any name for one of this module.

    def __getattr__(name: str) -> object:
        """Load a name of the door when it is used first."""
        if name not in _HOMES:
            raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
        value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        """The names of the door."""
        return sorted(__all__)
