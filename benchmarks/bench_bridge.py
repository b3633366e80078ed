"""The bridge over loopback and over pipes: question and answer, and a stop (move, sweep, state).

Run: OMP_NUM_THREADS=1 python benchmarks/bench_bridge.py [--questions N]. The server is a process of its own. Bare echo:
the same line there and back over a bare socket, in the same run; the figures depend on the machine, their ratio less.
"""

from __future__ import annotations

import argparse
import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from surfuse.bridge.child import ChildTransport
from surfuse.bridge.client import BridgeClient
from surfuse.bridge.messages import MoveTo
from surfuse.bridge.transport import TcpTransport

RIG = Path(__file__).parents[1] / "tests" / "bridge" / "tilted_plane.py"
MINIMAL = Path(__file__).parents[1] / "examples" / "bridges" / "minimal.py"


def report(name: str, ask: Callable[[], object], times: int) -> None:
    spent_us = []
    for _ in range(times):
        began = time.perf_counter_ns()
        ask()
        spent_us.append(1e-3 * (time.perf_counter_ns() - began))
    median, late = np.percentile(spent_us[times // 10 :], [50, 99])
    print(f"{name:40s} median {median:7.0f} us, 99th percentile {late:7.0f} us")


def questions(client: BridgeClient, where: str, times: int) -> None:
    report(f"{where}: state", client.state, times)
    report(f"{where}: sweep of {len(client.hello.sensors)}", client.sweep, times)
    pose = np.array(client.state().world_from_tool)

    def stop() -> None:
        pose[0, 3] = 0.1 - pose[0, 3]
        client.move(MoveTo(world_from_tool=pose))
        client.observe()

    report(f"{where}: a stop (move, sweep, state)", stop, times)


def bare_echo(times: int) -> None:
    near, far = socket.socketpair()
    line = json.dumps({"id": 1, "ok": True, "t_s": 12345.678901, "world_from_tool": [0.123456789] * 16}).encode()

    def answer() -> None:
        while data := far.recv(65536):
            far.sendall(data)

    threading.Thread(target=answer, daemon=True).start()

    def ask() -> None:
        near.sendall(line)
        near.recv(65536)

    report("bare echo between two threads", ask, times)
    near.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--questions", type=int, default=5000)
    times = parser.parse_args().questions
    bare_echo(times)
    served = [sys.executable, str(RIG), "tcp://127.0.0.1:0"]
    with subprocess.Popen(served, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        address = process.stdout.readline().decode().strip()
        with BridgeClient(TcpTransport(address)) as client:
            questions(client, "tcp", times)
        process.kill()
    for name, program in (("pipes", RIG), ("pipes, minimal.py", MINIMAL)):
        with BridgeClient(ChildTransport([sys.executable, str(program)], lambda line: None)) as client:
            questions(client, name, times)


if __name__ == "__main__":
    main()
