"""Accuracy and speed of touches: random probes of built-in objects.

    python benchmarks/bench_touch.py --probes 150
    python benchmarks/bench_touch.py --free          # displacement of free objects by touches

Probes aim at points drawn uniformly from the true surface (0.20 m objects), along directions up to
40 degrees off the inward normal. Errors are to the object's own triangle mesh; normals are
evaluated more than 3 mm from any sharp edge.
"""

import time

import numpy as np

from lis_grasp import Hand, pipeline, shapes
from lis_grasp.evaluation.surface_error import sample_segments
from lis_grasp.exploration import Probe
from lis_grasp.io.json_lines import Row
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.shapes import Shape
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.simulation.drake.dynamic_prober import DynamicProber
from lis_grasp.typing import FloatArray
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.tables import grouped_table, mean_cell

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


def touch_free_object(name: str, hand: Hand) -> Row:
    """Explore an object of graspable size, free on a table: 0.2 kg, friction 0.5."""
    shape = shapes.build(name, None)
    config = pipeline.RunConfig(object=name, free=True, touches=30, mass=0.2, friction=0.5)
    start = time.perf_counter()
    outcomes = pipeline.touch(pipeline.Scenario.from_config(config, shape, hand)).outcomes
    seconds = time.perf_counter() - start
    moved = [o.moved for o in outcomes if o.status == "touched" or o.moved > 0.0]
    toppled = _topplings([o.simulated_pose for o in outcomes if o.simulated_pose is not None])
    return spread("moved", moved) | {"n": len(moved), "toppled": toppled, "seconds": seconds}


def _topplings(poses: list[FloatArray]) -> int:
    """Return how many touches tilted the object by more than 5 degrees."""
    up = np.array([[0.0, 0.0, 1.0], *(X[:3, 2] for X in poses)])
    return int(np.sum(np.sum(up[1:] * up[:-1], axis=1) < np.cos(np.deg2rad(5.0))))


def spread(name: str, values: FloatArray | list[float]) -> Row:
    """Return the mean, median, 95 % quantile and maximum of values."""
    functions = {"mean": np.mean, "median": np.median, "max": np.max}
    row = {f"{name}_{key}": float(function(values)) for key, function in functions.items()}
    return row | {f"{name}_95": float(np.quantile(values, 0.95))}


def probe_object(name: str, hand: Hand, count: int, prober_name: str) -> Row:
    make = KinematicProber if prober_name == "kinematic" else DynamicProber
    shape = shapes.build(name, size=shapes.PAPER_SIZE)
    prober = make(hand, shape.mesh)
    probes = random_probes(shape, count, np.random.default_rng(0))
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
    statuses = {s: sum(o.status == s for o in outcomes) for s in ("touched", "missed", "blocked")}
    return statuses | spread("position", off) | spread("angle", angle) | {"rate": rate}


def main() -> None:
    defaults = {"probes": 150, "hand": "allegro", "prober": "dynamic", "free": False}
    options = read_options(__doc__, **defaults)
    hand = Hand.load(options.hand)
    if options.free:
        groups = {name: [touch_free_object(name, hand)] for name in shapes.NAMES}
        columns = [("touches", mean_cell("n", digits=0))]
        columns += [
            (f"moved [mm] {key}", mean_cell(f"moved_{key}", 1e3, 4))
            for key in ("median", "95", "max")
        ]
        columns += [("toppled", mean_cell("toppled", digits=0)), ("wall [s]", mean_cell("seconds"))]
    else:
        groups = {
            name: [probe_object(name, hand, options.probes, options.prober)]
            for name in shapes.NAMES
        }
        columns = [(s, mean_cell(s, digits=0)) for s in ("touched", "missed", "blocked")]
        columns += [
            (f"position [mm] {key}", mean_cell(f"position_{key}", 1e3, 3))
            for key in ("mean", "95", "max")
        ]
        columns += [
            (f"normal [deg] {key}", mean_cell(f"angle_{key}", digits=2)) for key in ("mean", "95")
        ]
        columns += [("probes/s", mean_cell("rate", digits=0))]
    groups["all"] = [row for rows in groups.values() for row in rows]
    print(grouped_table("touches", "Touches", "object", groups, columns).text())


if __name__ == "__main__":
    main()
