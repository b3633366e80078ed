"""Records: shapes checked once, arrays copied and read-only, sweeps and readings the same numbers."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from surfuse import records
from surfuse.errors import DataError
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import (
    CameraFrame,
    CameraModel,
    Detection,
    Fixture,
    FusedPoints,
    FusionScene,
    Gap,
    JointSamples,
    JointState,
    LateTable,
    MapGrid,
    Outline,
    Readings,
    ScanPlan,
    SensorSpec,
    Status,
    SurfaceMap,
    Sweep,
    readings_from_sweeps,
)
from surfuse.records.columns import ArrayRecord

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
SPEC = SensorSpec("us0", "ultrasonic", 0.3, 4.0, 0.4, 0.001)


def sweep(stop: int, sensors: tuple[int, ...] = (0, 1), **changes: object) -> Sweep:
    s = len(sensors)
    rng = np.random.default_rng(stop)
    values = {
        "stop": stop,
        "row": stop // 3,
        "world_from_grip": pose(rotation_about([1, 2, 3], 0.1 * stop), [stop, 0, 1]),
        "t_s": stop + 0.1 * np.arange(s),
        "sensor": np.array(sensors),
        "position_m": rng.normal(size=(s, 3)),
        "axis": np.tile([0.0, 0.0, 1.0], (s, 1)),
        "range_m": np.where(np.arange(s) == 1, np.inf, rng.uniform(0.3, 1.0, s)),
        "status": np.where(np.arange(s) == 1, int(Status.NO_ECHO), int(Status.OK)),
        "amplitude": rng.uniform(size=s),
        "spread_m": rng.uniform(size=s),
        "count": np.full(s, 5),
        "sigma_m": np.where(np.arange(s) == 0, 0.002, np.nan),
    }
    return Sweep(**{**values, **changes})


def surface(**changes: object) -> SurfaceMap:
    grid = MapGrid(np.arange(3.0), np.arange(2.0), np.eye(4))
    full = np.ones((2, 3))
    values = {"height_m": full, "sigma_m": full, "confidence": full, "count": full, "mask": full, "regime": full}
    return SurfaceMap(grid=grid, method="test", **{**values, **changes})


def test_a_record_owns_its_arrays():
    vertices = SQUARE.copy()
    outline = Outline(vertices, np.eye(4))
    vertices[0] = 99.0
    assert np.array_equal(outline.vertices_m, SQUARE)
    with pytest.raises(ValueError, match="read-only"):
        outline.vertices_m[0] = 1.0


def every_record():
    camera = CameraModel(4, 3, 1.0, 2.0, 1.5, 1.0)
    readings = readings_from_sweeps((SPEC, SPEC), [sweep(0), sweep(1)])
    none, one = np.zeros(0), np.zeros(1)
    return [
        CameraFrame(np.zeros((3, 4)), 0.0, camera, np.eye(4)),
        Detection(SQUARE, [0.5, 0.5], 1.0, False, 100, 0.9, 1.0, (SQUARE,)),
        Outline(SQUARE, np.eye(4), viewpoint_m=np.zeros(3), holes_m=(SQUARE,)),
        ScanPlan(np.eye(4)[None], [[0, 0]], [0], np.zeros((1, 6)), Outline(SQUARE, np.eye(4)), 0.01, 0.43),
        Fixture(np.eye(4)[None], (SPEC,)),
        JointState(np.zeros(6), 0.0),
        sweep(0),
        readings,
        FusionScene((SPEC,), np.eye(4)),
        FusedPoints(
            *([0], [0], one, one, np.zeros((1, 3)), [0], [False], [0, 0]), *(none, none, none, none, none, none)
        ),
        MapGrid(one, one, np.eye(4)),
        surface(),
    ]


@pytest.mark.parametrize("record", every_record(), ids=lambda record: type(record).__name__)
def test_all_arrays_of_all_records_are_read_only_and_fields_are_frozen(record):
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        for array in value if isinstance(value, tuple) else (value,):
            assert not isinstance(array, np.ndarray) or not array.flags.writeable, field.name
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(record, dataclasses.fields(record)[0].name, None)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Outline(SQUARE[:2], np.eye(4)), "at least 3 vertices, this one has 2"),
        (lambda: Outline(SQUARE * np.nan, np.eye(4)), "finite"),
        (lambda: Outline(SQUARE, 2.0 * np.eye(4)), "rigid"),
        (lambda: Outline(SQUARE, np.diag([-1.0, 1.0, 1.0, 1.0])), "right-handed"),
        (lambda: Outline(SQUARE[:, :1], np.eye(4)), r"Outline.vertices_m has shape \(4, 1\), wanted \(any, 2\)"),
        (lambda: Detection(SQUARE[:2], [0, 0], 1.0, False, 1, 0.5, 1.0), "at least 3 contour points"),
        (lambda: CameraFrame(np.zeros((4, 3)), 0.0, CameraModel(4, 3, 1, 1, 0, 0), np.eye(4)), r"\(4, 3\), wanted"),
        (lambda: dataclasses.replace(SPEC, range_min_m=4.0), "range_min_m = 4.0"),
        (lambda: dataclasses.replace(SPEC, range_max_m=float("nan")), "range_max_m = nan"),
        (lambda: dataclasses.replace(SPEC, beam_full_angle_rad=0.0), "beam_full_angle_deg = 0"),
        (lambda: dataclasses.replace(SPEC, sigma_m=0.0), "sigma_m = 0.0"),
        (lambda: sweep(0, axis=np.zeros((2, 2))), "Sweep.axis"),
        (lambda: sweep(0, range_m=np.zeros(3)), "Sweep.range_m"),
        (lambda: readings_from_sweeps((SPEC,), [sweep(0)]), "sensor 1, but there are 1 sensors"),
        (
            lambda: MapGrid([0.0, 0.0], [0.0], np.eye(4)),
            "MapGrid.u_m goes from 0 to 0 at 1; give finite, increasing numbers",
        ),
        (lambda: MapGrid([0.0], [], np.eye(4)), "MapGrid.v_m is empty"),
        (lambda: surface(height_m=np.full((2, 3), np.nan)), "without a finite height"),
        (lambda: surface(count=np.ones((3, 2))), r"SurfaceMap.count has shape \(3, 2\), wanted \(2, 3\)"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_name(make, told):
    with pytest.raises(DataError, match=told):
        make()


def test_readings_give_back_the_sweeps_that_they_were_made_of():
    sweeps = [sweep(0), sweep(1, (1,)), sweep(4, (0, 1, 1))]
    readings = readings_from_sweeps((SPEC, SPEC), sweeps)
    assert readings.n_sweeps == 3
    assert readings.start.tolist() == [0, 2, 3, 6]
    for j, given in enumerate(sweeps):
        found = readings.sweep(j)
        for field in dataclasses.fields(Sweep):
            if field.name != "joints_rad":
                one, other = np.asarray(getattr(given, field.name)), np.asarray(getattr(found, field.name))
                assert field.name == "spread_m" or np.array_equal(one, other, equal_nan=one.dtype.kind == "f")


def test_no_sweep_is_a_scan_too():
    readings = readings_from_sweeps((SPEC,), [])
    assert (readings.n_sweeps, len(readings.t_s), readings.position_m.shape) == (0, 0, (0, 3))


@pytest.mark.parametrize("start", [[0, 1], [1, 2], [0, 3, 2]])
def test_sweeps_cover_the_readings_in_order(start):
    readings = readings_from_sweeps((SPEC, SPEC), [sweep(0)])
    m = len(start) - 1
    per_stop = {"stop": np.zeros(m), "row": np.zeros(m), "world_from_grip": np.tile(np.eye(4), (m, 1, 1))}
    with pytest.raises(DataError, match="in order"):
        dataclasses.replace(readings, start=np.array(start), **per_stop)


def test_a_fused_point_is_its_row_of_the_columns():
    points = FusedPoints(
        stop=[3, 7],
        row=[0, 1],
        depth_m=[0.4, np.nan],
        sigma_m=[0.001, np.nan],
        point_m=[[1, 2, 3], [4, 5, 6]],
        gap=[int(Gap.NONE), int(Gap.OUTSIDE_PART)],
        reset=[True, False],
        start=[0, 2, 3],
        sensor=[0, 1, 0],
        dc=[0.1, 0.2, 0.3],
        dc1=[1, 1, 1],
        dc2=[1, 1, 1],
        dc3=[0.1, 0.2, 0.3],
        gate=[0, 0, 1],
    )
    assert len(points) == 2
    first, second = points.at(0), points.at(1)
    assert (first.stop, first.depth_m, first.reset, first.gap) == (3, 0.4, True, Gap.NONE)
    assert first.dc.tolist() == [0.1, 0.2]
    assert (second.gap, second.gate.tolist()) == (Gap.OUTSIDE_PART, [1])
    assert np.isnan(second.depth_m)


def test_numbers_of_the_words_are_a_file_format():
    """They are in logs and maps on disk: a changed number would change the meaning of old files."""
    numbers = {kind.__name__: {one.name: int(one) for one in kind} for kind in (Status, Gap)}
    assert numbers == {
        "Status": {"OK": 0, "NO_ECHO": 1, "TOO_CLOSE": 2, "FAULT": 3},
        "Gap": {"NONE": 0, "NO_VALID_READING": 1, "NO_CONFIDENCE": 2, "OUTSIDE_PART": 3},
    }
    assert {one.name: int(one) for one in records.Regime}["MEASURED"] == 1


def test_camera_matrix_has_pixels_that_are_not_square():
    matrix = CameraModel(500, 582, 520.0, 760.0, 249.5, 290.5).matrix
    assert matrix.tolist() == [[520.0, 0.0, 249.5], [0.0, 760.0, 290.5], [0.0, 0.0, 1.0]]


def test_readings_type_is_what_fusion_takes():
    assert isinstance(readings_from_sweeps((SPEC, SPEC), [sweep(0)]), Readings)


def test_an_array_that_nobody_can_write_to_is_not_copied() -> None:
    fixed = np.arange(3.0)
    fixed.setflags(write=False)
    assert MapGrid(fixed, fixed, np.eye(4)).u_m is fixed
    open_array = np.arange(3.0)
    view = open_array[:]
    view.setflags(write=False)
    grid = MapGrid(open_array, view, np.eye(4))
    open_array[0] = -5.0
    assert grid.u_m[0] == grid.v_m[0] == 0.0


SPEC_FAULTS = [
    ({"sigma_m": float("inf")}, "sigma_m = inf; give a standard deviation > 0"),
    ({"sigma_m": float("nan")}, "sigma_m = nan"),
    ({"firing_time_s": -0.1}, "firing_time_s = -0.1; give a number of at least 0"),
    ({"firing_time_s": float("nan")}, "firing_time_s = nan"),
    ({"incidence_limit_rad": 0.0}, "incidence_limit_rad = 0; give a number above 0"),
    ({"range_max_m": float("inf")}, "range_max_m = inf; give 0 <= range_min_m < range_max_m, finite"),
    ({"dead_length_m": 0.4}, "range_min_m = 0.3 lies inside the tube, dead_length_m = 0.4; .* range_min_m >= dead"),
    ({"kind": "banana"}, "unknown kind 'banana'; valid: infrared, laser, tof, touch, ultrasonic"),
    ({"kind": "lasser"}, "unknown kind 'lasser'; did you mean 'laser'"),
    ({"kind": ""}, "unknown kind ''"),
]


@pytest.mark.parametrize(("change", "told"), SPEC_FAULTS, ids=lambda value: str(value)[:40])
def test_a_sensor_that_cannot_be_is_refused_with_value_limit_and_cure(change, told):
    with pytest.raises(DataError, match=f"sensor 'us0': .*{told}"):
        dataclasses.replace(SPEC, **change)


@pytest.mark.parametrize(
    ("old", "kind"), [("optical", "tof"), ("lidar", "laser"), ("sonar", "ultrasonic"), ("Ultrasonic", "ultrasonic")]
)
def test_kinds_of_older_files_are_read(old, kind):
    assert dataclasses.replace(SPEC, kind=old).kind == kind


def test_every_kind_but_sound_measures_along_its_axis():
    assert [kind for kind in records.SENSOR_KINDS if not dataclasses.replace(SPEC, kind=kind).along_axis] == [
        "ultrasonic"
    ]
    assert set(records.LIGHT_KINDS) < set(records.SENSOR_KINDS)


CAMERA = CameraModel(4, 3, 1.0, 2.0, 1.5, 1.0)
STRETCHED = np.diag([2.0, 1.0, 1.0, 1.0])
OUTLINE = Outline(SQUARE, np.eye(4))
PLAN = ScanPlan(np.eye(4)[None], [[0, 0]], [0], np.zeros((1, 6)), OUTLINE, 0.01, 0.43)
MAP = surface(alternative_height_m=np.ones((2, 3)), alternative_weight=np.full((2, 3), 0.5))
SWEEP = sweep(0)
READINGS = readings_from_sweeps((SPEC, SPEC), [sweep(0), sweep(1)])
LATE = LateTable((0.0, 0.1), (0.0, 0.0), (0.0, 0.001))
NAN, INF = float("nan"), float("inf")

FAULTS = [
    (CAMERA, {"width_px": -5}, "CameraModel.width_px = -5; give a number of at least 1"),
    (CAMERA, {"height_px": 0}, "CameraModel.height_px = 0"),
    (CAMERA, {"fx_px": 0.0}, "CameraModel.fx_px = 0; give a number above 0"),
    (CAMERA, {"fy_px": -3.0}, "CameraModel.fy_px = -3"),
    (CAMERA, {"cx_px": NAN}, "CameraModel.cx_px = nan"),
    (CAMERA, {"distortion": (0.0, 0.0, INF, 0.0, 0.0)}, "CameraModel.distortion"),
    (CAMERA, {"distortion": (0.0,)}, "give k1, k2, p1, p2, k3"),
    (OUTLINE, {"margin_m": NAN}, "Outline.margin_m = nan"),
    (OUTLINE, {"margin_m": -0.01}, "Outline.margin_m = -0.01; give a number of at least 0"),
    (OUTLINE, {"sigma_m": np.full(4, -0.1)}, "Outline.sigma_m holds -0.1; give 0 or more"),
    (OUTLINE, {"holes_m": (SQUARE[:2],)}, r"Outline.holes_m\[0\] has 2 points"),
    (OUTLINE, {"holes_m": (SQUARE * NAN,)}, r"Outline.holes_m\[0\] holds nan"),
    (OUTLINE, {"viewpoint_m": np.array([0.0, NAN, 1.0])}, "Outline.viewpoint_m holds nan"),
    (
        PLAN,
        {"world_from_grip": STRETCHED[None]},
        r"ScanPlan.world_from_grip\[0\] is not a right-handed rigid pose; give",
    ),
    (PLAN, {"step_m": 0.0}, "ScanPlan.step_m = 0; give a number above 0"),
    (PLAN, {"standoff_m": -0.4}, "ScanPlan.standoff_m = -0.4"),
    (PLAN, {"joints_rad": np.full((1, 6), NAN)}, "ScanPlan.joints_rad holds nan"),
    (PLAN, {"uv_m": [[NAN, 0.0]]}, "ScanPlan.uv_m holds nan"),
    (Fixture(np.eye(4)[None], (SPEC,)), {"grip_from_sensor": STRETCHED[None]}, r"Fixture.grip_from_sensor\[0\] is not"),
    (JointState(np.zeros(6), 0.0), {"position_rad": np.full(6, INF)}, "JointState.position_rad holds inf"),
    (JointSamples([0.0, 1.0], np.zeros((2, 6))), {"position_rad": np.full((2, 6), NAN)}, "JointSamples.position_rad"),
    (FusionScene((SPEC,), np.eye(4)), {"depth_max_m": NAN}, "FusionScene.depth_max_m = nan"),
    (FusionScene((SPEC,), np.eye(4)), {"depth_max_m": -1.0}, "FusionScene.depth_max_m = -1; give a range above 0"),
    (LATE, {"scatter_m": (0.0, INF)}, "scatters .*inf.*; give finite biases, and scatters of 0 or more"),
    (MAP, {"alternative_height_m": np.ones((3, 2))}, r"alternative_height_m has shape \(3, 2\), wanted \(2, 3\)"),
    (MAP, {"alternative_weight": np.ones(3)}, "alternative_weight has shape"),
    (MAP, {"alternative_weight": None}, "has the height of a second surface alone; give both layers, or neither"),
    (MAP, {"alternative_height_m": None}, "has the weight of a second surface alone"),
    (MAP, {"alternative_weight": np.full((2, 3), 1.5)}, "SurfaceMap.alternative_weight holds 1.5; give 0 to 1"),
    (MAP, {"sigma_m": np.full((2, 3), -0.1)}, "SurfaceMap.sigma_m holds -0.1; give 0 or more"),
    (MAP, {"confidence": np.full((2, 3), 2.0)}, "SurfaceMap.confidence holds 2; give 0 to 1"),
    (MAP, {"count": np.full((2, 3), -1)}, "SurfaceMap.count holds -1"),
    (MAP, {"regime": np.full((2, 3), 77)}, "SurfaceMap.regime holds 77; give 0 to 6"),
    (SWEEP, {"axis": np.full((2, 3), 1.0)}, r"Sweep.axis\[0\] has the length 1.73205, wanted 1; give unit vectors"),
    (SWEEP, {"world_from_grip": STRETCHED}, "Sweep.world_from_grip is not a right-handed rigid pose"),
    (SWEEP, {"status": np.array([0, 9])}, "Sweep.status holds 9; give 0 to 3"),
    (SWEEP, {"sigma_m": np.array([-1.0, NAN])}, "Sweep.sigma_m holds -1; give 0 or more"),
    (SWEEP, {"count": np.array([-1, 1])}, "Sweep.count holds -1"),
    (
        READINGS,
        {"sensor": np.array([0, 1, 0, -1])},
        "a reading names sensor -1, but there are 2 sensors, numbered from 0",
    ),
    (READINGS, {"start": np.array([0, 3, 3])}, "Readings.start runs from 0 to 3 over 4 readings"),
    (READINGS, {"start": np.array([1, 2, 4])}, "Readings.start runs from 1"),
    (READINGS, {"start": np.array([0, 5, 4])}, "do not cover the rows in order"),
    (READINGS, {"world_from_grip": np.stack([np.eye(4), STRETCHED])}, r"Readings.world_from_grip\[1\] is not"),
]


@pytest.mark.parametrize(
    ("record", "change", "told"), FAULTS, ids=lambda value: str(value)[:40] if isinstance(value, dict) else ""
)
def test_a_record_that_cannot_be_is_refused_with_value_limit_and_cure(record, change, told):
    with pytest.raises(DataError, match=told) as refused:
        dataclasses.replace(record, **change)
    assert refused.value.cure or "shape" in refused.value.what


def copied(value: object) -> object:
    """The same value in other memory."""
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, tuple) and not dataclasses.is_dataclass(value):
        return tuple(copied(one) for one in value)
    return value


@pytest.mark.parametrize("record", every_record(), ids=lambda record: type(record).__name__)
def test_records_of_arrays_are_equal_when_all_their_fields_are(record):
    fields = {one.name: getattr(record, one.name) for one in dataclasses.fields(record)}
    twin = type(record)(**{name: copied(value) for name, value in fields.items()})
    assert twin == record
    assert hash(twin) == hash(record)
    assert {record: 1}[twin] == 1
    assert record != 3
    assert (record == object()) is False


def test_one_other_number_makes_another_record():
    assert sweep(0) == sweep(0)
    assert sweep(0) != sweep(1)
    assert sweep(0) != dataclasses.replace(sweep(0), range_m=sweep(0).range_m + 1e-12)
    assert dataclasses.replace(sweep(0), amplitude=[NAN, 1.0]) == dataclasses.replace(sweep(0), amplitude=[NAN, 1.0])
    assert dataclasses.replace(OUTLINE, viewpoint_m=np.zeros(3)) != OUTLINE
    assert dataclasses.replace(OUTLINE, holes_m=(SQUARE * 0.5,)) != OUTLINE
    assert dataclasses.replace(MAP) == MAP
    assert dataclasses.replace(MAP, grid=MapGrid(np.arange(3.0) + 1.0, np.arange(2.0), np.eye(4))) != MAP


def test_every_record_that_holds_arrays_can_be_compared():
    arrays = [
        record
        for record in vars(records).values()
        if dataclasses.is_dataclass(record) and any("Array" in str(one.type) for one in dataclasses.fields(record))
    ]
    assert len(arrays) > 12
    assert [record.__name__ for record in arrays if not issubclass(record, ArrayRecord)] == []
