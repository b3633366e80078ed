"""Either side of the bridge is killed (SIGKILL) at random moments; after `resume` every map is the uninterrupted one.

Run: python benchmarks/kill_scans.py [--kills N] [--seed S]. Three rigs by turns: the twin on the wire with `mean` and
with the default method, and a pretended gantry. Every second kill meets the bridge, which is started again at once or
only when the scan has given up. Moments are spread evenly: a third of them over a whole run, the others over what comes
after its folder is there (connecting, planning, scanning, fusing, report). A third of the resumed runs are killed
again. Compared are all arrays of surface.nc, bit by bit. Fifty kills take six minutes on two cores.
"""

from __future__ import annotations

import argparse
import math
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from surfuse.errors import SurfuseError
from surfuse.runs.progress import read_progress

PRETENDED = Path(__file__).parents[1] / "tests" / "rig" / "pretended_rig.py"
SURFUSE = [sys.executable, "-m", "surfuse"]
MOST_RESUMES = 12
AGAIN_SHARE = 1.0 / 3.0
LASER = 'kind = "laser"\nbeam_full_angle_deg = 1.0\nrange_min_m = 0.05\nrange_max_m = 1.5\nsigma_m = 0.001\n'
SONAR = (
    'kind = "ultrasonic"\nbeam_full_angle_deg = 13.0\nrange_min_m = 0.33\nrange_max_m = 4.0\nsigma_m = 0.0003\n'
    "frequency_hz = 63000.0\naperture_m = 0.04\ndead_length_m = 0.2\nfiring_time_s = 0.125\n"
)


def gantry_cell(arm: str) -> str:
    """One laser over the plane of the pretended rig, 209 stops."""
    area = "origin_m = [-0.09, -0.05, 0.0]\nwidth_m = 0.18\nheight_m = 0.10\ntallest_m = 0.1"
    return (
        f'[arm]\n{arm}\n[[sensor]]\nname = "us0"\n{LASER}[area]\n{area}\n[scan]\nstep_m = 0.01\nstandoff_m = 0.4\n'
        '[fusion]\nmethod = "mean"\n'
    )


def twin_cell(arm: str, method: str) -> str:
    """Four ultrasonic rangers before the twin's relief, 81 stops."""
    c, s = math.cos(math.radians(35.0)), math.sin(math.radians(35.0))
    corner = [1.12 * c - 0.1 * s, 1.12 * s + 0.1 * c, 1.0]
    places = [(0.025, -0.025), (-0.025, -0.025), (0.025, 0.025), (-0.025, 0.025)]
    sensors = "".join(
        f'[[sensor]]\nname = "us{k}"\n{SONAR}position_m = [{x}, {y}, 0.0]\n' for k, (x, y) in enumerate(places)
    )
    area = f"[area]\norigin_m = {corner}\nu = [{s}, {-c}, 0.0]\nv = [0.0, 0.0, 1.0]\nwidth_m = 0.2\nheight_m = 0.2\n"
    fusion = f'[fusion]\nmethod = "{method}"\n' if method else ""
    return f"[arm]\n{arm}\n{sensors}{area}[scan]\nstep_m = 0.025\n{fusion}"


class Bridge:
    """A bridge in a process of its own, on the same port every time it is started."""

    def __init__(self, command: Callable[[str], list[str]]) -> None:
        self._command, self._port = command, "0"
        self._program: subprocess.Popen[str] | None = None
        self.address = ""

    def start(self) -> None:
        """Start it, and wait until it listens."""
        self.begin()
        self.await_listening()

    def begin(self) -> None:
        """Start it; the words with its address come later."""
        self._program = subprocess.Popen(
            self._command(self._port), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )

    def await_listening(self) -> None:
        """Read the address that it prints."""
        assert self._program is not None
        assert self._program.stdout is not None
        words = self._program.stdout.readline().replace(";", " ").split()
        self.address = next(word for word in words if word.startswith("tcp://"))
        self._port = self.address.rpartition(":")[2]

    def kill(self) -> None:
        """End it without a word."""
        assert self._program is not None
        self._program.kill()
        self._program.communicate()


@dataclass(frozen=True)
class Rig:
    """A bridge and the cell file that speaks to it."""

    name: str
    bridge: Bridge
    cell: Path

    def acquire(self, run: Path) -> subprocess.Popen[str]:
        """The scan as a process of its own."""
        return _started("acquire", "--cell", self.cell, "--out", run, "--yes", "--quiet")


def _started(*words: object) -> subprocess.Popen[str]:
    command = [*SURFUSE, *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def rigs(folder: Path) -> list[Rig]:
    """The three rigs, their bridges running."""
    found = []
    for name, method in (("twin, mean", "mean"), ("twin, default method", ""), ("gantry, mean", "mean")):
        stem = name.replace(", ", "_").replace(" ", "_")
        if name.startswith("twin"):
            served = folder / f"{stem}_served.toml"
            served.write_text(twin_cell('driver = "kinematic"', method), "utf-8")
            command = [*SURFUSE, "bridge", "--cell", str(served), "--port"]
        else:
            command = [sys.executable, str(PRETENDED)]
        bridge = Bridge(lambda port, command=command: [*command, port])  # type: ignore[misc]
        bridge.start()
        arm = f'driver = "bridge"\naddress = "{bridge.address}"'
        cell = folder / f"{stem}.toml"
        cell.write_text(twin_cell(arm, method) if name.startswith("twin") else gantry_cell(arm), "utf-8")
        found.append(Rig(name, bridge, cell))
    return found


def arrays(run: Path) -> dict[str, np.ndarray]:
    """All arrays of the map, by name."""
    found: dict[str, np.ndarray] = {}

    def keep(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            found[name] = item[()]

    with h5py.File(run / "surface.nc") as file:
        file.visititems(keep)
    return found


def differences(one: Path, other: Path) -> list[str]:
    """Names of the arrays that are not the same bits."""
    a, b = arrays(one), arrays(other)
    return [name for name in sorted(a | b) if name not in a or name not in b or a[name].tobytes() != b[name].tobytes()]


def reached(run: Path) -> str:
    """How far a killed run came, by what is on disk."""
    if (run / "report.html").is_file():
        return "after the report"
    if (run / "surface.nc").is_file():
        return "while the report is written"
    if not (run / "run.toml").is_file():
        return "before the run folder"
    try:
        progress = read_progress(run)
    except SurfuseError:
        progress = None
    if progress is None:
        return "connecting and planning"
    return "scanning" if progress.left else "fusing"


class Campaign:
    """Runs that are killed, with what was found."""

    def __init__(self, folder: Path, seed: int) -> None:
        self._folder, self._dice = folder, random.Random(seed)
        self.kills, self.runs = 0, 0
        self.moments: Counter[str] = Counter()
        self.sides: Counter[str] = Counter()
        self.wrong: list[str] = []

    def reference(self, rig: Rig) -> tuple[Path, float, float]:
        """The uninterrupted run, when its folder is there and how long it takes in all (s), warm."""
        begun_s, seconds = 0.0, 0.0
        for name in ("first", "reference"):
            run = self._folder / f"{rig.cell.stem}_{name}"
            began = time.perf_counter()
            process = rig.acquire(run)
            while process.poll() is None and not (run / "run.toml").is_file():
                time.sleep(0.002)
            begun_s = time.perf_counter() - began
            complaints = process.communicate()[1]
            if process.returncode:
                raise SystemExit(f"{rig.name}: the uninterrupted run fails: {complaints}")
            seconds = time.perf_counter() - began
        return self._folder / f"{rig.cell.stem}_reference", begun_s, seconds

    def run_once(self, rig: Rig, reference: tuple[Path, float, float], share: float, side: str) -> None:
        """One run, killed once or more, resumed, and compared."""
        self.runs += 1
        run = self._folder / f"run{self.runs}"
        process = rig.acquire(run)
        uninterrupted, begun_s, duration_s = reference
        from_s = 0.0 if self.runs % 3 == 0 else begun_s
        self._kill(rig, process, run, side, from_s + share * (duration_s - from_s))
        for _ in range(MOST_RESUMES):
            if (run / "report.html").is_file() and (run / "surface.nc").is_file():
                break
            # Killed before it had written what it is about, a run is begun again.
            begun = (run / "run.toml").is_file()
            process = _started("resume", run, "--yes", "--quiet") if begun else rig.acquire(run)
            if self._dice.random() < AGAIN_SHARE:
                self._kill(
                    rig, process, run, self._dice.choice(("scan", "bridge")), self._dice.uniform(from_s, duration_s)
                )
                continue
            complaints = process.communicate()[1]
            if process.returncode:
                self.wrong.append(f"run {self.runs} ({rig.name}): resume ended with {process.returncode}: {complaints}")
                return
        off = differences(uninterrupted, run) if (run / "surface.nc").is_file() else ["no map"]
        if off:
            self.wrong.append(f"run {self.runs} ({rig.name}): differs in {', '.join(off)}")
        else:
            shutil.rmtree(run)

    def _kill(self, rig: Rig, process: subprocess.Popen[str], run: Path, side: str, after_s: float) -> None:
        end_s = time.perf_counter() + after_s
        while time.perf_counter() < end_s and process.poll() is None:
            time.sleep(0.002)
        if process.poll() is not None:
            self._ended(process)
            return
        self.kills += 1
        self.sides[side] += 1
        if side == "scan":
            process.kill()
            process.communicate()
            self.moments[reached(run)] += 1
            return
        at_once = self._dice.random() < 0.5
        rig.bridge.kill()
        self.moments[reached(run)] += 1
        if at_once:
            rig.bridge.begin()
        complaints = process.communicate()[1]
        if not at_once:
            rig.bridge.begin()
        rig.bridge.await_listening()
        if process.returncode not in (0, 4, 5):
            text = f"run {self.runs} ({rig.name}): without its bridge status {process.returncode}: {complaints}"
            self.wrong.append(text)

    def _ended(self, process: subprocess.Popen[str]) -> None:
        """It was quicker than the kill, which does not count."""
        complaints = process.communicate()[1]
        if process.returncode:
            self.wrong.append(f"run {self.runs}: without a kill status {process.returncode}: {complaints}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    began = time.perf_counter()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        campaign = Campaign(folder, asked.seed)
        dice = random.Random(asked.seed + 1)
        found = rigs(folder)
        try:
            references = [campaign.reference(rig) for rig in found]
            turn = 0
            while campaign.kills < asked.kills:
                # The golden ratio spreads the moments evenly, however many there are.
                share = (turn * 0.618033988749895 + 0.02 * dice.random()) % 1.0
                number, side = turn % len(found), ("scan", "bridge")[turn // len(found) % 2]
                campaign.run_once(found[number], references[number], share, side)
                turn += 1
                print(f"\r{campaign.kills} kills, {len(campaign.wrong)} wrong", end="", file=sys.stderr)
        finally:
            for rig in found:
                rig.bridge.kill()
        if campaign.wrong:
            kept = shutil.copytree(
                folder, Path(tempfile.gettempdir()) / f"killed_scans_{asked.seed}_{int(time.time())}"
            )
            print(f"\nruns that differ are kept in {kept}")
    print(f"\n{campaign.kills} kills in {campaign.runs} runs, {campaign.runs - len(campaign.wrong)} maps identical")
    print("durations of an uninterrupted run: " + ", ".join(f"{seconds:.1f} s" for _, _, seconds in references))
    for what, count in (*campaign.sides.most_common(), *campaign.moments.most_common()):
        print(f"{count:5d} {what}")
    for text in campaign.wrong:
        print(text)
    print(f"{time.perf_counter() - began:.0f} s")
    sys.exit(bool(campaign.wrong))


if __name__ == "__main__":
    main()
