"""Stopping distance of the simulated arm from random postures and speeds: with the motors' help, and without power.

Run: OMP_NUM_THREADS=1 python benchmarks/bench_motion_stop.py [--states N]. Joint speeds are drawn within their limits
and scaled so that the tool moves at 1 m/s at most. Brakes hold as much as the motors give, which is assumed. `--load`
is a load at the flange that the controller does not know; the wrist has no brakes and sinks under it without power.
"""

from __future__ import annotations

import argparse

import numpy as np

from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, LIMITS, Puma560
from surfuse.geometry.poses import pose
from surfuse.records import FloatArray
from surfuse.rig.simulated.assembly import SimulatedClock
from surfuse.rig.simulated.servo_arm import ServoDesign, Unknown, build_servo_arm

KINEMATICS = Puma560(np.eye(4), pose(np.eye(3), [0.0, 0.0, 0.08 - FLANGE_OFFSET_M]))
TOOL_SPEED_M_S = 1.0


def stopped(seed: int, powered: bool, load_kg: float) -> tuple[FloatArray, float, float]:
    """How far the joints (6,) turn and the tool (m) moves after an emergency stop, and how long it takes (s)."""
    rng = np.random.default_rng(seed)
    middle, half = 0.5 * (LIMITS.lower_rad + LIMITS.upper_rad), 0.45 * (LIMITS.upper_rad - LIMITS.lower_rad)
    start = middle + half * rng.uniform(-1.0, 1.0, 6)
    clock = SimulatedClock()
    load = Unknown(load_kg=load_kg)
    parts = build_servo_arm(KINEMATICS, clock, rng, ServoDesign(unknown=load, calibrated_at_start=False), start)
    with parts.arm:
        # At the corners of the speed limits the arm has most energy.
        speed = LIMITS.velocity_rad_s * np.where(rng.random(6) < 0.5, -1.0, 1.0) * rng.uniform(0.5, 1.0, 6)
        tool = float(np.linalg.norm(KINEMATICS.jacobian(start)[:3] @ speed))
        parts.plant.drift(speed * min(1.0, TOOL_SPEED_M_S / tool))
        begin, began_s = parts.plant.position_rad, clock.now_s()
        if powered:
            parts.arm.emergency_stop()
        else:
            parts.card.open_emergency_stop()
            parts.arm.servo.stop("no power")
        end = parts.plant.position_rad
    places = KINEMATICS.forward(np.array([begin, end]))[:, :3, 3]
    return np.abs(end - begin), float(np.linalg.norm(places[1] - places[0])), clock.now_s() - began_s


def main(states: int, load_kg: float) -> None:
    """Largest and 99th percentile over all states."""
    for powered in (True, False):
        found = [stopped(seed, powered, load_kg) for seed in range(states)]
        turns, tool = np.array([one[0] for one in found]), 1e3 * np.array([one[1] for one in found])
        times = np.array([one[2] for one in found])
        how = "with the motors' help" if powered else "without power"
        print(f"{states} stops {how}, tool at up to {TOOL_SPEED_M_S:g} m/s, joints at up to their limits")
        for j in range(6):
            print(f"joint {j + 1}: 99 % {np.percentile(turns[:, j], 99):.3f} rad, largest {turns[:, j].max():.3f} rad")
        print(f"tool:    99 % {np.percentile(tool, 99):.1f} mm, largest {tool.max():.1f} mm")
        print(f"time to rest: median {np.median(times):.2f} s, largest {times.max():.2f} s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--states", type=int, default=500)
    parser.add_argument("--load", type=float, default=0.0)
    chosen = parser.parse_args()
    main(chosen.states, chosen.load)
