"""A gantry with GRBL on a pseudo-terminal."""

import os
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from plug_in_bench import PoseArmBench, TickingClock

from surfuse.arms.gcode import Parameters
from surfuse.geometry.poses import pose
from surfuse.interfaces import PoseArmSurroundings

DOWN = np.diag([1.0, -1.0, -1.0])


@contextmanager
def bench(folder):
    if os.name != "posix":
        pytest.skip("pseudo-terminals need POSIX")
    pytest.importorskip("serial")
    sys.path.insert(0, str(Path(__file__).parents[3] / "stand_ins"))
    from gcode_boards import Grbl

    with Grbl() as board:
        values = {
            "port": board.port,
            "dialect": "grbl",
            "travel_min_m": [0, 0, 0],
            "travel_max_m": [0.3, 0.3, 0.3],
            "world_from_machine": [1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
            "settle_s": 0,
        }
        parameters = Parameters(
            board.port,
            "grbl",
            (0.0, 0.0, 0.0),
            (0.3, 0.3, 0.3),
            world_from_machine=(1.0, 0.0, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0),
            settle_s=0.0,
            surroundings=PoseArmSurroundings(TickingClock()),
        )
        target, beyond = pose(DOWN, [0.6, 0.05, 0.2]), pose(DOWN, [0.4, 0.05, 0.2])
        yield PoseArmBench(parameters, values, target, beyond, 1e-5, board.displace, board.vanish)
