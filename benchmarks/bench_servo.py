"""Speed of the simulated servo (goal: 30 times real time at 1 kHz), of the plant alone, of MuJoCo, and of arm files.

Run: OMP_NUM_THREADS=1 python benchmarks/bench_servo.py. Best of five runs. MuJoCo and mink are measured in the same run
when they are installed.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from surfuse.arm_models.puma560 import FLANGE_OFFSET_M, LIMITS, READY_RAD, Puma560
from surfuse.commands.servo.servo_study import LAWS
from surfuse.geometry.poses import pose
from surfuse.motion.planners import trapezoidal
from surfuse.rig.simulated.assembly import SimulatedClock
from surfuse.rig.simulated.servo_arm import ServoDesign, Unknown, build_servo_arm, known_model, true_dynamics
from surfuse.twin.dynamics.plant import ArmPlant

KINEMATICS = Puma560(np.eye(4), pose(np.eye(3), [0.0, 0.0, 0.08 - FLANGE_OFFSET_M]))
TARGET = READY_RAD + np.radians([20.0, -10.0, 5.0, 8.0, -3.0, 30.0])
SIX = """<mujoco><compiler angle="degree"/><worldbody>
<body pos="0 0 .16"><joint axis="0 0 1" range="-180 180"/><geom size=".05"/>
<body pos="0 .13 0"><joint axis="0 1 0" range="-190 10"/><geom size=".05"/>
<body pos=".43 -.12 0"><joint axis="0 1 0" range="-160 160"/><geom size=".05"/>
<body pos=".39 0 0"><joint axis="0 1 0" range="-180 180"/><geom size=".05"/>
<body pos="0 .1 0"><joint axis="0 0 -1" range="-180 180"/><geom size=".05"/>
<body pos="0 0 -.1"><joint axis="0 1 0" range="-180 180"/><geom size=".03"/><site name="flange" pos="0 .08 0"/>
</body></body></body></body></body></body></worldbody></mujoco>"""


def best_s(call: Callable[[], object], runs: int = 5) -> float:
    """Shortest processor time of several runs, after one that compiles."""
    call()
    times = []
    for _ in range(runs):
        began = time.process_time()
        call()
        times.append(time.process_time() - began)
    return min(times)


def servo(law: str) -> float:
    """Simulated seconds per second of a move through cards, law and plant."""
    parts = build_servo_arm(
        KINEMATICS,
        SimulatedClock(),
        np.random.default_rng(0),
        ServoDesign(law, trapezoidal(LIMITS), calibrated_at_start=False),
    )
    with parts.arm as arm:
        there = parts.law.commands(trapezoidal(LIMITS)(READY_RAD, TARGET))
        back = parts.law.commands(trapezoidal(LIMITS)(TARGET, READY_RAD))

        def both() -> None:
            arm.servo.run(there)
            arm.servo.run(back)

        return (len(there) + len(back)) * parts.law.period_s / best_s(both)


def plants() -> None:
    """The plant alone, and MuJoCo's, under the same torques at a step of 0.25 ms."""
    dynamics = true_dynamics(Unknown())
    hold = dynamics.gravity(READY_RAD)
    torques = [hold + np.array([30.0, 5.0, 5.0, 1.5, 1.5, 1.0]) * np.sin(i / 40.0) for i in range(500)]
    plant = ArmPlant(dynamics, READY_RAD, LIMITS.lower_rad, LIMITS.upper_rad)
    plant.brakes_on = False

    def own() -> None:
        plant.rest_at(READY_RAD)
        for torque in torques:
            plant.step(torque, 1e-3)

    print(f"plant alone: {0.5 / best_s(own):.0f} times real time")
    try:
        from surfuse.twin.dynamics.mujoco_arm import MujocoArm
    except ImportError:
        print("MuJoCo: not installed")
        return
    engine = MujocoArm(dynamics, LIMITS)

    def theirs() -> None:
        engine.set_state(READY_RAD, np.zeros(6))
        for torque in torques:
            engine.step(torque, 1e-3)

    print(f"MuJoCo alone: {0.5 / best_s(theirs):.0f} times real time")


def arm_files() -> None:
    """Inverse kinematics of an arm file near a known posture: own damped least squares against mink."""
    try:
        import mujoco

        from surfuse.arm_models import model_file
        from surfuse.arm_models.screw_chain import solve
    except ImportError:
        print("arm files: MuJoCo is not installed")
        return
    path = Path(tempfile.mkdtemp()) / "arm.xml"
    path.write_text(SIX)
    arm = model_file.create(path, "flange", np.eye(4), np.eye(4))
    rng = np.random.default_rng(0)
    middle, half = 0.5 * (arm.lower_rad + arm.upper_rad), 0.35 * (arm.upper_rad - arm.lower_rad)
    joints = middle + half * rng.uniform(-1.0, 1.0, (200, 6))
    targets, starts = arm.forward(joints), joints + rng.normal(0.0, 0.1, joints.shape)
    chain = arm.screw_arguments

    def own() -> int:
        return sum(solve(*chain, target, start.copy()) for target, start in zip(targets, starts, strict=True))

    print(f"damped least squares: {1e6 * best_s(own) / 200:.1f} us a pose, {own()} of 200 found")
    try:
        import mink
    except ImportError:
        print("mink: not installed")
        return
    configuration = mink.Configuration(mujoco.MjModel.from_xml_path(str(path)))
    task = mink.FrameTask("flange", "site", 1.0, 1.0)
    limits = [mink.ConfigurationLimit(configuration.model)]

    def theirs() -> int:
        found = 0
        for target, start in zip(targets, starts, strict=True):
            configuration.update(start)
            task.set_target(mink.SE3.from_matrix(target))
            for _ in range(30):
                speed = mink.solve_ik(configuration, [task], 1.0, "daqp", limits=limits, damping=1e-9)
                configuration.integrate_inplace(speed, 1.0)
                if np.abs(task.compute_error(configuration)).max() < 1e-8:
                    found += 1
                    break
        return found

    print(f"mink: {1e6 * best_s(theirs, 2) / 200:.1f} us a pose, {theirs()} of 200 found")


if __name__ == "__main__":
    print(f"inertia of the model at the ready posture: {np.diag(known_model().inertia(READY_RAD)).round(3)}")
    for name in LAWS:
        print(f"servo with {name}: {servo(name):.0f} times real time")
    plants()
    arm_files()
