"""The map while the scan runs: right where the scan was, silent elsewhere, and without influence on the end."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from surfuse.fusion import beam
from surfuse.interfaces import LiveMapping
from surfuse.records import Sweep

_SPEC = importlib.util.spec_from_file_location("beam_scans", Path(__file__).with_name("test_beam.py"))
assert _SPEC is not None
assert _SPEC.loader is not None
scans = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(scans)


def watched(case, every=1):
    """Previews after each sweep, and the result at the end."""
    scene, readings, grid = case
    method = beam.create(beam.Parameters())
    assert isinstance(method, LiveMapping)
    state, seen = method.start(scene), []
    for j in range(readings.n_sweeps):
        method.step(state, readings.sweep(j))
        if j % every == every - 1:
            seen.append(method.preview(state, grid))
    return seen, method.finish(state, grid)


@pytest.mark.parametrize(
    ("distance", "truth", "allowed_mm"),
    [
        (scans.to_plane(0.0), lambda u, _: 0.0 * u, 0.5),
        (scans.to_plane(6.0), lambda u, _: u * np.tan(np.radians(6.0)), 1.0),
    ],
)
def test_the_preview_follows_the_surface(distance, truth, allowed_mm):
    case = scans.scan(distance, reach=3)
    seen, _ = watched(case, every=7)
    last = seen[-1]
    u, v = np.meshgrid(case[2].u_m, case[2].v_m)
    middle = last.mask & (np.abs(u) < 0.05) & (np.abs(v) < 0.05)
    assert np.count_nonzero(middle) > 60
    assert np.median(np.abs(last.height_m - truth(u, v))[middle]) * 1e3 < allowed_mm
    assert np.all(last.sigma_m[last.mask] > 0.0)


def test_what_was_not_reached_has_no_value_and_what_was_keeps_it():
    case = scans.scan(scans.to_plane(0.0), reach=4)
    seen, _ = watched(case, every=9)
    _, v = np.meshgrid(case[2].u_m, case[2].v_m)
    assert not np.any(seen[0].mask[v > 0.045])
    counts = [int(one.mask.sum()) for one in seen]
    assert counts == sorted(counts)
    assert counts[-1] > counts[0]


def test_the_final_map_does_not_depend_on_the_previews():
    scene, readings, grid = scans.scan(scans.to_step(0.03, 0.04), reach=3)
    _, result = watched((scene, readings, grid), every=5)
    wanted = beam.create(beam.Parameters()).replay(scene, readings, grid).surface
    for name in ("height_m", "sigma_m", "regime", "alternative_height_m"):
        assert getattr(result.surface, name).tobytes() == getattr(wanted, name).tobytes()


def test_a_late_first_look_takes_all_sweeps_at_once():
    case = scans.scan(scans.to_plane(0.0), reach=3)
    seen, _ = watched(case, every=case[1].n_sweeps)
    assert len(seen) == 1
    assert np.count_nonzero(seen[0].mask) > 100


def test_sweeps_without_an_echo_and_the_first_ones_leave_the_map_empty():
    scene, readings, grid = scans.scan(scans.to_plane(0.0), reach=1)
    method = beam.create(beam.Parameters())
    state = method.start(scene)
    sweep = readings.sweep(0)
    fields = {name: getattr(sweep, name) for name in Sweep.__dataclass_fields__}
    silent = Sweep(**{**fields, "range_m": np.full(4, np.inf), "status": np.ones(4)})
    method.step(state, silent)
    assert not method.preview(state, grid).mask.any()
    method.step(state, sweep)
    assert not method.preview(state, grid).mask.any()
