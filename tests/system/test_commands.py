"""The commands as a user calls them: what they print, write and answer when all is well."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import trimesh

from surfuse import __version__, cli, registry
from surfuse.exporters import nc

QUICKEST = ("--set", "scan.step_m=0.05", "--set", "arm.driver=kinematic")
SCORE = ("rmse_mm", "mae_mm", "bias_mm", "p95_mm", "coverage", "cells")


@pytest.fixture(scope="module")
def fused(tmp_path_factory, command, flat_run) -> Path:
    folder = tmp_path_factory.mktemp("fused") / "median"
    assert command("fuse", flat_run, "--method", "median", "--out", folder, "--json").status == 0
    return folder


@pytest.fixture
def own(tmp_path, flat_run) -> Path:
    """A copy of a complete run that the test may change."""
    return Path(shutil.copytree(flat_run, tmp_path / "own"))


def test_a_run_folder_holds_what_is_promised(flat_run):
    names = {path.name for path in flat_run.iterdir() if not path.name.startswith(".")}
    assert names == {"log", "surface.nc", "report.html", "run.toml", "summary.json", "truth.ply"}
    assert {path.name for path in (flat_run / "log").iterdir()} == {"000.mcap", "metadata.yaml"}


def test_the_configuration_of_a_run_is_whole(flat_run):
    tables = tomllib.loads((flat_run / "run.toml").read_text("utf-8"))
    assert tables["run"]["surfuse"] == __version__
    assert tables["run"]["seed"] == 1
    assert tables["run"]["packages"]["numpy"] == np.__version__
    assert tables["scan"] == {"standoff_m": 0.43, "step_m": 0.04, "mode": "stops", "pings": 1}
    assert tables["scene"]["name"] == "flat"


def test_the_summary_of_a_run_is_strict_json(flat_run):
    data = json.loads((flat_run / "summary.json").read_text("utf-8"), parse_constant=lambda name: pytest.fail(name))
    assert data["complete"] is True
    assert data["stops"] == data["stops_planned"] == 32
    assert data["rmse_mm"] < 2.0


def test_json_of_acquire_is_all_that_is_printed(command, tmp_path):
    answer = command("acquire", "flat", *QUICKEST, "--out", tmp_path / "run", "--json")
    assert (answer.status, answer.err) == (0, "")
    assert {"run", "report", "wall_time_s", "robot_time_s", "stops", "gaps", *SCORE} <= answer.json.keys()


def test_the_closing_table_names_error_coverage_stops_gaps_times_and_report(command, tmp_path):
    answer = command("acquire", "flat", *QUICKEST, "--out", tmp_path / "run")
    assert answer.status == 0
    labels = [re.split(r"  +", line)[0] for line in answer.out.splitlines()]
    assert {"RMSE", "coverage", "stops", "gaps", "robot time", "wall time", "report"} <= set(labels)
    assert str(tmp_path / "run" / "report.html") in answer.out


def test_quiet_prints_nothing(command, tmp_path):
    answer = command("acquire", "relief", *QUICKEST, "--out", tmp_path / "run", "--quiet")
    assert (answer.status, answer.out, answer.err) == (0, "", "")


def test_without_out_the_run_gets_a_folder_of_its_own(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = Path(command("acquire", "flat", *QUICKEST, "--json").json["run"])
    assert re.fullmatch(r"runs/flat-\d{8}-\d{6}", str(folder))
    assert (tmp_path / folder / "report.html").is_file()


def test_the_cell_file_of_a_run_repeats_it_to_the_last_bit(command, tmp_path, flat_run, map_bits):
    answer = command("acquire", "--cell", flat_run / "run.toml", "--out", tmp_path / "again", "--json")
    assert answer.status == 0
    assert map_bits(tmp_path / "again") == map_bits(flat_run)


def test_another_seed_gives_another_map(command, tmp_path, flat_run, map_bits):
    command("acquire", "--cell", flat_run / "run.toml", "--seed", "2", "--out", tmp_path / "two", "--json")
    one, two = map_bits(flat_run), map_bits(tmp_path / "two")
    assert one["SurfaceMap.height_m"] != two["SurfaceMap.height_m"]


def test_options_win_over_the_cell_file_and_set_over_its_values(command, tmp_path):
    cell = tmp_path / "cell.toml"
    cell.write_text('seed = 5\n[scene]\nname = "relief"\n[scan]\nstep_m = 0.02\nmargin_m = 0.03\n')
    answer = command(
        *("acquire", "flat", "--cell", cell, *QUICKEST, "--seed", "9", "--method", "mean", "--out", tmp_path / "r"),
        "--json",
    )
    assert (answer.json["scene"], answer.json["seed"], answer.json["method"]) == ("flat", 9, "mean")
    scan = tomllib.loads((tmp_path / "r" / "run.toml").read_text())["scan"]
    assert (scan["step_m"], scan["margin_m"]) == (0.05, 0.03)


def test_live_and_replayed_fusion_give_identical_bits(command, tmp_path, flat_run, map_bits):
    answer = command("fuse", flat_run, "--method", "weighted_average", "--out", tmp_path / "again", "--json")
    assert answer.status == 0
    assert map_bits(tmp_path / "again") == map_bits(flat_run)


def test_so_does_the_default_method(command, tmp_path, map_bits):
    answer = command("acquire", "flat", *QUICKEST, "--out", tmp_path / "live", "--json")
    assert (answer.status, answer.json["method"]) == (0, "beam")
    command("fuse", tmp_path / "live", "--out", tmp_path / "again", "--quiet")
    assert map_bits(tmp_path / "again") == map_bits(tmp_path / "live")


def test_a_log_alone_is_as_good_as_its_run_folder(command, tmp_path, flat_run, map_bits):
    log = flat_run / "log" / "000.mcap"
    command("fuse", log, "--method", "weighted_average", "--out", tmp_path / "again", "--json")
    assert map_bits(tmp_path / "again") == map_bits(flat_run)


def test_another_method_gives_another_map_of_the_same_readings(fused, flat_run, map_bits):
    assert map_bits(fused)["SurfaceMap.height_m"] != map_bits(flat_run)["SurfaceMap.height_m"]
    assert nc.read(fused / "surface.nc").method == "median"


def test_a_fused_run_names_its_log(fused, flat_run):
    tables = tomllib.loads((fused / "run.toml").read_text("utf-8"))
    assert tables["source"]["log"] == str(flat_run)
    assert {path.name for path in fused.iterdir() if path.name[0] != "."} == {
        "surface.nc",
        "report.html",
        "run.toml",
        "summary.json",
    }


def test_parameters_of_a_method_take_effect(command, tmp_path, flat_run, map_bits):
    off = ("--set", "fusion.parameters.weighted_average.use_dc3=false")
    command("fuse", flat_run, "--method", "weighted_average", *off, "--out", tmp_path / "off", "--json")
    assert map_bits(tmp_path / "off")["FusedPoints.dc"] != map_bits(flat_run)["FusedPoints.dc"]


def test_a_complete_run_is_left_as_it_is(command, own, digests):
    before = digests(own)
    answer = command("resume", own)
    assert answer.status == 0
    assert "the run is complete" in answer.out
    assert command("resume", own, "--json").json["complete"] is True
    assert digests(own) == before


def test_resume_writes_what_a_complete_scan_lacks(command, own, map_bits):
    before = map_bits(own)
    (own / "report.html").unlink()
    (own / "surface.nc").unlink()
    assert command("resume", own, "--json").status == 0
    assert map_bits(own) == before
    assert (own / "report.html").is_file()


def test_evaluate_against_mesh_map_and_run(command, flat_run, fused):
    by_mesh = command("evaluate", flat_run, "--truth", flat_run / "truth.ply", "--json").json
    summary = json.loads((flat_run / "summary.json").read_text())
    assert {key: by_mesh[key] for key in SCORE} == pytest.approx({key: summary[key] for key in SCORE}, rel=1e-3)
    itself = command("evaluate", flat_run / "surface.nc", "--truth", flat_run, "--json").json
    assert (itself["rmse_mm"], itself["coverage"]) == (0.0, 1.0)
    assert command("evaluate", fused, "--truth", flat_run, "--json").json["rmse_mm"] > 0.0


def test_evaluate_scales_a_mesh_in_millimetres(command, flat_run, tmp_path):
    mesh = trimesh.load_mesh(flat_run / "truth.ply")
    mesh.apply_scale(1000.0).export(tmp_path / "mm.ply")
    metres = command("evaluate", flat_run, "--truth", flat_run / "truth.ply", "--json").json
    scaled = command("evaluate", flat_run, "--truth", tmp_path / "mm.ply", "--scale", "0.001", "--json").json
    assert scaled["rmse_mm"] == pytest.approx(metres["rmse_mm"], rel=1e-4)


def test_compare_scores_every_method(command, flat_run, tmp_path):
    answer = command("compare", flat_run, "--truth", flat_run / "truth.ply", "--out", tmp_path / "maps", "--json")
    assert answer.status == 0
    methods = answer.json["methods"]
    assert set(methods) == set(registry.names("fusion"))
    for name, entry in methods.items():
        assert ("error" in entry) != ("rmse_mm" in entry)
        assert ("error" in entry) != (tmp_path / "maps" / f"{name}.nc").is_file()
    assert methods["weighted_average"]["rmse_mm"] < 2.0


@pytest.mark.parametrize("suffix", ["ply", "stl", "obj", "glb", "csv", "nc", "png"])
def test_export_by_suffix_and_never_over_a_file(command, flat_run, tmp_path, suffix):
    target = tmp_path / f"map.{suffix}"
    assert command("export", flat_run, target, "--json").json["bytes"] == target.stat().st_size > 100
    target.write_bytes(b"precious")
    command("export", flat_run, target).error(6, "exists", "--force")
    assert target.read_bytes() == b"precious"
    assert command("export", flat_run, target, "--force", "--quiet").out == ""
    assert target.stat().st_size > 100


def test_exported_maps_come_back_as_they_were(command, flat_run, tmp_path):
    command("export", flat_run, tmp_path / "map.csv")
    command("export", flat_run, tmp_path / "map.nc")
    for name in ("map.csv", "map.nc"):
        answer = command("evaluate", tmp_path / name, "--truth", flat_run, "--json").json
        assert answer["rmse_mm"] == pytest.approx(0.0, abs=1e-6)


def test_report_is_never_written_over_unless_asked(command, own):
    (own / "report.html").write_text("precious")
    command("report", own).error(6, "report.html", "exists", "--force")
    assert (own / "report.html").read_text() == "precious"
    assert command("report", own, "--file", own / "other.html", "--quiet").status == 0
    assert command("report", own, "--force", "--json").json["report"] == str(own / "report.html")
    assert (own / "report.html").stat().st_size > 10_000


def test_reports_load_nothing_from_elsewhere(flat_run, fused):
    for run in (flat_run, fused):
        page = (run / "report.html").read_text("utf-8")
        assert len(page) < 2_500_000
        loads = re.findall(r"""(?:src|href|action|data)\s*=\s*["']?\s*((?:https?:)?//[^"'\s>]+)""", page)
        loads += re.findall(r"""(?:url\(|@import)\s*["']?\s*((?:https?:)?//[^"')\s]+)""", page)
        assert loads == []


def test_methods_are_those_of_the_registry(command):
    assert set(command("methods", "--json").json["methods"]) == set(registry.names("fusion"))
    assert "weighted_average" in command("methods").out


def test_doctor_finds_all_well_in_the_simulated_cell(command):
    data = command("doctor", "--json", *QUICKEST).json
    assert data["problems"] == []
    assert data["checks"]["reach"]["good"]


def test_doctor_names_what_is_wrong(command):
    answer = command("doctor", "--json", "--set", "scan.standoff_m=2.0", *QUICKEST)
    assert answer.status == 3
    assert "cell" in answer.json["problems"]
    assert "can be visited" in answer.json["checks"]["cell"]["text"]


def test_version_and_help(command):
    assert command("--version").out == f"surfuse {__version__}\n"
    for words in (("--help",), ("-h",), ()):
        answer = command(*words)
        assert answer.status == 0
        assert "acquire" in answer.out
        assert "no safety function" in answer.out


def every_command() -> list[str]:
    cli._register()
    return sorted(entry.name for entry in cli.app.registered_commands if entry.name)


@pytest.mark.parametrize("name", every_command())
def test_every_command_has_help(command, name):
    answer = command(name, "--help")
    assert (answer.status, answer.err) == (0, "")
    assert f"surfuse {name}" in answer.out
    if name not in ("doctor", "methods", "devices"):
        assert "Example" in answer.out


@pytest.mark.parametrize("name", ["acquire", "fuse", "compare", "reproduce", "resume"])
def test_common_options_are_offered(command, name):
    page = command(name, "--help").out
    assert "--json" in page
    assert "--quiet" in page
    if name != "resume":
        assert "--out" in page
        assert "--set" in page


def test_debug_shows_the_traceback_and_keeps_the_status(command, tmp_path):
    answer = command("acquire", "--debug", "reliev")
    assert answer.status == 2
    assert "Traceback" in answer.err
    assert answer.err.splitlines()[-1].startswith("surfuse: unknown scene 'reliev'")


def test_paths_with_spaces_and_letters_of_other_tongues(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box((0.2, 0.02, 0.15)).export(tmp_path / "Pièce à usiner 日本 😀.stl")
    out = tmp_path / "Läufe und so" / "eins"
    assert command("acquire", "Pièce à usiner 日本 😀.stl", *QUICKEST, "--out", out, "--json").status == 0
    assert command("report", out, "--force").status == 0
    assert command("export", out, tmp_path / "kärtchen 1.ply").status == 0


def test_the_console_script_of_the_installed_package():
    script = Path(sys.executable).with_name("surfuse")
    done = subprocess.run([script, "acquire", "reliev"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert "did you mean 'relief'" in done.stderr


def test_a_reader_that_stops_reading_is_no_error():
    script = Path(sys.executable).with_name("surfuse")
    done = subprocess.run(
        ["bash", "-c", f'set -o pipefail; "{script}" methods --json | true'],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_a_full_disk_behind_stdout_is_a_storage_error():
    script = Path(sys.executable).with_name("surfuse")
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([script, "methods"], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 6
    assert done.stderr.count("\n") == 1
