"""Readings a second of the twin on one core, every reading with at least 512 rays and 5 pings.

OMP_NUM_THREADS=1 python benchmarks/bench_twin.py
"""

from __future__ import annotations

import time

import numpy as np
import trimesh

from surfuse.geometry.poses import pose
from surfuse.sensors import polaroid
from surfuse.twin.materials import Material
from surfuse.twin.parts import make_part
from surfuse.twin.scene import Scene, SceneBody, table_bodies
from surfuse.twin.world import Twin

READINGS = 1500
ROUNDS = 3
LOOK = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def wavy_body(side: int = 100) -> SceneBody:
    """A sheet of 2 side^2 triangles, 0.2 x 0.2 m, waves of 5 mm, where the flat part stands."""
    u, v = np.meshgrid(np.linspace(-0.1, 0.1, side + 1), np.linspace(0.0, 0.2, side + 1))
    wave = 0.005 * np.sin(60.0 * u) * np.cos(50.0 * v)
    vertices = np.column_stack([1.11 + wave.ravel(), -u.ravel(), 1.0 + v.ravel()])
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)[None, :]).ravel()
    faces = np.vstack(
        [
            np.column_stack([corner, corner + 1, corner + side + 2]),
            np.column_stack([corner, corner + side + 2, corner + side + 1]),
        ]
    )
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    return SceneBody(np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64), Material.PART, np.eye(4))


def rate(scene: Scene) -> tuple[float, float]:
    """Readings per second of wall time and of processor time, best of the rounds."""
    twin = Twin(scene, seed=1)
    generator = np.random.default_rng(0)
    places = generator.uniform([0.66, -0.12, 1.0], [0.68, 0.12, 1.22], (READINGS, 3))
    poses = [pose(LOOK, place) for place in places]
    for there in poses[:20]:
        twin.ping(there, polaroid.SPEC, 5, 0.0)
    best_wall, best_cpu = 0.0, 0.0
    for _ in range(ROUNDS):
        wall, cpu = time.perf_counter(), time.process_time()
        for index, there in enumerate(poses):
            twin.begin("bench", index)
            twin.ping(there, polaroid.SPEC, 5, 0.0)
        best_wall = max(best_wall, READINGS / (time.perf_counter() - wall))
        best_cpu = max(best_cpu, READINGS / (time.process_time() - cpu))
    return best_wall, best_cpu


def main() -> None:
    """Print one row a scene."""
    cell = table_bodies()
    scenes = {name: Scene([*cell, make_part(name).body]) for name in ("flat", "tilted", "relief")}
    scenes["20,000 triangles"] = Scene([*cell, wavy_body()])
    print(f"{'scene':18s}{'triangles':>10s}{'readings/s':>12s}{'per CPU s':>12s}")
    for name, scene in scenes.items():
        wall, cpu = rate(scene)
        print(f"{name:18s}{len(scene.triangles):10d}{wall:12.0f}{cpu:12.0f}")


if __name__ == "__main__":
    main()
