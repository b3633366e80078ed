"""Maps of the Python door: the numbers of the commands, by another way."""

from __future__ import annotations

import builtins
import dataclasses
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
import xarray

import surfuse as sf
from surfuse.fusion import median
from surfuse.records import Regime

LAYERS = ("height_m", "sigma_m", "confidence", "count", "mask", "regime", "u_m", "v_m", "world_from_part")


def bits(surface: sf.SurfaceMap) -> dict[str, bytes]:
    return {name: getattr(surface, name).tobytes() for name in LAYERS}


@pytest.fixture
def log(plate_csv: Path) -> sf.Log:
    return sf.read(plate_csv)


@pytest.fixture
def surface(log: sf.Log) -> sf.SurfaceMap:
    return sf.fuse(log, "mean")


@pytest.mark.parametrize("method", ["mean", "weighted_average", "beam"])
def test_fusing_gives_the_map_of_the_command(method, plate_csv, tmp_path, command):
    answer = command("fuse", plate_csv, "--method", method, "--out", tmp_path / "run", "--json")
    assert answer.status == 0, answer.err
    ours, theirs = sf.fuse(sf.read(plate_csv), method), sf.open_map(tmp_path / "run")
    assert bits(ours) == bits(theirs)
    assert ours.method == theirs.method == method
    assert ours.height_m.shape == (len(ours.v_m), len(ours.u_m))
    assert ours.findings == theirs.findings
    assert ours.trust == theirs.trust == "doubtful"


def test_the_default_method_is_beam(log):
    assert bits(sf.fuse(log)) == bits(sf.fuse(log, method="beam"))


def test_parameters_reach_the_method(log, plate_csv, tmp_path, command):
    how = "fusion.parameters.weighted_average.use_dc1=false"
    answer = command("fuse", plate_csv, "--method", "weighted_average", "--set", how, "--out", tmp_path / "run")
    assert answer.status == 0, answer.err
    ours = sf.fuse(log, "weighted_average", parameters={"use_dc1": False})
    assert bits(ours) == bits(sf.open_map(tmp_path / "run"))
    assert bits(ours) != bits(sf.fuse(log, "weighted_average"))


def test_a_method_of_ones_own_is_used(log):
    ours = sf.fuse(log, median.create(median.Parameters()))
    assert bits(ours) == bits(sf.fuse(log, "median"))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"method": "maen"}, ["did you mean 'mean'"]),
        ({"method": 3}, ["method = 3"]),
        ({"method": "mean", "parameters": {"gate": 1}}, ["unknown key"]),
        ({"method": "mean", "parameters": {"gate_allowance_m": "wide"}}, ["gate_allowance_m"]),
        ({"method": "mean", "parameters": [1]}, ["parameters"]),
        ({"method": "mean", "parameters": {"gate_allowance_m": [1.0]}}, ["gate_allowance_m"]),
        ({"method": median.create(median.Parameters()), "parameters": {"x": 1}}, ["parameters"]),
        ({"log": "readings.csv"}, ["log", "sf.read"]),
    ],
)
def test_wrong_calls_are_refused(log, arguments, words):
    with pytest.raises(sf.SurfuseError) as caught:
        sf.fuse(**({"log": log} | arguments))
    for word in words:
        assert word in str(caught.value)
    assert caught.value.cure or re.search("give|valid", str(caught.value))


def test_parameters_of_numpy_are_plain_values(log):
    assert bits(sf.fuse(log, "mean", {"gate_allowance_m": np.float64(0.01)})) == bits(
        sf.fuse(log, "mean", {"gate_allowance_m": 0.01})
    )


def test_readings_without_an_echo_are_refused():
    silent = sf.log([0.0, 1.0], ["a", "a"], [[0, 0, 1], [0.1, 0, 1]], [[0, 0, -1]] * 2, [np.inf, np.nan])
    with pytest.raises(sf.SurfuseError, match="none of the 2 readings is an echo"):
        sf.fuse(silent, "mean")


def test_a_map_without_a_value_is_refused():
    sensor = sf.Sensor(kind="ultrasonic", beam_full_angle_deg=13.0, range_min_m=0.2, range_max_m=1.2, sigma_m=5e-4)
    near = sf.log([0.0, 1.0], ["a", "a"], [[0, 0, 1], [0.1, 0, 1]], [[0, 0, -1]] * 2, [0.1, 0.1], {"a": sensor})
    with pytest.raises(sf.SurfuseError, match="no cell"):
        sf.fuse(near, "mean")


@pytest.mark.parametrize(
    ("severities", "trust"),
    [
        ((), "good"),
        (("note",), "good"),
        (("note", "warning"), "doubtful"),
        (("alarm",), "bad"),
        (("warning", "alarm", "note"), "bad"),
    ],
)
def test_trust_follows_from_the_worst_finding(severities, trust, surface):
    findings = tuple(sf.Finding("log", severity, "what") for severity in severities)
    assert sf.SurfaceMap(surface.record, findings=findings, judged=True).trust == trust


def test_methods_are_those_of_the_command(command):
    assert sf.methods() == command("methods", "--json").json["methods"]


def test_findings_say_what_the_reader_and_the_method_noticed(arrays, log):
    found = sf.fuse(log, "mean")
    assert [(one.code, one.severity, one.what) for one in found.findings] == [
        ("log", "warning", text) for text in log.warnings
    ]
    order = np.argsort(arrays.t_s[:-1], kind="stable")
    sensor = sf.Sensor(kind="ultrasonic", beam_full_angle_deg=13.0, range_min_m=0.2, range_max_m=1.2, sigma_m=5e-4)
    clean = sf.log(
        arrays.t_s[order],
        [arrays.sensor[i] for i in order],
        arrays.position_m[order],
        arrays.axis[order],
        arrays.range_m[order],
        {"a": sensor, "b b": sensor},
        frame=([0, 0, 0], [1, 0, 0], [0, 1, 0]),
    )
    good = sf.fuse(clean, "mean")
    assert good.findings == ()
    assert good.trust == "good"
    guarded = sf.fuse(clean, "beam")
    assert {one.severity for one in guarded.findings} <= {"note"}
    assert ("guard" in {one.code for one in guarded.findings}) == bool(guarded.record.decisions)
    prior = int((guarded.mask & (guarded.regime == int(Regime.PRIOR))).sum())
    told = [one.what for one in guarded.findings if one.code == "not_measured"]
    assert [text.split()[0] for text in told] == ([str(prior)] if prior else [])
    assert guarded.trust == "good"


def test_a_map_file_alone_was_not_judged(surface, tmp_path):
    opened = sf.open_map(surface.save(tmp_path / "alone.nc"))
    assert opened.trust is None
    assert bits(opened) == bits(surface)


@pytest.mark.parametrize("method", ["mean", "beam"])
def test_why_says_what_the_command_says(method, plate_csv, tmp_path, command):
    assert command("fuse", plate_csv, "--method", method, "--out", tmp_path / "run").status == 0
    told = command("why", tmp_path / "run", "0", "20", "--json").json
    ours, opened = sf.fuse(sf.read(plate_csv), method), sf.open_map(tmp_path / "run")
    saved = sf.open_map(ours.save(tmp_path / "saved.nc"))
    for cell in (ours.why(u_mm=0, v_mm=20), opened.why(0, 20), saved.why(0, 20, log=plate_csv)):
        found = dataclasses.asdict(cell)
        assert isinstance(cell, sf.CellExplanation)
        for key in set(found) - {"stops", "readings"}:
            assert told[key] == pytest.approx(found[key]), key
        key = "stops" if cell.rule == "stops" else "readings"
        assert json.loads(json.dumps(nulls(found[key]))) == told[key]


def nulls(value: object) -> object:
    """Numbers that JSON lacks as null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: nulls(item) for key, item in value.items()}
    return [nulls(item) for item in value] if isinstance(value, list | tuple) else value


def test_why_beside_the_map_or_without_readings_is_refused(surface, tmp_path):
    with pytest.raises(sf.SurfuseError, match="u runs from"):
        surface.why(u_mm=9000, v_mm=0)
    opened = sf.open_map(surface.save(tmp_path / "alone.nc"))
    with pytest.raises(sf.SurfuseError, match="log"):
        opened.why(0, 0)
    with pytest.raises(sf.SurfuseError, match="neither its readings nor its file"):
        sf.SurfaceMap(surface.record).why(0, 0)


def test_saving_keeps_the_map_and_what_is_there(surface, tmp_path):
    path = surface.save(str(tmp_path / "surface.nc"))
    assert path == tmp_path / "surface.nc"
    opened = sf.open_map(path)
    assert opened.points.dc.tobytes() == surface.points.dc.tobytes()
    with pytest.raises(sf.SurfuseError, match=r"exists .*or overwrite=True to replace it") as refused:
        surface.save(path)
    assert "--force" not in str(refused.value)
    surface.save(path, overwrite=True)
    with pytest.raises(sf.SurfuseError, match="export"):
        surface.save(tmp_path / "surface.ply")
    with pytest.raises(sf.SurfuseError, match="folder"):
        surface.save(tmp_path / "nowhere" / "surface.nc")


def test_exporting_writes_the_format_of_the_suffix(surface, tmp_path):
    mesh = trimesh.load(surface.export(tmp_path / "part.ply"))
    assert len(mesh.vertices) == int(surface.mask.sum())
    exported = sf.open_map(surface.export(tmp_path / "part.csv"))
    assert np.array_equal(exported.height_m, surface.height_m, equal_nan=True)
    with pytest.raises(sf.SurfuseError, match=r"\.banana"):
        surface.export(tmp_path / "part.banana")
    with pytest.raises(sf.SurfuseError, match=r"exists .*overwrite=True"):
        surface.export(tmp_path / "part.ply")


@pytest.mark.parametrize("wrong", ["nowhere.nc", "map.banana", 3, None])
def test_a_map_that_is_not_there_is_refused(wrong, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "map.banana").write_text("no map")
    with pytest.raises(sf.SurfuseError):
        sf.open_map(wrong)


@pytest.mark.parametrize("method", ["mean", "beam"])
def test_the_dataset_is_what_xarray_reads_of_the_file(method, log, tmp_path):
    surface = sf.fuse(log, method)
    dataset = surface.to_xarray()
    file = xarray.load_dataset(surface.save(tmp_path / "surface.nc"), engine="h5netcdf")
    assert dataset.identical(file.assign(mask=dataset["mask"]))
    assert dataset["height"].attrs["units"] == dataset["u"].attrs["units"] == "m"
    assert dataset["height"].dims == ("v", "u")
    assert np.array_equal(dataset["height"].values, surface.height_m, equal_nan=True)
    assert dataset["mask"].dtype == bool
    assert float(dataset["height"].where(dataset["mask"]).mean()) == pytest.approx(float(np.nanmean(surface.height_m)))


def without(monkeypatch: pytest.MonkeyPatch, package: str) -> None:
    """Make a package one that is not installed."""
    real = builtins.__import__

    def missing(name: str, *rest: object) -> object:
        if name.partition(".")[0] == package:
            raise ModuleNotFoundError(f"No module named '{package}'", name=package)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", missing)


def test_a_missing_extra_is_one_line_with_its_command(surface, monkeypatch):
    without(monkeypatch, "xarray")
    with pytest.raises(sf.SurfuseError, match=r"'xarray'.*pip install 'surfuse\[xarray\]'"):
        surface.to_xarray()
    without(monkeypatch, "matplotlib")
    with pytest.raises(sf.SurfuseError, match=r"'matplotlib'.*pip install 'surfuse\[plot\]'"):
        surface.plot()


def test_a_plot_shows_the_layer(surface, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    import matplotlib.pyplot as plt

    _, axes = plt.subplots()
    assert surface.plot(axes) is axes
    (mesh,) = axes.collections
    assert np.allclose(np.ma.filled(mesh.get_array(), np.nan), 1e3 * surface.height_m, equal_nan=True)
    (other,) = surface.plot(layer="sigma").collections
    assert np.allclose(np.ma.filled(other.get_array(), np.nan), 1e3 * surface.sigma_m, equal_nan=True)
    assert axes.get_xlabel() == "u (mm)"
    with pytest.raises(sf.SurfuseError, match="did you mean 'height'"):
        surface.plot(layer="heigt")
    plt.close("all")


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    box = np.array([[-0.2, -0.2, 0.001], [0.2, -0.2, 0.001], [0.2, 0.2, 0.001], [-0.2, 0.2, 0.001]])
    trimesh.Trimesh(box, [[0, 1, 2], [0, 2, 3]], process=False).export(tmp_path / "truth.ply")
    return tmp_path / "truth.ply"


def test_a_score_is_what_evaluate_prints(surface, truth, tmp_path, command):
    path = surface.save(tmp_path / "surface.nc")
    told = command("evaluate", path, "--truth", truth, "--json").json
    for score in (sf.evaluate(surface, truth=truth), sf.evaluate(str(path), truth=str(truth))):
        for name in ("rmse_mm", "mae_mm", "bias_mm", "p95_mm", "coverage", "cells", "within_3mm"):
            assert getattr(score, name) == told[name], name
        assert math.isnan(score.edge_mm)
        assert "edge_mm" not in told


def test_a_map_is_truth_for_another(surface, truth):
    same = sf.evaluate(surface, truth=surface)
    assert same.rmse_mm == same.bias_mm == 0.0
    assert same.coverage == same.within_3mm == 1.0
    shifted = dataclasses.replace(surface.record, height_m=surface.height_m + 0.001)
    assert sf.evaluate(sf.SurfaceMap(shifted), truth=surface).bias_mm == pytest.approx(1.0)
    scaled = sf.evaluate(surface, truth, scale=2.0)
    assert scaled.bias_mm == pytest.approx(sf.evaluate(surface, truth).bias_mm - 1.0, abs=1e-6)


def test_truth_elsewhere_is_refused(surface, tmp_path):
    far = trimesh.creation.box((0.1, 0.1, 0.1), trimesh.transformations.translation_matrix([9, 9, 9]))
    far.export(tmp_path / "far.ply")
    with pytest.raises(sf.SurfuseError, match=r"far\.ply: map and truth have no cell in common; give .* scale=0\.001"):
        sf.evaluate(surface, truth=tmp_path / "far.ply")
    for wrong in (3, None, tmp_path / "nowhere.ply", "nowhere\0.ply"):
        with pytest.raises(sf.SurfuseError):
            sf.evaluate(surface, truth=wrong)
    for scale in (0.0, -1.0, math.nan, "1", None, True):
        with pytest.raises(sf.SurfuseError, match="scale"):
            sf.evaluate(surface, tmp_path / "far.ply", scale=scale)


@pytest.mark.parametrize("wrong", ["0", None, math.nan, math.inf, [0.0], True])
def test_a_place_is_a_finite_number(surface, wrong):
    with pytest.raises(sf.SurfuseError, match="v_mm"):
        surface.why(u_mm=0, v_mm=wrong)
    assert surface.why(np.float32(0.0), np.int64(20)).v_mm == pytest.approx(20.0, abs=10.0)


@pytest.mark.parametrize("layer", [None, 3, ["height"]])
def test_a_layer_is_a_name(surface, layer):
    with pytest.raises(sf.SurfuseError, match="layer"):
        surface.plot(layer=layer)


def test_layers_are_read_only_and_the_map_shows_itself(surface):
    with pytest.raises(ValueError, match="read-only"):
        surface.height_m[0, 0] = 1.0
    rows, columns = surface.height_m.shape
    assert repr(surface).startswith(f"<SurfaceMap by 'mean': {rows} x {columns} nodes, {int(surface.mask.sum())} with")
