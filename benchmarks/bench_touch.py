"""Accuracy and speed of touches: random probes of built-in objects.

    python benchmarks/bench_touch.py --probes 150
    python benchmarks/bench_touch.py --free          # displacement of free objects by touches

Probes aim at points drawn uniformly from the true surface (0.20 m objects), along directions up to
40 degrees off the inward normal. Errors are to the object's own triangle mesh; normals are
evaluated more than 3 mm from any sharp edge.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from lis_grasp import Hand, pipeline, shapes
from lis_grasp.evaluation.surface_samples import sample_segments
from lis_grasp.exploration import Probe
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.shapes import Shape
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.simulation.drake.dynamic_prober import DynamicProber
from lis_grasp.typing import FloatArray

_TILT = np.deg2rad(40.0)


def random_probes(shape: Shape, count: int, rng: np.random.Generator) -> list[Probe]:
    mesh = shape.mesh
    faces = rng.choice(len(mesh.faces), size=count, p=mesh.area_faces / mesh.area)
    weights = rng.dirichlet(np.ones(3), size=count)
    points = (mesh.triangles[faces] * weights[:, :, None]).sum(axis=1)
    probes = []
    for point, normal in zip(points, mesh.face_normals[faces], strict=True):
        side = np.cross(normal, rng.normal(size=3))
        tilt = rng.uniform(0.0, _TILT)
        direction = -np.cos(tilt) * normal + np.sin(tilt) * side / np.linalg.norm(side)
        probes.append(Probe(point, direction, standoff=0.03, overshoot=0.03))
    return probes


def print_free_objects(hand: Hand) -> None:
    """Explore each object of graspable size, free on a table: 0.2 kg, friction 0.5."""
    print(f"{'object':16s} touches  moved [mm] median   95 %   max  toppled  wall [s]")
    moved: list[float] = []
    toppled = 0
    for name in shapes.NAMES:
        shape = shapes.build(name, None)
        config = pipeline.RunConfig(object=name, free=True, touches=30, mass=0.2, friction=0.5)
        start = time.perf_counter()
        outcomes = pipeline.touch(pipeline.Scenario.from_config(config, shape, hand)).outcomes
        seconds = time.perf_counter() - start
        own = [o.moved for o in outcomes if o.status == "touched" or o.moved > 0.0]
        fallen = _topplings([o.simulated_pose for o in outcomes if o.simulated_pose is not None])
        moved, toppled = moved + own, toppled + fallen
        median, high = 1e3 * np.quantile(own, [0.5, 0.95])
        print(
            f"{name:16s} {len(own):7d} {median:18.4f} {high:6.3f} {1e3 * max(own):5.2f}"
            f" {fallen:8d} {seconds:9.1f}",
            flush=True,
        )
    print(f"{'all':16s} {len(moved):7d} {1e3 * np.median(moved):18.4f} {'':12s} {toppled:8d}")


def _topplings(poses: list[FloatArray]) -> int:
    """Return how many touches tilted the object by more than 5 degrees."""
    up = np.array([[0.0, 0.0, 1.0], *(X[:3, 2] for X in poses)])
    return int(np.sum(np.sum(up[1:] * up[:-1], axis=1) < np.cos(np.deg2rad(5.0))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--probes", type=int, default=150)
    parser.add_argument("--hand", default="allegro")
    parser.add_argument("--prober", choices=["dynamic", "kinematic"], default="dynamic")
    parser.add_argument("--free", action="store_true", help="objects are free on a table")
    arguments = parser.parse_args()
    hand = Hand.load(arguments.hand)
    if arguments.free:
        print_free_objects(hand)
        return
    make = KinematicProber if arguments.prober == "kinematic" else DynamicProber
    print(f"{'object':16s} touched missed blocked  position [mm] mean  95 %   max", end="")
    print("  normal [deg] mean  95 %  probes/s")
    for name in shapes.NAMES:
        shape = shapes.build(name, size=shapes.PAPER_SIZE)
        prober = make(hand, shape.mesh)
        probes = random_probes(shape, arguments.probes, np.random.default_rng(0))
        start = time.perf_counter()
        outcomes = [prober.probe(probe) for probe in probes]
        rate = len(probes) / (time.perf_counter() - start)
        touched = [outcome.contacts for outcome in outcomes if len(outcome.contacts)]
        points = np.vstack([contacts.points for contacts in touched])
        normals = np.vstack([contacts.normals for contacts in touched])
        off, faces = distances_to_mesh(points, shape.mesh)
        cosine = (shape.mesh.face_normals[faces] * normals).sum(axis=1)
        angle = np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))
        if len(shape.edges):
            edge_points = sample_segments(shape.edges, 5000)
            gap = np.linalg.norm(points[:, None] - edge_points, axis=-1).min(axis=1)
            angle = angle[gap > 0.003]
        counts = [sum(o.status == s for o in outcomes) for s in ("touched", "missed", "blocked")]
        print(
            f"{name:16s} {counts[0]:7d} {counts[1]:6d} {counts[2]:7d}"
            f" {1e3 * off.mean():18.3f} {1e3 * np.quantile(off, 0.95):5.3f} {1e3 * off.max():5.3f}"
            f" {angle.mean():18.2f} {np.quantile(angle, 0.95):5.2f} {rate:9.0f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
