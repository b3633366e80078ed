"""Speed of the PUMA 560 inverse kinematics (all eight solutions) and of the check of a whole scan plan.

Run: OMP_NUM_THREADS=1 python benchmarks/bench_kinematics.py [--poses N] [--eaik SITE_PACKAGES]. Best of five runs.
EAIK is measured on the same poses in the same run when it can be imported; `--eaik` names a site-packages folder of
another environment that has it.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable

import numpy as np

from surfuse.arm_models import puma560_volume as volume
from surfuse.arm_models.puma560 import A_M, ALPHA_RAD, D_M, FLANGE_OFFSET_M, LIMITS, READY_RAD, STAND_HEIGHT_M, Puma560
from surfuse.geometry.poses import pose
from surfuse.motion.body import body_of, fixture_capsules
from surfuse.motion.clearance import ClearanceModel
from surfuse.motion.obstacles import Floor, RingTable
from surfuse.motion.own_links import own_links
from surfuse.plan.raster import grip_targets
from surfuse.plan.reach import reach
from surfuse.records import Fixture, FloatArray, SensorSpec


def best_s(call: Callable[[], object], runs: int = 5) -> float:
    """Shortest processor time of several runs, after one that compiles."""
    call()
    times = []
    for _ in range(runs):
        began = time.process_time()
        call()
        times.append(time.process_time() - began)
    return min(times)


def eaik_speed(poses: FloatArray, folder: str | None) -> tuple[float, float] | None:
    """EAIK's poses/s in a batch and the largest error of its solutions; None where it is not installed."""
    if folder:
        sys.path.append(folder)
    try:
        from eaik.IK_DH import DhRobot
    except ImportError:
        return None
    robot = DhRobot(np.array(ALPHA_RAD), np.array(A_M), np.array(D_M))
    few = poses[:5000]
    seconds = best_s(lambda: robot.IK_batched(few, 1), runs=3)
    found = robot.IK_batched(few[:50], 1)
    error = max(
        float(np.abs(robot.fwdKin(q) - target).max())
        for solution, target in zip(found, few[:50], strict=True)
        for q in solution.Q
    )
    return len(few) / seconds, error


def kinematics(count: int, eaik_folder: str | None) -> None:
    """Inverse kinematics in a batch, one by one, and forward."""
    arm = Puma560(np.eye(4), pose(np.eye(3), [0.0, 0.0, -FLANGE_OFFSET_M]))
    joints = np.random.default_rng(0).uniform(0.9 * LIMITS.lower_rad, 0.9 * LIMITS.upper_rad, (count, 6))
    poses = arm.forward(joints)
    batch = count / best_s(lambda: arm.inverse(poses))
    error = float(np.abs(arm.forward(arm.solutions(poses)) - poses[:, None]).max())
    single = 1.0 / best_s(lambda: arm.inverse(poses[:1]), runs=200)
    forward = count / best_s(lambda: arm.forward(joints))
    print(f"inverse, all 8 with limits, batch of {count}: {batch:12,.0f} poses/s   largest error {error:.1e}")
    print(f"inverse, one call a pose:                 {single:12,.0f} poses/s")
    print(f"forward, batch:                           {forward:12,.0f} poses/s")
    peer = eaik_speed(poses, eaik_folder)
    if peer is None:
        print("EAIK is not installed here: no ratio (see --eaik)")
    else:
        print(f"EAIK IK_batched, one worker:              {peer[0]:12,.0f} poses/s   largest error {peer[1]:.1e}")
        print(f"ratio: {batch / peer[0]:.1f}")


def scan_check() -> None:
    """Reach, limits, singularities, clearance and the ways between 10,000 stops."""
    spec = SensorSpec("s", "sonar", 0.35, 4.0, 0.4, 0.001)
    corners = [pose(np.eye(3), [x, y, 0.0]) for x in (-0.025, 0.025) for y in (-0.025, 0.025)]
    arm = Puma560(pose(np.eye(3), [0, 0, STAND_HEIGHT_M]), pose(np.eye(3), [0, 0, 0.08 - FLANGE_OFFSET_M]))
    rods = [*volume.CAPSULES, *fixture_capsules(Fixture(np.array(corners), (spec,) * 4), volume.TOOL_LINK)]
    solids = (RingTable(), Floor(), volume.column(STAND_HEIGHT_M))
    cell = ClearanceModel(arm.link_poses, body_of(rods), solids, own_links(rods, volume.OWN_PAIRS))
    others = ClearanceModel(arm.link_poses, body_of(rods), solids)
    part = pose(np.column_stack([[0, -1, 0], [0, 0, 1], [-1, 0, 0]]), [1.05, 0.0, 1.0])
    u, v = np.meshgrid(np.linspace(-0.12, 0.12, 100), np.linspace(0.0, 0.22, 100))
    u[1::2] = u[1::2, ::-1]
    targets = grip_targets(part, np.column_stack([u.ravel(), v.ravel()]))
    seconds = best_s(lambda: reach(targets, arm, READY_RAD, cell))
    without = best_s(lambda: reach(targets, arm, READY_RAD, others))
    print(f"reach check of {len(targets)} stops:              {1e3 * seconds:12.1f} ms")
    print(f"the same without own links:               {1e3 * without:12.1f} ms")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=20000)
    parser.add_argument("--eaik", default=None)
    chosen = parser.parse_args()
    kinematics(chosen.poses, chosen.eaik)
    scan_check()
