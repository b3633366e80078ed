"""Sensors, echoes, joint states and one sweep of the array."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from surfuse.errors import DataError, nearest
from surfuse.records.checks import FloatArray, check_finite, check_increasing, check_number, check_rigid, own, own_pose
from surfuse.records.codes import Status
from surfuse.records.columns import ArrayRecord


@dataclass(frozen=True)
class LateTable:
    """Range minus distance along the axis, measured on tilted plates: K increasing tilts (rad), bias, scatter (m)."""

    tilt_rad: tuple[float, ...]
    bias_m: tuple[float, ...]
    scatter_m: tuple[float, ...]

    def __post_init__(self) -> None:
        if not 0 < len(self.tilt_rad) == len(self.bias_m) == len(self.scatter_m):
            counts = f"{len(self.tilt_rad)} tilts, {len(self.bias_m)} biases and {len(self.scatter_m)} scatters"
            raise DataError(f"a late table of {counts}", cure="give as many of each, at least one")
        tilts = np.array(self.tilt_rad)
        if not (np.all((tilts >= 0.0) & (tilts < np.pi / 2)) and np.all(np.diff(tilts) > 0.0)):
            raise DataError(
                f"late tilts of {np.round(np.degrees(tilts), 2).tolist()} degrees",
                cure="give increasing tilts from 0 to below 90 degrees",
            )
        if not (
            np.all(np.isfinite(self.bias_m)) and np.all(np.isfinite(self.scatter_m) & (np.array(self.scatter_m) >= 0.0))
        ):
            raise DataError(
                f"a late table with biases {list(self.bias_m)} m and scatters {list(self.scatter_m)} m",
                cure="give finite biases, and scatters of 0 or more",
            )


ULTRASONIC = "ultrasonic"

SENSOR_KINDS = (ULTRASONIC, "laser", "infrared", "tof", "touch")
"""What a sensor measures with: sound in a wide beam, or light (laser spot, infrared, time of flight) or contact along
its axis."""

LIGHT_KINDS = ("laser", "infrared", "tof")
_OLDER_KINDS = {"optical": "tof", "lidar": "laser", "sonar": "ultrasonic"}

# Beyond these a wrong unit is likelier than the sensor (kHz for Hz, mm for m).
_LIMITS = {"frequency_hz": (1e3, 1e9), "aperture_m": (1e-4, 1.0), "dead_length_m": (0.0, 10.0)}


@dataclass(frozen=True)
class SensorSpec:
    """What is known of a range sensor before it is used; the estimators know no more than this.

    `dead_length_m` says how far in front of the sensor's origin its beam starts (a tube); the range counts from the
    origin. `late` is how it was measured to read a tilted plate (None: the estimators use their own models). `kind` is
    one of `SENSOR_KINDS`; "optical", "lidar" and "sonar" of older files are read as "tof", "laser" and "ultrasonic".
    """

    name: str
    kind: str
    range_min_m: float
    range_max_m: float
    beam_full_angle_rad: float
    sigma_m: float
    incidence_limit_rad: float = float(np.radians(25.0))
    firing_time_s: float = 0.05
    frequency_hz: float | None = None
    aperture_m: float | None = None
    dead_length_m: float = 0.0
    late: LateTable | None = None

    def __post_init__(self) -> None:
        self._check_kind()
        if not 0.0 <= self.range_min_m < self.range_max_m < float("inf"):
            raise DataError(
                f"sensor '{self.name}': range_min_m = {self.range_min_m} and range_max_m = {self.range_max_m}",
                cure="give 0 <= range_min_m < range_max_m, finite, in metres",
            )
        if not 0.0 < self.beam_full_angle_rad <= np.pi:
            degrees = np.degrees(self.beam_full_angle_rad)
            raise DataError(f"sensor '{self.name}': beam_full_angle_deg = {degrees:g}", cure="give 0 < angle <= 180")
        if not 0.0 < self.sigma_m < float("inf"):
            raise DataError(
                f"sensor '{self.name}': sigma_m = {self.sigma_m}",
                cure="give a standard deviation > 0 in metres",
            )
        check_number(f"sensor '{self.name}': firing_time_s", self.firing_time_s, 0.0, 3600.0)
        check_number(f"sensor '{self.name}': incidence_limit_rad", self.incidence_limit_rad, 0.0, np.pi / 2, above=True)
        for name, (low, high) in _LIMITS.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise DataError(f"sensor '{self.name}': {name} = {value:g}", cure=f"give {low:g} to {high:g}")
        if self.range_min_m < self.dead_length_m:
            raise DataError(
                f"sensor '{self.name}': range_min_m = {self.range_min_m:g} lies inside the tube, "
                f"dead_length_m = {self.dead_length_m:g}",
                cure="both count from the sensor's origin: give range_min_m >= dead_length_m",
            )

    def _check_kind(self) -> None:
        kind = self.kind.lower()
        kind = _OLDER_KINDS.get(kind, kind)
        if kind not in SENSOR_KINDS:
            raise DataError(
                f"sensor '{self.name}': unknown kind '{self.kind[:40]}'", cure=nearest(kind[:40], SENSOR_KINDS)
            )
        object.__setattr__(self, "kind", kind)

    @property
    def along_axis(self) -> bool:
        """Whether it measures where its axis ends, as light and contact do, and not anywhere in a wide beam."""
        return self.kind != "ultrasonic"


@dataclass(frozen=True, eq=False)
class Fixture(ArrayRecord):
    """Where the S sensors of the array sit: `grip_from_sensor` (S, 4, 4), beams along each sensor's z."""

    grip_from_sensor: FloatArray
    specs: tuple[SensorSpec, ...]

    def __post_init__(self) -> None:
        own(self, np.float64, grip_from_sensor=(len(self.specs), 4, 4))
        check_rigid(self.grip_from_sensor, "Fixture.grip_from_sensor")

    def __len__(self) -> int:
        return len(self.specs)


@dataclass(frozen=True)
class Echo:
    """The answer of one sensor to one trigger: the mean of several pings, already averaged by the node.

    `amplitude` is the strength of the echo (1: a facing plate; nan: unknown), `spread_m` the standard deviation
    of the pings that agreed, `count` how many they were, `t_s` the moment of the first emission, `sigma_m` the standard
    deviation that the device itself states (nan: none, the spec's holds).
    """

    range_m: float
    status: Status
    t_s: float
    amplitude: float = float("nan")
    spread_m: float = float("nan")
    count: int = 1
    sigma_m: float = float("nan")


@dataclass(frozen=True, eq=False)
class JointState(ArrayRecord):
    """Joint positions (J,) rad at a moment."""

    position_rad: FloatArray
    t_s: float

    def __post_init__(self) -> None:
        own(self, np.float64, position_rad=(None,))
        check_finite(self.position_rad, "JointState.position_rad")


@dataclass(frozen=True, eq=False)
class ToolState(ArrayRecord):
    """Where the tool of an arm stands at a moment: `world_from_tool` (4, 4), and joints (J,) rad (none: not told)."""

    t_s: float
    world_from_tool: FloatArray
    joints_rad: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        own_pose(self, "world_from_tool")
        own(self, np.float64, joints_rad=(None,))
        check_finite(self.joints_rad, "ToolState.joints_rad")


@dataclass(frozen=True, eq=False)
class JointSamples(ArrayRecord):
    """Joint positions (T, J) rad at increasing times (T,) s: what the encoders showed during a motion."""

    t_s: FloatArray
    position_rad: FloatArray

    def __post_init__(self) -> None:
        own(self, np.float64, t_s=(None,), position_rad=(len(self.t_s), None))
        check_increasing(self.t_s, "JointSamples.t_s")
        check_finite(self.position_rad, "JointSamples.position_rad")

    def __len__(self) -> int:
        return len(self.t_s)

    def at(self, t_s: FloatArray) -> FloatArray:
        """Joints (N, J) at times (N,), on straight lines between the samples.

        Raises
        ------
        DataError : a time outside the samples, where nobody knows the joints.
        """
        asked = np.asarray(t_s, dtype=np.float64)
        if len(self) == 0 or not np.all((asked >= self.t_s[0]) & (asked <= self.t_s[-1])):
            known = f"{self.t_s[0]:.6f} to {self.t_s[-1]:.6f} s" if len(self) else "none"
            raise DataError(
                f"joints asked for at {float(asked.min()):.6f} to {float(asked.max()):.6f} s, samples: {known}",
                cure="sample the encoders until the last reading has fired",
            )
        return np.column_stack([np.interp(asked, self.t_s, joint) for joint in self.position_rad.T])
