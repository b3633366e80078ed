"""The twin's ranging kit on a pseudo-terminal."""

import os
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest
from plug_in_bench import SensorBench

from surfuse.sensors.ranging_kit import Parameters


@contextmanager
def bench(folder):
    if os.name != "posix":
        pytest.skip("pseudo-terminals need POSIX")
    pytest.importorskip("serial")
    sys.path.insert(0, str(Path(__file__).parents[3] / "stand_ins"))
    from kit_terminal import KitTerminal

    with KitTerminal() as kit:
        values = {"port": kit.port, "pings": 3, "timeout_s": 60}
        yield SensorBench(Parameters(kit.port, pings=3, timeout_s=60.0), values, 0.43, kit.vanish)
