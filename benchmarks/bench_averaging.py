"""The node's average of several pings against their plain mean and their median, on the twin and on recorded bursts.

Run: OMP_NUM_THREADS=1 python benchmarks/bench_averaging.py [--bursts N] [--picture FILE.svg] [--recording FOLDER]...
In the twin the tube stands 0.43 m before a matte plate, at a new place for every burst; the truth of a burst is what
the same place reads without noise. An error of more than 1 mm is a wrong reading: on most of these surfaces it means
that the average took another echo, or a period, for the right one. FOLDER holds a recording that surfuse can read
(a run, a CSV, a time-of-flight log with motion capture); bursts are consecutive readings of one sensor that stands
still, and their truth is the median of all other readings from there.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from surfuse.geometry.poses import pose, rotation_about
from surfuse.node.averaging import AveragingParameters, consistent
from surfuse.records import FloatArray, Status
from surfuse.report.line_charts import Chart, Series, picture
from surfuse.runs.scan_source import load_scan
from surfuse.sensors import polaroid
from surfuse.twin.acoustics.kit import TUBE, KitParameters
from surfuse.twin.acoustics.noise import SILENT, AcousticNoise
from surfuse.twin.acoustics.sounder import Sounder
from surfuse.twin.materials import Material
from surfuse.twin.scene import Scene, SceneBody

LOOK = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
STANDOFF_M, SPAN_M, WRONG_M = 0.43, 0.08, 1e-3
COUNTS = (3, 5, 8)
Burst = tuple[FloatArray, float]


@dataclass(frozen=True)
class Condition:
    """What the bursts are like; shares are probabilities of a ping."""

    name: str
    tilt_deg: float = 0.0
    noise: AcousticNoise = field(default_factory=AcousticNoise)
    kit: KitParameters = field(default_factory=KitParameters)
    outliers: float = 0.0


CONDITIONS = (
    Condition("facing plate"),
    Condition("20 % of the pings silent", noise=AcousticNoise(dropout=0.2)),
    Condition("5 % slip a period", noise=AcousticNoise(slip=0.05)),
    Condition("20 % slip a period", noise=AcousticNoise(slip=0.2)),
    Condition("40 % slip a period", noise=AcousticNoise(slip=0.4)),
    Condition("10 % outliers", outliers=0.1),
    Condition("20 % outliers", outliers=0.2),
    Condition("cross-talk, 3 neighbours", kit=KitParameters(trigger="internal")),
    Condition("cross-talk, 12 neighbours", noise=AcousticNoise(neighbours=12), kit=KitParameters(trigger="internal")),
    Condition("clock of 50 kHz", kit=KitParameters(sample_rate_hz=5e4)),
    Condition("noise of 1 mm, 0.3 expected", noise=AcousticNoise(timing_m=1e-3)),
    *(Condition(f"speckle, {tilt} degrees", tilt_deg=tilt) for tilt in (5, 10, 15, 20, 25)),
    Condition("speckle, 20 degrees, 20 % slip", tilt_deg=20.0, noise=AcousticNoise(slip=0.2)),
)


def plate(tilt_deg: float) -> Scene:
    half = 0.4
    corners = np.array([[0.0, -half, -half], [0.0, half, -half], [0.0, half, half], [0.0, -half, half]])
    turned = pose(rotation_about([0.0, 0.0, 1.0], np.radians(tilt_deg)), [0.0, 0.0, 0.0])
    return Scene([SceneBody(corners, np.array([[0, 2, 1], [0, 3, 2]]), Material.PART, turned)])


def bursts(condition: Condition, pings: int, number: int) -> Iterator[Burst]:
    """Finite ranges of one trigger, and the range without noise; places that answer nothing are left out."""
    scene, generator = plate(condition.tilt_deg), np.random.default_rng(pings)
    noisy = Sounder(scene, TUBE, condition.kit)
    true = Sounder(scene, TUBE, replace(condition.kit, sample_rate_hz=1e8, trigger="external"))
    slope = np.tan(np.radians(condition.tilt_deg))
    for y, z in generator.uniform(-SPAN_M, SPAN_M, (number, 2)).tolist():
        place = pose(LOOK, [-STANDOFF_M - y * slope, y, z])
        truth = float(true.ping(place, 1, SILENT, np.random.default_rng(0), 0.0)[0][0])
        ranges, _ = noisy.ping(place, pings, condition.noise, generator, 0.0)
        wrong = generator.random(pings) < condition.outliers
        ranges = np.where(wrong, generator.uniform(0.33, 0.6, pings), ranges)
        heard = ranges[np.isfinite(ranges)]
        if np.isfinite(truth) and 2 * len(heard) > pings:
            yield heard, truth


def answers(parameters: AveragingParameters) -> dict[str, Callable[[FloatArray], float]]:
    return {
        "node": lambda ranges: consistent(ranges, parameters).range_m,
        "mean": lambda ranges: float(ranges.mean()),
        "median": lambda ranges: float(np.median(ranges)),
    }


def errors(found: list[Burst], parameters: AveragingParameters) -> dict[str, FloatArray]:
    """Absolute errors of each way to average."""
    return {
        name: np.array([abs(answer(ranges) - truth) for ranges, truth in found])
        for name, answer in answers(parameters).items()
    }


def row(name: str, pings: int, wrong_m: float, off: dict[str, FloatArray]) -> str:
    cells = []
    for own in off.values():
        right = own[own <= wrong_m]
        usual_mm = 1e3 * float(np.sqrt(np.mean(right**2))) if len(right) else np.nan
        cells.append(f"{usual_mm:6.3f} {100.0 * float(np.mean(own > wrong_m)):5.1f} %")
    return f"{name:32s}{pings:3d}   " + "   ".join(cells)


def twin(number: int, drawn: Path | None) -> None:
    print(f"{'':35s}" + "".join(f"{name:>17s}" for name in answers(AveragingParameters())))
    print(f"{'condition':32s}{'n':>3s}   " + "   ".join(["rms mm  wrong"] * 3))
    shares: dict[str, list[float]] = {name: [] for name in answers(AveragingParameters())}
    for condition in CONDITIONS:
        parameters = polaroid.averaging_of(polaroid.SPEC, condition.kit.sample_rate_hz)
        for pings in COUNTS:
            off = errors(list(bursts(condition, pings, number)), parameters)
            print(row(condition.name, pings, WRONG_M, off), flush=True)
            if pings == COUNTS[1]:
                for name, own in off.items():
                    shares[name].append(100.0 * float(np.mean(own > WRONG_M)))
    if drawn is not None:
        drawn.write_text(picture([slips_chart(number), outliers_chart(number)], "Averaging five pings"))


def slips_chart(number: int) -> Chart:
    conditions = [Condition("", noise=AcousticNoise(slip=share)) for share in np.linspace(0.0, 0.6, 9).tolist()]
    return shares_chart("Pings that slip a period", conditions, [100.0 * one.noise.slip for one in conditions], number)


def outliers_chart(number: int) -> Chart:
    conditions = [Condition("", outliers=share) for share in np.linspace(0.0, 0.6, 9).tolist()]
    return shares_chart("Pings that are outliers", conditions, [100.0 * one.outliers for one in conditions], number)


def shares_chart(title: str, conditions: list[Condition], x: list[float], number: int) -> Chart:
    parameters = polaroid.averaging_of(polaroid.SPEC)
    columns = [errors(list(bursts(one, COUNTS[1], number)), parameters) for one in conditions]
    series = []
    for name in columns[0]:
        wrong = (100.0 * float(np.mean(off[name] > WRONG_M)) for off in columns)
        series.append(Series(name, tuple(zip(x, wrong, strict=True))))
    return Chart(title, "share of the pings, %", "readings off by more than 1 mm, %", tuple(series), (0.0, 100.0))


def recorded(folder: Path, pings: int) -> Iterator[Burst]:
    """Bursts of sensors that stand still (1 mm and 0.1 degrees against the reading before)."""
    readings = load_scan(folder).readings
    for sensor in range(len(readings.specs)):
        mine = np.flatnonzero((readings.sensor == sensor) & (readings.status == int(Status.OK)))
        place, axis, ranges = readings.position_m[mine], readings.axis[mine], readings.range_m[mine]
        moved = np.linalg.norm(np.diff(place, axis=0), axis=1) > 1e-3
        turned = np.linalg.norm(np.diff(axis, axis=0), axis=1) > np.radians(0.1)
        for stretch in np.split(ranges, np.flatnonzero(moved | turned) + 1):
            for first in range(0, len(stretch) - pings + 1, pings):
                others = np.concatenate([stretch[:first], stretch[first + pings :]])
                if len(others) >= 2 * pings:
                    yield stretch[first : first + pings], float(np.median(others))


def recordings(folders: list[Path]) -> None:
    for folder in folders:
        for pings in COUNTS:
            found = list(recorded(folder, pings))
            if not found:
                print(f"{folder.name}: no sensor stands still for long enough")
                break
            sigma_m = 1.4826 * float(np.median([np.median(np.abs(r - np.median(r))) for r, _ in found]))
            parameters = AveragingParameters(sigma_m=max(sigma_m, 1e-4), resolution_m=1e-3)
            off = errors(found, parameters)
            print(row(f"{folder.name}: {len(found)} bursts", pings, 5.0 * parameters.noise_m, off))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bursts", type=int, default=2000)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--recording", type=Path, action="append", default=[])
    arguments = parser.parse_args()
    twin(arguments.bursts, arguments.picture)
    recordings(arguments.recording)


if __name__ == "__main__":
    main()
