"""What looking on costs a scan: the period from sweep to sweep with the live view and without.

Each run is a process of its own; pages are stood in for by clients of another process that read all they are sent.
`--pace` adds the time that a real arm and real sensors take between two sweeps.

Run: python benchmarks/bench_view.py [--runs 5] [--pace 0.0] [--pages 2] [--method beam]
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path

CLIENT = """
import sys, viser
from websockets.sync.client import connect
address = sys.argv[1].replace("http", "ws")
with connect(address, subprotocols=[f"viser-v{viser.__version__}"], max_size=None, ping_interval=None) as page:
    bytes_read = 0
    try:
        while True:
            bytes_read += len(page.recv())
    except Exception:
        print(bytes_read)
"""


@dataclass
class Timed:
    """An observer that notes when sweeps come, waits as a real rig would, and tells another one."""

    other: object | None
    pace_s: float
    at_s: list[float] = field(default_factory=list)
    work_s: list[float] = field(default_factory=list)

    def planned(self, scan):
        if self.other is not None:
            self.other.planned(scan)

    def swept(self, sweep):
        if self.other is not None:
            self.other.swept(sweep)
        time.sleep(self.pace_s)
        self.at_s.append(time.perf_counter())
        self.work_s.append(time.process_time())

    def finished(self, surface):
        pass


def one_run(view: bool, pace_s: float, pages: int, method: str, step_m: float) -> None:
    """One scan; prints wall and processor time of a period (s)."""
    from surfuse.commands.acquire import acquisition
    from surfuse.commands.outcome import SilentWatcher
    from surfuse.settings import load

    settings = load(None, ["scene.name=relief", f"fusion.method={method}", f"scan.step_m={step_m}"])
    clients: list[subprocess.Popen] = []

    def announce(address: str) -> None:
        command = [sys.executable, "-c", CLIENT, address]
        clients.extend(subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(pages))

    if view:
        from surfuse.commands.show.live_view import live_view

        opened = live_view(0, lambda text: sys.exit(text), announce)
    else:
        opened = nullcontext()
    with tempfile.TemporaryDirectory() as folder, opened as looked:
        timed = Timed(looked, pace_s)
        acquisition.acquire(settings, Path(folder) / "run", SilentWatcher(), timed)
    # The first sweeps load compiled code.
    first = 5
    stops = len(timed.at_s) - 1 - first
    sent = sum(int(client.communicate()[0]) for client in clients)
    print(
        json.dumps(
            {
                "period_s": (timed.at_s[-1] - timed.at_s[first]) / stops,
                "work_s": (timed.work_s[-1] - timed.work_s[first]) / stops,
                "sent": sent,
            }
        )
    )


def measured(view: bool, options: argparse.Namespace) -> dict[str, float]:
    how = ["--pace", options.pace, "--pages", options.pages, "--method", options.method, "--step", options.step]
    command = [sys.executable, __file__, "--one", "view" if view else "plain", *map(str, how)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--pace", type=float, default=0.0)
    parser.add_argument("--pages", type=int, default=2)
    parser.add_argument("--method", default="beam")
    parser.add_argument("--step", type=float, default=0.01)
    parser.add_argument("--one", choices=("view", "plain"))
    options = parser.parse_args()
    if options.one:
        one_run(options.one == "view", options.pace, options.pages, options.method, options.step)
        return
    plain, view = [], []
    for _ in range(options.runs):
        # In turn, so that a slow minute of the machine meets both.
        plain.append(measured(False, options))
        view.append(measured(True, options))
    for name, unit in (("period_s", "wall"), ("work_s", "processor")):
        without, with_view = (statistics.median(one[name] for one in some) for some in (plain, view))
        growth = statistics.median(b[name] / a[name] - 1.0 for a, b in zip(plain, view, strict=True))
        print(f"{unit:<10} {1e3 * without:8.2f} ms without, {1e3 * with_view:8.2f} ms with, {growth:+.1%} (pairs)")
    print(f"sent to {options.pages} pages: {statistics.median(one['sent'] for one in view) / 2**20:.1f} MiB")


if __name__ == "__main__":
    main()
