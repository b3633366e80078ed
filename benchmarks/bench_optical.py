"""Maps of time-of-flight zones, alone and beside ultrasonic sensors: errors, and whether sigma holds.

    OMP_NUM_THREADS=1 python benchmarks/bench_optical.py [--real FOLDER] [--made] [--seeds 1 2]

`--made`: scenes by the independent makers (`judged_optics` for sound, `judged_light` for light), each with sound alone,
light alone, and both. `--real`: a folder with `vl53l5cx_vicon` (with the lag that `sync` finds) and `tmf8820_arm`
(zone directions and offset from the data); recordings that are not there are left out.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from judged_light import Chip, light_log, towards
from judged_scenes import JudgedScene, ball, plane, waves

from surfuse.commands.calibrate.sync import sync
from surfuse.commands.fuse.map_of_log import fused, grid_of
from surfuse.commands.fuse.methods import create_method
from surfuse.commands.outcome import SilentWatcher
from surfuse.geometry.poses import pose, rotation_about
from surfuse.records import Readings, Regime, SensorSpec, SurfaceMap
from surfuse.runs.scan_log import ScanLog
from surfuse.runs.tof_vicon import read_tof_vicon
from surfuse.settings import load
from surfuse.surface.casting import RayCaster
from surfuse.surface.score import error_map
from surfuse.surface.time_lag import moved_poses
from surfuse.surface.truth import truth_around

Z = {50: 0.6745, 90: 1.6449, 99: 2.5758}


def tilted_box(tilt_deg: float, high_m: float) -> JudgedScene:
    """A box on a tilted plate, its top parallel to the plate."""
    slope = np.tan(np.radians(tilt_deg))
    inside = lambda u, v: (np.abs(u - 0.005) < 0.045) & (np.abs(v + 0.005) < 0.05)  # noqa: E731
    return JudgedScene(f"box {tilt_deg:g} deg", "other", lambda u, v: slope * u + np.where(inside(u, v), high_m, 0.0))


SCENES = (
    JudgedScene("plate", "facing", plane(0.0)),
    JudgedScene("plate 20 deg", "tilted", plane(20.0), (0.094, 0.1)),
    tilted_box(0.0, 0.05),
    tilted_box(18.0, 0.05),
    JudgedScene("waves", "curved", waves(0.008, 0.12)),
    JudgedScene("sphere", "curved", ball(0.3)),
)


def shares(surface: SurfaceMap, error: np.ndarray) -> str:
    """Root mean square error, bias, median sigma (mm), cells within the intervals (per cent), regimes."""
    ok = np.isfinite(error)
    e, sigma = error[ok], surface.sigma_m[ok]
    held = ", ".join(f"{k} %: {100 * np.mean(np.abs(e) <= z * sigma):.1f}" for k, z in Z.items())
    kinds = {Regime(k).name.lower(): round(float(np.mean(surface.regime[ok] == k)), 2)
             for k in np.unique(surface.regime[ok])}  # fmt: skip
    return (f"rms {1e3 * np.sqrt(np.mean(e**2)):.2f} bias {1e3 * np.mean(e):+.2f} sigma "
            f"{1e3 * np.median(sigma):.2f} mm; {held}; {len(e)} cells {kinds}")  # fmt: skip


def map_of(log: ScanLog) -> SurfaceMap:
    """The map as `fuse` makes it."""
    return fused(log, create_method(load(None, ()).fusion, "beam"), grid_of(log))[1]


def made(seeds: list[int], only: str) -> None:
    """Every scene with sound, light, both."""
    worst = []
    for scene in SCENES:
        if only not in scene.name:
            continue
        mesh = scene.mesh()
        for seed in seeds:
            rms = {}
            for name, sound, light in (("sound", True, False), ("light", False, True), ("both", True, True)):
                log = light_log(scene, Chip(), seed, sound=sound, light=light)
                began = time.perf_counter()
                surface = map_of(log)
                error = error_map(surface, truth_around(*mesh, surface.grid))
                rms[name] = float(np.sqrt(np.nanmean(error**2)))
                print(f"{scene.name:12s} {seed} {name:5s} {shares(surface, error)} {time.perf_counter() - began:.1f} s",
                      flush=True)  # fmt: skip
            worst.append((rms["both"] / min(rms["sound"], rms["light"]), scene.name, seed))
    print("both over the better alone:", *(f"{r:.3f} {n} {s};" for r, n, s in worst))


def vicon(folder: Path) -> None:
    """The flat target by motion capture, with the lag that `sync` finds."""
    for one in sorted(folder.iterdir()):
        recording = read_tof_vicon(one)
        lag_s = 1e-3 * sync(one, None, 300.0, SilentWatcher()).summary["lag_ms"]
        readings = recording.scan.readings
        place, axis = moved_poses(readings, lag_s)
        log = replace(recording.scan, readings=replace(readings, position_m=place, axis=axis))
        began = time.perf_counter()
        surface = map_of(log)
        truth = truth_around(*recording.target_mesh(), surface.grid)
        text = shares(surface, error_map(surface, truth))
        print(f"vicon {one.name} lag {1e3 * lag_s:.0f} ms: {text} {time.perf_counter() - began:.1f} s", flush=True)


def tmf_log(path: Path, sigma_m: float, offset_m: float) -> ScanLog:
    """The first distances of the nine zones: perpendicular to the chip, the matrix turned as the data say."""
    frames = json.loads(path.read_text())
    chip = np.array([one["pose"] for one in frames], dtype=np.float64)
    chip[:, 3] = [0.0, 0.0, 0.0, 1.0]
    first = 1e-3 * np.array([one["distances"][0]["depths_1"] for one in frames], dtype=np.float64)
    t = towards(3, np.radians(33.0))
    t = np.column_stack([-t[:, 1], -t[:, 0], t[:, 2]])
    range_m = np.where(first > 0.0, first / t[:, 2] - offset_m, np.inf)
    m = len(chip)
    axis = np.einsum("mij,zj->mzi", chip[:, :3, :3], t)
    specs = tuple(SensorSpec(f"zone{k}", "tof", 0.01, 2.0, np.radians(11.0), sigma_m) for k in range(9))
    readings = Readings(
        specs=specs, t_s=np.arange(9 * m) * 0.1, sensor=np.tile(np.arange(9), m),
        position_m=np.repeat(chip[:, :3, 3], 9, axis=0), axis=axis.reshape(-1, 3), range_m=range_m.ravel(),
        status=np.where(np.isfinite(range_m.ravel()), 0, 1), amplitude=np.full(9 * m, np.nan),
        sigma_m=np.full(9 * m, np.nan), count=np.ones(9 * m, dtype=np.int64), start=np.arange(m + 1) * 9,
        stop=np.arange(m), row=np.zeros(m, dtype=np.int64), world_from_grip=chip,
    )  # fmt: skip
    frame = pose(rotation_about([0.0, 0.0, 1.0], 0.0), [0.0146, -0.5422, 0.0])
    return ScanLog(readings, frame, False, None)


def tmf(folder: Path) -> None:
    """Two objects on a cloth: median offset of the zones taken out, or not."""
    for name, mesh in (("pyramid", "pyramid2.stl"), ("tall_block", "tall_block.stl")):
        truth_mesh = trimesh.load(folder / mesh)
        vertices, faces = np.array(truth_mesh.vertices), np.array(truth_mesh.faces)
        whole = tmf_log(folder / f"{name}.json", 0.01, 0.0).readings
        seen = RayCaster(vertices, faces).ranges(whole.position_m, whole.axis)
        offset = float(np.nanmedian((whole.range_m - seen)[np.isfinite(whole.range_m) & np.isfinite(seen)]))
        for taken, sigma in ((0.0, 0.01), (offset, 0.01), (offset, 0.003)):
            log = tmf_log(folder / f"{name}.json", sigma, taken)
            began = time.perf_counter()
            surface = map_of(log)
            moved = vertices - log.world_from_part[:3, 3] + surface.grid.world_from_part[:3, 3]
            truth = truth_around(moved, faces, surface.grid)
            text = shares(surface, error_map(surface, truth))
            print(f"tmf {name} offset {1e3 * taken:+.0f} sigma {1e3 * sigma:g} mm: {text} "
                  f"{time.perf_counter() - began:.1f} s", flush=True)  # fmt: skip


def main() -> None:
    """Print what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--real", type=Path)
    parser.add_argument("--made", action="store_true")
    parser.add_argument("--only", default="")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    given = parser.parse_args()
    if given.real is not None:
        for name, run in (("vl53l5cx_vicon", vicon), ("tmf8820_arm", tmf)):
            if (given.real / name).is_dir() and given.only in name:
                run(given.real / name)
    if given.made:
        made(given.seeds, given.only)


if __name__ == "__main__":
    main()
