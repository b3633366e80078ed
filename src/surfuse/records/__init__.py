"""The vocabulary: frozen records that every stage speaks, checked once, arrays read-only.

Units are SI and carried in the names. Frames: `world` (z up, origin on the floor under the first axis of
the arm), `part` (u along the scan line, v up from the table, w out of the part towards the sensors),
`grip` (origin in the centre of the sensor array, z along the grip axis towards the part), `sensor`
(origin on the transducer, z along the beam), `camera` (optical: z forward, x right, y down).
Ranges follow REP-117: `+inf` nothing within range, `-inf` too close, `nan` a faulty reading.
"""

from surfuse.records.checks import BoolArray, ByteArray, FloatArray, IntArray
from surfuse.records.codes import Gap, Gate, Regime, Status
from surfuse.records.findings import Finding, Severity, Trust, trust_of
from surfuse.records.fused import FusedPoints, FusionScene, stacked_points
from surfuse.records.guard import GuardReason, RegionDecision, in_words
from surfuse.records.pictures import CameraFrame, CameraModel, Detection, Outline
from surfuse.records.plan import ScanPlan, SkippedStop
from surfuse.records.readings import ReadingColumns, Readings, Sweep, columns_of_echoes, readings_from_sweeps
from surfuse.records.sensing import (
    LIGHT_KINDS,
    SENSOR_KINDS,
    ULTRASONIC,
    Echo,
    Fixture,
    JointSamples,
    JointState,
    LateTable,
    SensorSpec,
    ToolState,
)
from surfuse.records.surface import DenseScore, FusionResult, MapGrid, Score, SurfaceMap

__all__ = [
    "LIGHT_KINDS",
    "SENSOR_KINDS",
    "ULTRASONIC",
    "BoolArray",
    "ByteArray",
    "CameraFrame",
    "CameraModel",
    "DenseScore",
    "Detection",
    "Echo",
    "Finding",
    "Fixture",
    "FloatArray",
    "FusedPoints",
    "FusionResult",
    "FusionScene",
    "Gap",
    "Gate",
    "GuardReason",
    "IntArray",
    "JointSamples",
    "JointState",
    "LateTable",
    "MapGrid",
    "Outline",
    "ReadingColumns",
    "Readings",
    "Regime",
    "RegionDecision",
    "ScanPlan",
    "Score",
    "SensorSpec",
    "Severity",
    "SkippedStop",
    "Status",
    "SurfaceMap",
    "Sweep",
    "ToolState",
    "Trust",
    "columns_of_echoes",
    "in_words",
    "readings_from_sweeps",
    "stacked_points",
    "trust_of",
]
