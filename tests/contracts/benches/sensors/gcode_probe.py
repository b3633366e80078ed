"""A touch probe on a gantry with GRBL on a pseudo-terminal, 30 mm above a part."""

import os
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest
from plug_in_bench import SensorBench

from surfuse.sensors.gcode_probe import Parameters


@contextmanager
def bench(folder):
    if os.name != "posix":
        pytest.skip("pseudo-terminals need POSIX")
    pytest.importorskip("serial")
    sys.path.insert(0, str(Path(__file__).parents[3] / "stand_ins"))
    from gcode_boards import Grbl

    with Grbl() as board:
        board.push(0.0, 0.0, 100.0)
        board.part_mm = 70.0
        values = {"port": board.port, "dialect": "grbl", "probe_feed_mm_min": 3000}
        yield SensorBench(Parameters(board.port, "grbl", probe_feed_mm_min=3000.0), values, 0.03, board.vanish)
