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
    JointState,
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
