"""What users get wrong: one clear line, the exit status of the contract, and nothing on disk damaged."""

from __future__ import annotations

import os

import numpy as np
import pytest
import trimesh

from surfuse.commands.acquire.locating import finder
from surfuse.records import CameraFrame, CameraModel
from surfuse.settings import load

QUICK = ("--method", "weighted_average", "--arm-driver", "kinematic")
QUICK += ("--set", "scene.azimuth_deg=-130", "--set", "scan.step_m=0.04")


@pytest.fixture
def untouched(tmp_path, digests):
    """Files of the user lie beside the output; whatever goes wrong, they stay as they were."""
    (tmp_path / "precious.txt").write_text("years of work")
    before: dict[str, str] = {}

    def remember() -> None:
        before.update(digests(tmp_path))

    yield remember
    before.update({} if before else {"precious.txt": digests(tmp_path)["precious.txt"]})
    after = digests(tmp_path)
    assert {name: after[name] for name in before} == before


@pytest.mark.parametrize(
    ("words", "status", "told"),
    [
        (["aquire"], 2, ["unknown command 'aquire'", "did you mean 'acquire'"]),
        (["acquire", "reliev"], 2, ["unknown scene 'reliev'", "did you mean 'relief'"]),
        (["acquire", "part.dae"], 2, ["unknown scene 'part.dae'", ".stl"]),
        (["acquire", "--method", "weigted_average"], 2, ["did you mean 'weighted_average'"]),
        (["acquire", "--set", "fusion.method=medain"], 2, ["did you mean 'median'"]),
        (["acquire", "--sed", "3"], 2, ["--sed", "--seed"]),
        (["acquire", "--seed", "many"], 2, ["--seed", "integer"]),
        (["acquire", "--seed", "-1"], 3, ["seed = -1", "greater than or equal to 0"]),
        (["acquire", "flat", "tilted"], 2, ["tilted"]),
        (["acquire", "--set", "scan.step_m"], 3, ["key.path=value"]),
        (["acquire", "--set", "scan.stpe_m=0.1"], 3, ["'scan.stpe_m'", "did you mean 'step_m'"]),
        (["acquire", "--set", "scn.step_m=0.1"], 3, ["'scn'", "did you mean 'scan'"]),
        (["acquire", "--set", "scan.step_m=small"], 3, ["scan.step_m = 'small'", "number"]),
        (["acquire", "--set", "scan.step_m='0.1'"], 3, ["scan.step_m = '0.1'", "number"]),
        (["acquire", "--set", "scan.step_m=true"], 3, ["scan.step_m = True", "number"]),
        (["acquire", "--set", "scan.step_m=nan"], 3, ["scan.step_m = nan", "finite"]),
        (["acquire", "--set", "scan.step_m=-1"], 3, ["scan.step_m = -1", "greater than 0"]),
        (["acquire", "--set", "scan.margin_m=3"], 3, ["scan.margin_m = 3", "less than or equal to 0.5"]),
        (["acquire", "--set", "scan=1"], 3, ["scan = 1"]),
        (["acquire", "--set", "seed.x=1"], 3, ["seed"]),
        (["acquire", "--set", "seed=1e3"], 3, ["seed = 1000.0", "integer"]),
        (["acquire", "--set", "scene.up=w"], 3, ["scene.up = 'w'", "'x', 'y' or 'z'"]),
        (["acquire", "--set", "search.threshold=ostu"], 3, ["did you mean 'otsu'"]),
        (["acquire", "--set", "array.sensor=polariod"], 3, ["array.sensor = 'polariod'", "'polaroid'"]),
        (["acquire", "--set", "arm.name=puma650"], 3, ["arm.name = 'puma650'", "'puma560'"]),
        (["acquire", "--set", "fusion.parameters.mean.x=1"], 3, ["fusion.parameters.mean.x"]),
        (["acquire", "--set", "fusion.parameters.maen.x=1"], 3, ["did you mean 'mean'"]),
        (["acquire", "--set", "fusion.parameters.weighted_average.use_dc1=3"], 3, ["use_dc1 = 3", "True"]),
        (["acquire", "--set", "x=" + "[" * 20000], 3, ["nested too deeply"]),
        (["acquire", "--set", ".".join("a" * 20000) + "=1"], 3, ["unknown key 'a'"]),
        (["acquire", "--cell", "missing.toml"], 3, ["missing.toml", "No such file"]),
        (["acquire", "--cell", "."], 3, ["directory"]),
        (["acquire", "missing.stl"], 3, ["missing.stl", "No such file"]),
        (["acquire", "--set", "cell.table_inner_radius_m=1.3"], 3, ["1.3", "1.25"]),
        (["fuse", "missing"], 3, ["missing", "no such file or folder"]),
        (["fuse"], 2, ["Missing argument"]),
        (["compare", "missing"], 3, ["missing"]),
        (["evaluate", "missing", "--truth", "missing.ply"], 6, ["missing"]),
        (["evaluate", "missing"], 2, ["--truth"]),
        (["report", "missing"], 3, ["missing", "no such folder", "give a run folder"]),
        (["resume", "missing"], 3, ["missing", "no such folder"]),
        (["view", "missing"], 6, ["missing"]),
        (["view", "missing", "--port", "99999"], 2, ["--port", "65535"]),
        (["export", "missing", "map.ply"], 6, ["missing"]),
        (["export", "missing", "map.stp"], 2, ["'.stp'", "did you mean '.stl'"]),
        (["export", "missing", "map"], 2, ["map"]),
        (["threshold", "missing.png"], None, ["missing.png"]),
        (["outline", "missing.png", "--scale", "1", "--out", "o.csv"], None, ["missing.png"]),
        (["outline", "missing.png", "--scale", "-1", "--out", "o.csv"], 2, ["--scale"]),
    ],
)
def test_words_that_mean_nothing(command, tmp_path, monkeypatch, untouched, words, status, told):
    monkeypatch.chdir(tmp_path)
    answer = command(*words)
    answer.error(answer.status if status is None else status, *told)
    assert answer.status in (2, 3, 6)
    assert [path.name for path in tmp_path.iterdir()] == ["precious.txt"]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[scan\n", ["line 1"]),
        ("a = 1\na = 2\n", ["not valid TOML"]),
        ("[scan]\nstep = 0.1\n", ["'scan.step'", "did you mean 'step_m'"]),
        ("[scna]\n", ["'scna'", "did you mean 'scan'"]),
        ("[scan]\nstep_m = '10 mm'\n", ["scan.step_m = '10 mm'"]),
        ("[scan]\nstep_m = nan\n", ["scan.step_m = nan"]),
        ("[scan]\nstep_m = 1e400\n", ["scan.step_m = inf"]),
        ("[scan]\nmargin_m = 20\n", ["scan.margin_m = 20", "0.5"]),
        ("[scan]\nstep_m = 2020-01-01\n", ["scan.step_m"]),
        ("[array]\npings = 2.5\n", ["array.pings = 2.5", "integer"]),
        ("[scan]\nstep_m = '" + "9" * 60000 + "'\n", ["scan.step_m = '999"]),
        ("[scan]\n" + "\n".join(f"k{i} = 1" for i in range(5000)), ["'scan.k0' (and 4999 more)"]),
        ("# " + "x" * 70000, ["70002 bytes", "65536"]),
        (".".join("a" * 20000) + " = 1\n", ["line 1", "nested deeper than 16"]),
        ("x = {" + ".".join("a" * 20000) + " = 1}\n", ["line 1", "nested deeper than 16"]),
        ("x = " + "[" * 30000, ["nested too deep"]),
        ("x = " + "[" * 300 + "]" * 300, ["nested deeper than 16"]),
        ("run = 3\n", ["'run'", "seed"]),
        ("[run]\nseed = 1\nformat_version = 99\n", ["format version 99"]),
    ],
)
def test_cell_files_that_cannot_be_used(command, tmp_path, untouched, text, told):
    cell = tmp_path / "cell.toml"
    cell.write_text(text)
    untouched()
    command("acquire", "--cell", cell, "--out", tmp_path / "run").error(3, str(cell), *told)
    assert not (tmp_path / "run").exists()


def test_a_cell_file_that_is_not_text(command, tmp_path):
    cell = tmp_path / "cell.toml"
    cell.write_bytes(b"\xff\xfe\x00")
    command("acquire", "--cell", cell).error(3, "byte 0 is not UTF-8")


def box(width: float = 0.2, depth: float = 0.02, height: float = 0.15) -> trimesh.Trimesh:
    return trimesh.creation.box((width, depth, height))


def of_bytes(content: bytes, length: int | None = None):
    def write(path):
        path.write_bytes(content)
        if length is not None:
            os.truncate(path, length)

    return write


def of_mesh(mesh: trimesh.Trimesh):
    return lambda path: mesh.export(path)


def with_nan() -> trimesh.Trimesh:
    mesh = box()
    mesh.vertices[0] = np.nan
    return mesh


MESHES = [
    ("part.stl", of_bytes(b""), ["empty (0 bytes)"]),
    ("part.stl", of_bytes(b"\x07" * 5000), ["claims", "5000 bytes"]),
    ("part.stl", of_bytes(bytes(80) + b"\xff\xff\xff\xff"), ["claims 4294967295 triangles"]),
    ("part.stl", of_bytes(bytes(84)), ["no triangles"]),
    ("part.stl", of_bytes(b"", 600 * 2**20), ["600 MiB", "512 MiB"]),
    ("part.ply", of_bytes(b"hello"), ["cannot be read"]),
    ("part.ply", of_bytes(b"ply\nformat ascii 1.0\nelement vertex 1000000000000\nend_header\n"), ["1000000000000"]),
    ("part.obj", of_bytes(b"v 0 0 0\nf 1 2 3\n"), ["cannot be read"]),
    ("part.obj", of_bytes(b"v 0 0 0\nv 1 0 0\n"), ["no triangles"]),
    ("part.stl", of_mesh(with_nan()), ["not finite"]),
    ("part.stl", of_mesh(box(200.0, 20.0, 150.0)), ["200 m long", "millimetres", "scale = 0.001"]),
    ("part.stl", of_mesh(box(0.002, 0.001, 0.001)), ["only 2 mm", "5 mm"]),
    ("part.stl", of_mesh(box(width=1.8)), ["1.800 m wide", "1.625"]),
    ("part.stl", of_mesh(box(depth=0.4)), ["off the table", "0.400 m deep"]),
]


@pytest.mark.parametrize(("name", "write", "told"), MESHES, ids=[" ".join(told) for _, _, told in MESHES])
def test_meshes_that_cannot_be_scanned(command, tmp_path, untouched, name, write, told):
    write(tmp_path / name)
    untouched()
    line = command("acquire", tmp_path / name, "--out", tmp_path / "run").error(3, *told)
    assert name in line
    assert not (tmp_path / "run").exists()


def test_a_mesh_in_millimetres_is_scanned_with_the_named_cure(command, tmp_path):
    box(200.0, 20.0, 150.0).export(tmp_path / "part.stl")
    answer = command(
        *("acquire", tmp_path / "part.stl", "--set", "scene.scale=0.001", *QUICK, "--out", tmp_path / "run", "--json")
    )
    assert answer.status == 0
    assert answer.json["rmse_mm"] < 3.0


def test_a_mesh_that_is_not_watertight_is_scanned_with_a_note(command, tmp_path):
    whole = box()
    trimesh.Trimesh(whole.vertices, whole.faces[:-2], process=False).export(tmp_path / "sheet.stl")
    answer = command("acquire", tmp_path / "sheet.stl", *QUICK, "--out", tmp_path / "run")
    assert answer.status == 0
    (note,) = answer.err.splitlines()
    assert note.startswith("surfuse: note: ")
    assert "not watertight" in note


def test_a_mesh_is_found_again_when_resume_starts_in_another_folder(command, tmp_path, monkeypatch):
    box().export(tmp_path / "part.stl")
    monkeypatch.chdir(tmp_path)
    assert command("acquire", "part.stl", *QUICK, "--out", "run", "--json").status == 0
    (tmp_path / "run" / "report.html").unlink()
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert command("resume", "../run", "--json").status == 0


@pytest.mark.parametrize("radius_m", [0.8, 1.3, 2.5])
def test_a_part_beside_the_table(command, tmp_path, radius_m):
    words = ("acquire", "flat", "--set", f"scene.radius_m={radius_m}", "--out", tmp_path / "run")
    command(*words).error(3, "off the table", f"{radius_m:.3f}", "scene.radius_m")


@pytest.mark.parametrize(
    ("standoff_m", "told"),
    [
        (0.1, ["nearer than the 0.200 m of its tube", "a standoff above 0.23"]),
        (2.0, ["not one of", "out of reach"]),
    ],
)
def test_a_part_out_of_reach_is_told_before_the_arm_moves(command, tmp_path, standoff_m, told):
    words = ("acquire", "flat", "--set", f"scan.standoff_m={standoff_m}", *QUICK, "--out", tmp_path / "run")
    command(*words).error(3, "scan.standoff_m", *told)
    assert not (tmp_path / "run" / "surface.nc").exists()


def test_a_part_that_the_camera_does_not_see(command, tmp_path):
    words = ("acquire", "flat", "--set", "camera.height_m=4.0", *QUICK, "--out", tmp_path / "run")
    command(*words).error(3, "no part seen", "-160 to 160 degrees")


def test_a_scan_without_one_echo_says_so_and_keeps_everything(command, tmp_path):
    words = ("acquire", "flat", "--set", "kit.gain=0.001", *QUICK, "--out", tmp_path / "run")
    answer = command(*words)
    *notes, last = answer.err.splitlines()
    assert (answer.status, answer.out) == (3, "")
    assert any("only 0 of 124 readings are echoes" in note for note in notes)
    assert "the scan is complete, but none of its 31 stops gave a value" in last
    assert (tmp_path / "run" / "report.html").is_file()
    assert command("resume", tmp_path / "run", "--quiet").status == 0


@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_picture_of_one_level_shows_no_part(level):
    camera = CameraModel(500, 582, 520.0, 760.0, 249.5, 290.5)
    frame = CameraFrame(np.full((582, 500), level, dtype=np.uint8), 0.0, camera, np.eye(4))
    for name in ("otsu", "maximum_entropy", "uniform_error", "minimum_error"):
        assert finder(load(None, [f"search.threshold={name}"]))(frame) == ()


@pytest.mark.parametrize("level", [0, 255])
def test_a_picture_file_of_one_level_has_no_outline(command, tmp_path, level):
    import cv2

    cv2.imwrite(str(tmp_path / "plain.png"), np.full((60, 80), level, dtype=np.uint8))
    answer = command("outline", tmp_path / "plain.png", "--scale", "1", "--out", tmp_path / "o.csv")
    answer.error(3, "plain.png")
    assert not (tmp_path / "o.csv").exists()


def test_a_file_that_is_no_picture(command, tmp_path):
    (tmp_path / "noise.png").write_bytes(b"\x00\x01\x02" * 100)
    command("threshold", tmp_path / "noise.png").error(3, "noise.png")


OUTPUT = [
    (["acquire", "flat", *QUICK], "--out"),
    (["fuse", "RUN"], "--out"),
    (["compare", "RUN"], "--out"),
    (["reproduce"], "--out"),
]


@pytest.mark.parametrize(("words", "option"), OUTPUT, ids=[words[0] for words, _ in OUTPUT])
def test_an_output_folder_that_cannot_be_used(command, tmp_path, flat_run, untouched, words, option):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("years of work")
    untouched()
    words = [str(flat_run) if word == "RUN" else word for word in words]
    command(*words, option, tmp_path / "full").error(6, "full", "not empty", "--out")
    command(*words, option, tmp_path / "precious.txt").error(6, "precious.txt", "file")
    command(*words, option, tmp_path / "precious.txt" / "run").error(6, "precious.txt", "folder")
    command(*words, option, "/proc/surfuse-run").error(6, "/proc/surfuse-run")


def test_an_output_file_that_cannot_be_written(command, tmp_path, flat_run, untouched):
    (tmp_path / "folder.ply").mkdir()
    untouched()
    command("export", flat_run, tmp_path / "folder.ply").error(6, "folder.ply", "folder")
    command("export", flat_run, tmp_path / "none" / "map.ply").error(6, "map.ply", "folder")
    command("export", flat_run, tmp_path / "precious.txt" / "map.ply").error(6, "map.ply")
    command("report", flat_run, "--file", tmp_path / "none" / "page.html").error(6, "page.html")


def test_maps_that_are_none(command, tmp_path, flat_run):
    whole = (flat_run / "surface.nc").read_bytes()
    (tmp_path / "cut.nc").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.nc").write_text("hello")
    for name in ("cut.nc", "text.nc"):
        command("evaluate", tmp_path / name, "--truth", flat_run).error(3, name)
        command("export", tmp_path / name, tmp_path / "out.ply").error(3, name)
        assert not (tmp_path / "out.ply").exists()
    command("evaluate", flat_run, "--truth", tmp_path / "text.nc").error(3, "text.nc")
    command("evaluate", flat_run, "--truth", flat_run / "run.toml").error(3, "run.toml", "a .toml holds no map")


def test_truth_that_is_elsewhere_is_no_score(command, tmp_path, flat_run):
    mesh = trimesh.load_mesh(flat_run / "truth.ply")
    mesh.apply_scale(1000.0).export(tmp_path / "mm.ply")
    command("evaluate", flat_run, "--truth", tmp_path / "mm.ply").error(3, "steps of the map", "--scale")
    mesh = trimesh.load_mesh(flat_run / "truth.ply")
    mesh.apply_translation([0.0, 0.0, 1.0]).export(tmp_path / "above.ply")
    command("evaluate", flat_run, "--truth", tmp_path / "above.ply").error(3, "above.ply", "no cell in common")


def test_a_folder_that_is_no_run(command, tmp_path):
    (tmp_path / "notes").mkdir()
    command("resume", tmp_path / "notes").error(3, "not a run folder", "run.toml")
    command("fuse", tmp_path / "notes").error(3, "no log segment")
    command("evaluate", tmp_path / "notes", "--truth", tmp_path / "notes").error(3, "surface.nc")


def test_a_fused_run_cannot_be_resumed(command, tmp_path, flat_run):
    assert command("fuse", flat_run, "--out", tmp_path / "fused", "--quiet").status == 0
    command("resume", tmp_path / "fused").error(3, "fused from a log")
