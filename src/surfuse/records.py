"""The vocabulary: frozen records that every stage speaks, checked once, arrays read-only.

Units are SI and carried in the names. Frames: `world` (z up, origin on the floor under the first axis of
the arm), `part` (u along the scan line, v up from the table, w out of the part towards the sensors),
`grip` (origin in the centre of the sensor array, z along the grip axis towards the part), `sensor`
(origin on the transducer, z along the beam), `camera` (optical: z forward, x right, y down).
Ranges follow REP-117: `+inf` nothing within range, `-inf` too close, `nan` a faulty reading.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from surfuse.errors import DataError
from surfuse.geometry.poses import is_rigid

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
ByteArray = npt.NDArray[np.uint8]


class Status(IntEnum):
    """What a reading is; the range then is finite, +inf, -inf or nan in this order."""

    OK = 0
    NO_ECHO = 1
    TOO_CLOSE = 2
    FAULT = 3


class Gate(IntEnum):
    """Why validation kept a reading out of the average; the order is the order of the tests."""

    PASSED = 0
    NO_ECHO = 1
    TOO_CLOSE = 2
    FAULT = 3
    OUT_OF_RANGE = 4
    OUTSIDE_PART = 5
    BEHIND_CELL = 6


class Gap(IntEnum):
    """Why a stop has no fused value."""

    NONE = 0
    NO_VALID_READING = 1
    NO_CONFIDENCE = 2
    OUTSIDE_PART = 3


class Regime(IntEnum):
    """What the value of a map cell rests on."""

    EMPTY = 0
    MEASURED = 1
    MIRROR = 2
    SPECKLE = 3
    EDGE = 4
    PRIOR = 5


def _owned(
    array: npt.ArrayLike, dtype: npt.DTypeLike, name: str, shape: tuple[int | None, ...]
) -> npt.NDArray[np.generic]:
    """A read-only copy with the asked type and shape (None: any length)."""
    copy = np.array(array, dtype=dtype)
    fits = copy.ndim == len(shape) and all(
        want is None or want == got for want, got in zip(shape, copy.shape, strict=True)
    )
    if not fits:
        wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
        raise DataError(f"{name} has shape {copy.shape}, wanted {wanted}")
    copy.setflags(write=False)
    return copy


def _own(record: object, dtype: npt.DTypeLike, **shapes: tuple[int | None, ...]) -> None:
    """Replace fields of a frozen record by their checked read-only copies."""
    for name, shape in shapes.items():
        object.__setattr__(record, name, _owned(getattr(record, name), dtype, f"{type(record).__name__}.{name}", shape))


def _own_pose(record: object, *names: str) -> None:
    _own(record, np.float64, **dict.fromkeys(names, (4, 4)))
    for name in names:
        if not is_rigid(getattr(record, name)):
            raise DataError(f"{type(record).__name__}.{name} is not a right-handed rigid pose")


@dataclass(frozen=True)
class CameraModel:
    """Pinhole with non-square pixels and lens distortion (OpenCV's k1, k2, p1, p2, k3)."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def matrix(self) -> FloatArray:
        """Camera matrix (3, 3)."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class CameraFrame:
    """One grey picture (H, W) uint8 with the pose of the camera that took it."""

    image: ByteArray
    t_s: float
    camera: CameraModel
    world_from_camera: FloatArray

    def __post_init__(self) -> None:
        _own(self, np.uint8, image=(self.camera.height_px, self.camera.width_px))
        _own_pose(self, "world_from_camera")


@dataclass(frozen=True)
class Detection:
    """A part as the camera sees it: its boundary (N, 2) x, y in pixels of the picture, pixel centres at whole numbers.

    `holes_px` are the boundaries of its holes; `centroid_px` (2,) and `area_px` belong to its pixels without holes;
    `touches_border` says that the picture may cut it; `level` is the grey level that divided the picture, and
    `separability` in [0, 1] how clearly; `confidence` in [0, 1] is the share of the boundary that is a real edge.
    """

    contour_px: FloatArray
    centroid_px: FloatArray
    area_px: float
    touches_border: bool
    level: int
    separability: float
    confidence: float
    holes_px: tuple[FloatArray, ...] = ()

    def __post_init__(self) -> None:
        _own(self, np.float64, contour_px=(None, 2), centroid_px=(2,))
        if len(self.contour_px) < 3:
            raise DataError(f"a detection needs at least 3 contour points, this one has {len(self.contour_px)}")
        holes = tuple(
            np.asarray(_owned(hole, np.float64, "Detection.holes_px", (None, 2)), dtype=np.float64)
            for hole in self.holes_px
        )
        object.__setattr__(self, "holes_px", holes)


@dataclass(frozen=True)
class Outline:
    """The part's boundary as dominant points in the part frame: (N, 2) u, v in m, counter-clockwise, not repeated.

    `sigma_m` (N,) is the standard deviation of each vertex (0: unknown); `margin_m` says how far it was enlarged.
    `viewpoint_m` (3,) is where the camera was, in the part frame: a point off the plane w = 0 belongs to the part when
    it is seen inside the outline from there (None: seen along w).
    """

    vertices_m: FloatArray
    world_from_part: FloatArray
    margin_m: float = 0.0
    sigma_m: FloatArray = field(default_factory=lambda: np.zeros(0))
    holes_m: tuple[FloatArray, ...] = ()
    viewpoint_m: FloatArray | None = None

    def __post_init__(self) -> None:
        _own(self, np.float64, vertices_m=(None, 2))
        if self.viewpoint_m is not None:
            _own(self, np.float64, viewpoint_m=(3,))
        if len(self.vertices_m) < 3:
            raise DataError(f"an outline needs at least 3 vertices, this one has {len(self.vertices_m)}")
        if not np.all(np.isfinite(self.vertices_m)):
            raise DataError("an outline must have finite vertices")
        sigma = self.sigma_m if np.size(self.sigma_m) else np.zeros(len(self.vertices_m))
        object.__setattr__(self, "sigma_m", sigma)
        _own(self, np.float64, sigma_m=(len(self.vertices_m),))
        _own_pose(self, "world_from_part")
        holes = tuple(
            np.asarray(_owned(hole, np.float64, "Outline.holes_m", (None, 2)), dtype=np.float64)
            for hole in self.holes_m
        )
        object.__setattr__(self, "holes_m", holes)


@dataclass(frozen=True)
class SkippedStop:
    """A stop that the plan leaves out, where it would have been (part frame), and why."""

    u_m: float
    v_m: float
    reason: str


@dataclass(frozen=True)
class ScanPlan:
    """Targets of the grip in visiting order.

    `world_from_grip` (N, 4, 4), `uv_m` (N, 2) where the grip axis meets the acquisition plane (part frame),
    `row` (N,) the scan line, `joints_rad` (N, J) the chosen configuration.
    """

    world_from_grip: FloatArray
    uv_m: FloatArray
    row: IntArray
    joints_rad: FloatArray
    outline: Outline
    step_m: float
    standoff_m: float
    skipped: tuple[SkippedStop, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.uv_m)
        _own(self, np.float64, world_from_grip=(n, 4, 4), uv_m=(n, 2), joints_rad=(n, None))
        _own(self, np.int64, row=(n,))

    def __len__(self) -> int:
        return len(self.uv_m)


@dataclass(frozen=True)
class SensorSpec:
    """What is known of a range sensor before it is used; the estimators know no more than this.

    `dead_length_m` says how far in front of the sensor's origin its beam starts (a tube); the range counts from the
    origin.
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

    def __post_init__(self) -> None:
        if not 0.0 <= self.range_min_m < self.range_max_m:
            raise DataError(
                f"sensor '{self.name}': range_min_m = {self.range_min_m} and range_max_m = {self.range_max_m}",
                cure="give 0 <= range_min_m < range_max_m, in metres",
            )
        if not 0.0 < self.beam_full_angle_rad <= np.pi:
            degrees = np.degrees(self.beam_full_angle_rad)
            raise DataError(f"sensor '{self.name}': beam_full_angle_deg = {degrees:g}", cure="give 0 < angle <= 180")
        if not self.sigma_m > 0.0:
            raise DataError(
                f"sensor '{self.name}': sigma_m = {self.sigma_m}",
                cure="give a standard deviation > 0 in metres",
            )


@dataclass(frozen=True)
class Fixture:
    """Where the S sensors of the array sit: `grip_from_sensor` (S, 4, 4), beams along each sensor's z."""

    grip_from_sensor: FloatArray
    specs: tuple[SensorSpec, ...]

    def __post_init__(self) -> None:
        _own(self, np.float64, grip_from_sensor=(len(self.specs), 4, 4))

    def __len__(self) -> int:
        return len(self.specs)


@dataclass(frozen=True)
class Echo:
    """The answer of one sensor to one trigger: the mean of several pings, already averaged by the node.

    `amplitude` is the strength of the echo (1: a facing plate; nan: unknown), `spread_m` the standard deviation
    of the pings that agreed, `count` how many they were, `t_s` the moment of the first emission.
    """

    range_m: float
    status: Status
    t_s: float
    amplitude: float = float("nan")
    spread_m: float = float("nan")
    count: int = 1


@dataclass(frozen=True)
class JointState:
    """Joint positions (J,) rad at a moment."""

    position_rad: FloatArray
    t_s: float

    def __post_init__(self) -> None:
        _own(self, np.float64, position_rad=(None,))


@dataclass(frozen=True)
class Sweep:
    """The readings of one stop: S readings in columns, with the pose of each sensor as reached (world frame).

    `sensor` (S,) indexes the specs of the scan; a sensor may be missing. `axis` (S, 3) has unit length. `spread_m` (S,)
    is the scatter of the pings behind each reading, `sigma_m` (S,) the standard deviation of the reading where the log
    states one, else nan: then the spec's holds.
    """

    stop: int
    row: int
    world_from_grip: FloatArray
    t_s: FloatArray
    sensor: IntArray
    position_m: FloatArray
    axis: FloatArray
    range_m: FloatArray
    status: IntArray
    amplitude: FloatArray
    spread_m: FloatArray
    count: IntArray
    joints_rad: FloatArray = field(default_factory=lambda: np.zeros(0))
    sigma_m: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        s = len(self.sensor)
        if not np.size(self.sigma_m):
            object.__setattr__(self, "sigma_m", np.full(s, np.nan))
        _own(
            self,
            np.float64,
            t_s=(s,),
            position_m=(s, 3),
            axis=(s, 3),
            range_m=(s,),
            amplitude=(s,),
            spread_m=(s,),
            sigma_m=(s,),
        )
        _own(self, np.int64, sensor=(s,), status=(s,), count=(s,))
        _own(self, np.float64, joints_rad=(None,))
        _own_pose(self, "world_from_grip")


@dataclass(frozen=True)
class Readings:
    """All readings of a scan in columns, sweep after sweep: what every fusion method starts from.

    N readings, M sweeps; sweep j holds the rows `start[j]:start[j + 1]`. `stop` and `row` (M,) number the stop
    and its scan line, `world_from_grip` (M, 4, 4) is the grip pose of each sweep. `sigma_m` (N,) is the reading's
    own standard deviation where the log has one, else nan (use the spec's); `spread_m` (N,) the scatter of its pings.
    """

    specs: tuple[SensorSpec, ...]
    t_s: FloatArray
    sensor: IntArray
    position_m: FloatArray
    axis: FloatArray
    range_m: FloatArray
    status: IntArray
    amplitude: FloatArray
    sigma_m: FloatArray
    count: IntArray
    start: IntArray
    stop: IntArray
    row: IntArray
    world_from_grip: FloatArray
    spread_m: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        n, m = len(self.t_s), len(self.stop)
        if not np.size(self.spread_m):
            object.__setattr__(self, "spread_m", np.full(n, np.nan))
        _own(
            self,
            np.float64,
            t_s=(n,),
            position_m=(n, 3),
            axis=(n, 3),
            range_m=(n,),
            amplitude=(n,),
            sigma_m=(n,),
            spread_m=(n,),
        )
        _own(self, np.int64, sensor=(n,), status=(n,), count=(n,), start=(m + 1,), stop=(m,), row=(m,))
        _own(self, np.float64, world_from_grip=(m, 4, 4))
        if n and not (int(self.sensor.min()) >= 0 and int(self.sensor.max()) < len(self.specs)):
            raise DataError(f"readings name sensor {int(self.sensor.max())}, but there are {len(self.specs)} sensors")
        if self.start[0] != 0 or self.start[-1] != n or np.any(np.diff(self.start) < 0):
            raise DataError("the sweeps of the readings do not cover the rows in order")

    @property
    def n_sweeps(self) -> int:
        """Number of sweeps M."""
        return len(self.stop)

    def sweep(self, j: int) -> Sweep:
        """Sweep j as the record that live fusion receives."""
        rows = slice(int(self.start[j]), int(self.start[j + 1]))
        return Sweep(
            stop=int(self.stop[j]),
            row=int(self.row[j]),
            world_from_grip=self.world_from_grip[j],
            t_s=self.t_s[rows],
            sensor=self.sensor[rows],
            position_m=self.position_m[rows],
            axis=self.axis[rows],
            range_m=self.range_m[rows],
            status=self.status[rows],
            amplitude=self.amplitude[rows],
            spread_m=self.spread_m[rows],
            sigma_m=self.sigma_m[rows],
            count=self.count[rows],
        )


def readings_from_sweeps(specs: tuple[SensorSpec, ...], sweeps: list[Sweep]) -> Readings:
    """Stack sweeps, in the order given, into the columns of one scan."""
    sizes = [len(sweep.sensor) for sweep in sweeps]

    def column(name: str, *tail: int) -> FloatArray:
        return np.concatenate([getattr(sweep, name) for sweep in sweeps]) if sweeps else np.zeros((0, *tail))

    def integers(name: str) -> IntArray:
        return column(name).astype(np.int64)

    return Readings(
        specs=specs,
        t_s=column("t_s"),
        sensor=integers("sensor"),
        position_m=column("position_m", 3),
        axis=column("axis", 3),
        range_m=column("range_m"),
        status=integers("status"),
        amplitude=column("amplitude"),
        sigma_m=column("sigma_m"),
        spread_m=column("spread_m"),
        count=integers("count"),
        start=np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)]),
        stop=np.array([sweep.stop for sweep in sweeps], dtype=np.int64),
        row=np.array([sweep.row for sweep in sweeps], dtype=np.int64),
        world_from_grip=np.array([sweep.world_from_grip for sweep in sweeps]).reshape(-1, 4, 4),
    )


@dataclass(frozen=True)
class FusionScene:
    """What a fusion method knows before the first reading: sensors, part frame, outline, limits of the cell.

    `depth_max_m` bounds the range along the grip axis (the table's outer edge; inf: unknown). The outline is the
    one that the camera saw, not enlarged (None: unknown).
    """

    specs: tuple[SensorSpec, ...]
    world_from_part: FloatArray
    outline: Outline | None = None
    depth_max_m: float = float("inf")

    def __post_init__(self) -> None:
        _own_pose(self, "world_from_part")


@dataclass(frozen=True)
class FusedPoint:
    """The fused value of one stop: M(n), its standard deviation, and why.

    `depth_m` is M(n), the range assigned to the grip axis (nan: a gap, see `gap`); `point_m` (3,) the same as u, v, w
    in the part frame; `dc`, `dc1`, `dc2`, `dc3` (S,) the degree of confidence of each reading and its factors;
    `gate` (S,) why a reading took no part; `reset` whether the prediction window started afresh.
    """

    stop: int
    row: int
    depth_m: float
    sigma_m: float
    point_m: FloatArray
    sensor: IntArray
    dc: FloatArray
    dc1: FloatArray
    dc2: FloatArray
    dc3: FloatArray
    gate: IntArray
    gap: Gap
    reset: bool

    def __post_init__(self) -> None:
        s = len(self.sensor)
        _own(self, np.float64, point_m=(3,), dc=(s,), dc1=(s,), dc2=(s,), dc3=(s,))
        _own(self, np.int64, sensor=(s,), gate=(s,))


@dataclass(frozen=True)
class FusedPoints:
    """Fused points of a scan in columns: M stops, their N readings ragged by `start` as in `Readings`."""

    stop: IntArray
    row: IntArray
    depth_m: FloatArray
    sigma_m: FloatArray
    point_m: FloatArray
    gap: IntArray
    reset: BoolArray
    start: IntArray
    sensor: IntArray
    dc: FloatArray
    dc1: FloatArray
    dc2: FloatArray
    dc3: FloatArray
    gate: IntArray

    def __post_init__(self) -> None:
        m, n = len(self.stop), len(self.sensor)
        _own(
            self,
            np.float64,
            depth_m=(m,),
            sigma_m=(m,),
            point_m=(m, 3),
            dc=(n,),
            dc1=(n,),
            dc2=(n,),
            dc3=(n,),
        )
        _own(self, np.int64, stop=(m,), row=(m,), gap=(m,), start=(m + 1,), sensor=(n,), gate=(n,))
        _own(self, np.bool_, reset=(m,))

    def __len__(self) -> int:
        return len(self.stop)

    def at(self, j: int) -> FusedPoint:
        """Fused point j as the record that live fusion returns."""
        rows = slice(int(self.start[j]), int(self.start[j + 1]))
        return FusedPoint(
            stop=int(self.stop[j]),
            row=int(self.row[j]),
            depth_m=float(self.depth_m[j]),
            sigma_m=float(self.sigma_m[j]),
            point_m=self.point_m[j],
            sensor=self.sensor[rows],
            dc=self.dc[rows],
            dc1=self.dc1[rows],
            dc2=self.dc2[rows],
            dc3=self.dc3[rows],
            gate=self.gate[rows],
            gap=Gap(int(self.gap[j])),
            reset=bool(self.reset[j]),
        )


@dataclass(frozen=True)
class MapGrid:
    """Node-registered axes of a map: `u_m` (C,) and `v_m` (R,) increasing, in a part frame."""

    u_m: FloatArray
    v_m: FloatArray
    world_from_part: FloatArray

    def __post_init__(self) -> None:
        _own(self, np.float64, u_m=(None,), v_m=(None,))
        _own_pose(self, "world_from_part")
        for name, nodes in (("u_m", self.u_m), ("v_m", self.v_m)):
            if len(nodes) == 0 or not np.all(np.isfinite(nodes)) or np.any(np.diff(nodes) <= 0.0):
                raise DataError(f"MapGrid.{name} must be finite, increasing and not empty")

    @property
    def shape(self) -> tuple[int, int]:
        """(R, C): nodes along v, nodes along u."""
        return len(self.v_m), len(self.u_m)


@dataclass(frozen=True)
class SurfaceMap:
    """The fused surface w over (u, v): all layers (R, C), rows along v, columns along u.

    `mask` marks the cells that have a value; elsewhere height and sigma are nan. `count` says how many readings a
    cell rests on, `regime` (see `Regime`) what kind of evidence. Where two surfaces compete (beside a step), a method
    may give the second one: its height (nan: none) and its probability (0: none).
    """

    grid: MapGrid
    height_m: FloatArray
    sigma_m: FloatArray
    confidence: FloatArray
    count: IntArray
    mask: BoolArray
    regime: ByteArray
    method: str
    alternative_height_m: FloatArray | None = None
    alternative_weight: FloatArray | None = None

    def __post_init__(self) -> None:
        shape = self.grid.shape
        if self.alternative_height_m is not None and self.alternative_weight is not None:
            _own(self, np.float64, alternative_height_m=shape, alternative_weight=shape)
        _own(self, np.float64, height_m=shape, sigma_m=shape, confidence=shape)
        _own(self, np.int64, count=shape)
        _own(self, np.bool_, mask=shape)
        _own(self, np.uint8, regime=shape)
        if not np.all(np.isfinite(self.height_m[self.mask])):
            raise DataError("a map has cells marked as measured without a finite height")


@dataclass(frozen=True)
class FusionResult:
    """What a fusion method returns: its points, and its own map when it makes one (None: grid the points)."""

    points: FusedPoints
    surface: SurfaceMap | None = None


@dataclass(frozen=True)
class Score:
    """Errors of a map against truth over the cells where both have a value; coverage over all cells of the truth."""

    rmse_m: float
    mae_m: float
    bias_m: float
    p95_m: float
    coverage: float
    cells: int
