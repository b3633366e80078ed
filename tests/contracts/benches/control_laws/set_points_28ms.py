"""The law for the arm with its fixture, softer than usual."""

from contextlib import contextmanager

from plug_in_bench import LawBench

from surfuse.arm_models.puma560 import READY_RAD
from surfuse.arm_models.puma560_dynamics import FIXTURE, loaded_puma560
from surfuse.motion.control.set_points_28ms import Parameters
from surfuse.motion.control_law import LawSurroundings, LoopGains


@contextmanager
def bench(folder):
    around = LawSurroundings(loaded_puma560(FIXTURE), READY_RAD)
    parameters = Parameters(LoopGains(natural_rad_s=30.0, damping=0.8, integral_share=0.3), surroundings=around)
    yield LawBench(parameters, {"gains": {"natural_rad_s": 30, "damping": 0.8, "integral_share": 0.3}})
