"""A scan in the simulated cell, from Python, against the truth that only the twin knows."""

import surfuse as sf

# A coarse scan of a plate leaning by 20 degrees, without servo cards: a second or two.
run = sf.acquire(
    "tilted",
    out="runs/tilted",
    seed=1,
    settings={"scan.step_m": 0.03, "arm.driver": "kinematic"},
)
print(f"{run.summary['stops']} stops, {run.summary['robot_time_s']:.0f} s of the robot's time, in {run.path}")

score = sf.evaluate(run.surface, truth=run.path / "truth.ply")
print(f"by {run.surface.method}: RMSE {score.rmse_mm:.2f} mm over {score.cells} cells")

# The same readings by the method of the paper.
again = sf.evaluate(sf.fuse(run.log, "weighted_average"), truth=run.path / "truth.ply")
print(f"by weighted_average: RMSE {again.rmse_mm:.2f} mm")
