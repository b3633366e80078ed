"""The PUMA 560 behind a card in software, with its dynamics."""

import sys
from contextlib import contextmanager
from pathlib import Path

from plug_in_bench import ArmBench

from surfuse.arms.trident import Parameters

sys.path.insert(0, str(Path(__file__).parents[3] / "arms"))
from trident_bench import TARGET, Bench


@contextmanager
def bench(folder):
    made = Bench(parameters=Parameters(rest_s=0.01))
    yield ArmBench(made.arm_parameters, {"rest_s": 0.01}, TARGET, 5e-4, made.card.go_silent)
