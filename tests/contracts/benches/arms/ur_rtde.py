"""A controller that speaks RTDE and takes URScript, on loopback, in a process of its own."""

import os
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from plug_in_bench import ArmBench

from surfuse.arm_models.puma560 import Puma560
from surfuse.arms.ur_rtde import Parameters
from surfuse.motion.arm_surroundings import ArmSurroundings
from surfuse.motion.limits import JointLimits

# The ports of the protocol are fixed, so the stand-in gets an address of its own.
ADDRESS = f"127.74.{os.getpid() // 250 % 250 + 1}.{os.getpid() % 250 + 1}"
LIMITS = JointLimits(np.full(6, -6.2), np.full(6, 6.2), np.full(6, 3.0), np.full(6, 10.0))


@contextmanager
def bench(folder):
    pytest.importorskip("rtde_receive")
    if not sys.platform.startswith("linux"):
        pytest.skip("other loopback addresses than 127.0.0.1 need Linux")
    command = [sys.executable, str(Path(__file__).parents[3] / "arms" / "ur_stand_in.py"), ADDRESS]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "ready\n"

        def vanish():
            process.kill()
            process.wait()
            time.sleep(1.2)

        around = ArmSurroundings(Puma560(np.eye(4), np.eye(4)), LIMITS)
        values = {"host": ADDRESS, "speed_share": 1, "settle_s": 0.03, "answer_timeout_s": 1.0}
        parameters = Parameters(ADDRESS, 1.0, settle_s=0.03, answer_timeout_s=1.0, surroundings=around)
        try:
            yield ArmBench(parameters, values, np.array([0.2, -0.1, 0.15, 0.05, -0.2, 0.1]), 1e-3, vanish)
        finally:
            process.kill()
