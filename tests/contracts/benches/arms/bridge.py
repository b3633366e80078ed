"""The rig over a tilted plane behind the bridge protocol, on a free port of this machine."""

import sys
from contextlib import contextmanager
from pathlib import Path

from plug_in_bench import PoseArmBench

from surfuse.arms.bridge import Parameters

sys.path.insert(0, str(Path(__file__).parents[3] / "bridge"))
from tilted_plane import Served, TiltedPlane, above


@contextmanager
def bench(folder):
    rig = TiltedPlane()

    def displace():
        rig.pose = above(0.1, 0.05)

    with Served(rig) as served:
        values = {"address": served.address, "speed_share": 0.5, "give_up_s": 1.0}
        parameters = Parameters(served.address, speed_share=0.5, give_up_s=1.0)
        target, away = above(0.25, -0.1, 0.4), above(1.5)
        yield PoseArmBench(parameters, values, target, away, 1e-9, displace, served.server.close)
