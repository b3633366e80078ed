"""No option is ignored: one that a command can do nothing with in a case is refused with the reason."""

from __future__ import annotations

import pytest


@pytest.mark.parametrize(
    ("words", "status", "told"),
    [
        (["fuse", "LOG", "--set", "scan.step_m=0.02"], 3, ["scan.step_m", "'surfuse fuse' does not use it"]),
        (["compare", "LOG", "--set", "kit.gain=2.0"], 3, ["kit.gain", "'surfuse compare' does not use it"]),
        (["compare", "LOG", "--set", "fusion.method=mean"], 3, ["fusion.method", "every method"]),
        (["coverage", "LOG", "--truth", "TRUTH", "--set", "array.side_m=0.1"], 3, ["array.side_m"]),
        (["accept", "polaroid", "--log", "LOG", "--distances", "0.43", "--seed", "3"], 2, ["--seed with --log"]),
        (["sensor-sheet", "polaroid", "--log", "LOG", "--truth", "TRUTH", "--seed", "0"], 2, ["--seed with --log"]),
        (["node", "--bus", "slcan", "--port", "43000"], 2, ["--port", "'slcan'"]),
        (["node", "NODE", "--tether-port", "43000"], 2, ["--tether-port"]),
    ],
)
def test_an_option_without_an_effect_is_refused(command, plate, words, status, told):
    log = plate()
    node = log.with_name("node.toml")
    node.write_text('[[sensor]]\nplugin = "tfmini"\nport = "COM9"\nmodel = "tfmini"\n')
    places = {"LOG": log, "TRUTH": log.with_name("truth.ply"), "NODE": node}
    command(*[places.get(word, word) for word in words]).error(status, *told)


@pytest.mark.parametrize(
    ("against", "told"),
    [
        ("mean", ["that is the method of the map"]),
        ("maen", ["did you mean 'mean'"]),
        ("median", ["readings", "not there"]),
    ],
)
def test_a_method_that_cannot_be_shown_beside_the_map_is_said(command, plate, tmp_path, against, told):
    log, run = plate(), tmp_path / "run"
    assert command("fuse", log, "--method", "mean", "--out", run, "--quiet").status == 0
    if against == "median":
        log.unlink()
    answer = command("report", run, "--against", against, "--force")
    answer.error(2 if against == "maen" else 3, *told)
