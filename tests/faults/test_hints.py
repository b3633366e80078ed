"""Wrong words on the command line: the hint names what was given, what is valid, and leads to the right place."""

from __future__ import annotations

import pytest

from surfuse.errors import nearest


@pytest.fixture
def places(tmp_path, plate_log):
    """Things that are not what a command wants."""
    (tmp_path / "folder").mkdir()
    for name in ("empty.csv", "empty.mcap", "empty.nc", "empty.toml", "empty.stl", "empty.png"):
        (tmp_path / name).touch()
    for name in ("text.csv", "text.mcap", "text.nc", "text.ply", "text.png"):
        (tmp_path / name).write_text("hello\n")
    return {"LOG": plate_log, **{path.name: path for path in tmp_path.iterdir()}}


@pytest.fixture(scope="module")
def plate_log(flat_run):
    """A run that is all right, and is never written to."""
    return flat_run


@pytest.mark.parametrize(
    ("line", "status", "told"),
    [
        ("fuse missing.csv", 3, ["missing.csv: there is no such file;", "a .csv file"]),
        ("fuse missing", 3, ["no such file or folder", ".csv"]),
        ("fuse folder", 3, ["no log segment", ".csv"]),
        ("fuse empty.csv", 3, ["the file is empty", "range_m"]),
        ("fuse empty.mcap", 3, ["nothing in it can be read as an MCAP log"]),
        ("fuse text.mcap", 3, ["nothing in it can be read as an MCAP log"]),
        ("fuse text.nc", 3, ["'.nc' is no kind of log"]),
        ("fuse LOG --sensors folder", 3, ["it is a folder"]),
        ("fuse LOG --frame text.csv", 3, ["not valid TOML"]),
        ("fuse LOG --method banana", 2, ["'banana'", "valid: "]),
        ("fuse LOG --seed 1e3", 2, ["--seed", "integer", "given: '1e3'", "surfuse fuse --help"]),
        ("fuse LOG --set fusion.parameters.mean.x=nan", 3, ["fusion.parameters.mean.x = nan", "finite number"]),
        ("fuse LOG --set fusion.parameters.mean.x=[1]", 3, ["fusion.parameters.mean.x = [1]", "a text"]),
        ("fuse LOG --set fusion=3", 3, ["fusion = 3", "table", "fusion.KEY=VALUE"]),
        ("compare LOG --truth missing.ply", 6, ["give a mesh, a map file"]),
        ("compare LOG --truth text.png", 3, ["no map that can be read back"]),
        ("compare LOG --truth text.ply", 3, ["cannot be read"]),
        ("evaluate text.nc --truth LOG", 3, ["not a map of ours"]),
        ("evaluate LOG --truth empty.stl", 3, ["is empty"]),
        ("evaluate LOG --truth LOG --truth-frame moon", 2, ["'moon' is not one of 'auto', 'world', 'part'"]),
        ("evaluate LOG --truth LOG --scale -1", 2, ["--scale", "given: '-1'"]),
        ("evaluate LOG --truth LOG --scale nan", 2, ["--scale", "given: 'nan'"]),
        ("report missing", 3, ["there is no such folder"]),
        ("report text.nc", 3, ["it is a file", "surfuse view"]),
        ("report folder", 3, ["holds no surface.nc", "give a run folder"]),
        ("why LOG a b", 2, ["'U'", "surfuse why --help"]),
        ("why LOG nan 0", 2, ["u = nan mm"]),
        ("sync missing.csv", 3, [".csv"]),
        ("coverage missing --truth LOG", 3, ["no such file"]),
        ("calibrat", 2, ["did you mean 'calibrate'"]),
        ("banana", 2, ["valid: accept", "calibrate"]),
        ("calibrate banana", 2, ["'calibrate banana'", "camera, hand-eye, pictures, sensor, shoulder"]),
        ("calibrate sensr", 2, ["did you mean 'sensor'"]),
        ("calibrate camera", 2, ["surfuse calibrate camera --help"]),
        ("calibrate shoulder missing.csv --corner 0,0,0 --out x.toml", 3, ["(No such file or directory)"]),
        ("calibrate sensor missing.csv --out x.toml", 3, ["there is no such file", ".csv"]),
        ("acquire --set camera.fx=3", 3, ["did you mean 'fx_px'"]),
        ("acquire --set camera.distortion=[1,2]", 3, ["camera.distortion = [1, 2]", "number of values"]),
        ("acquire --arm missing.xml", 3, ["missing.xml", "no such file"]),
        ("acquire --arm folder", 3, ["it is a folder"]),
        ("acquire FLAT", 2, ["did you mean 'flat'"]),
        ("acquire --sead 3", 2, ["--seed"]),
        ("acquire --cell folder", 3, ["directory"]),
        ("methods banana", 2, ["(banana)", "surfuse methods --help"]),
        ("threshold text.png", 3, ["not a picture"]),
        ("outline empty.png --scale nan --out o.csv", 2, ["--scale"]),
        ("accept missing.toml", 3, ["no such file"]),
        ("node missing.toml", 3, ["no such file"]),
    ],
)
def test_the_hint_is_the_right_one(command, places, monkeypatch, tmp_path, line, status, told):
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    text = command(*[places.get(word, word) for word in line.split()]).error(status, *told)
    assert "internal error" not in text
    assert "Traceback" not in text
    assert sorted(tmp_path.rglob("*")) == before


def test_a_group_alone_shows_its_help(command):
    answer = command("calibrate")
    assert answer.status == 0
    assert "shoulder" in answer.out


@pytest.mark.parametrize(
    ("name", "close"),
    [("fx", "fx_px"), ("fy", "fy_px"), ("fx_px_", "fx_px"), ("FX_PX", "fx_px"), ("heigth", "height_px"), ("zzz", None)],
)
def test_a_name_that_begins_alike_is_nearest(name, close):
    told = nearest(name, ["fx_px", "fy_px", "height_px", "width_px"])
    assert told.startswith(f"did you mean '{close}'?") if close else told.startswith("valid: ")


def test_a_run_that_never_moved_is_not_said_to_hold_readings(command, tmp_path):
    how = ("--arm-driver", "kinematic", "--set", "arm.clearance_m=0.4", "--out", tmp_path / "run")
    line = command("acquire", "flat", *how).error(5, "surfuse resume")
    assert "what was scanned" not in line
