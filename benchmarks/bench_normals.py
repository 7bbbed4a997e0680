"""Errors of estimated normals on the built-in shapes, and coverage of their stated deviations.

    python benchmarks/bench_normals.py --points 20 50 100 200

Compares the posterior of a smooth closed surface, with and without directions of approach, with
planes of neighbours whose signs are propagated (Hoppe et al. 1992).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import trimesh
from threadpoolctl import threadpool_limits

from lis_grasp import shapes
from lis_grasp.exceptions import EstimationError
from lis_grasp.geometry import angle_between, tangent_frame, unit
from lis_grasp.surfaces import estimate_normals

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from reference import hoppe_normals

METHODS = ("points only", "with approach", "planes")


def scores(errors: np.ndarray, estimated: np.ndarray, true: np.ndarray, noise: np.ndarray):
    """Return errors along two directions across each normal, in stated deviations."""
    first, second = np.moveaxis(tangent_frame(estimated), 1, 0)
    across = np.stack([np.sum(true * first, axis=1), np.sum(true * second, axis=1)])
    return np.abs(across) * errors / np.maximum(np.sin(errors), 1e-9) / noise


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--points", type=int, nargs="+", default=[20, 50, 100, 200])
    parser.add_argument("--noise", type=float, nargs="+", default=[0.0, 0.003], help="[m]")
    parser.add_argument("--seeds", type=int, default=2)
    options = parser.parse_args()
    print(
        "points  noise [mm]  mean error [deg]: "
        + ", ".join(METHODS)
        + "; refused; within 1, 1.96 sd"
    )
    for count in options.points:
        for noise in options.noise:
            errors: dict[str, list[float]] = {method: [] for method in METHODS}
            covered: dict[str, list[np.ndarray]] = {method: [] for method in METHODS[:2]}
            refused = 0
            for number, name in enumerate(shapes.NAMES):
                mesh = shapes.build(name).mesh
                for seed in range(options.seeds):
                    rng = np.random.default_rng([number, seed, count])
                    points, faces = trimesh.sample.sample_surface(mesh, count, seed=rng)
                    normals = mesh.face_normals[faces]
                    points = points + noise * rng.normal(size=points.shape)
                    sphere = unit(rng.normal(size=normals.shape))
                    approach = sphere - (1.0 + 1e-9) * normals  # cosine law about the inward normal
                    for method, evidence in zip(METHODS[:2], (None, approach), strict=True):
                        try:
                            found = estimate_normals(points, approach=evidence)
                        except EstimationError:
                            refused += 1
                            continue
                        error = angle_between(found.normals, normals)
                        errors[method].append(np.degrees(error.mean()))
                        covered[method].append(
                            scores(error, found.normals, normals, found.normal_noise).ravel()
                        )
                    error = angle_between(hoppe_normals(points), normals)
                    errors["planes"].append(np.degrees(error.mean()))
            means = "  ".join(f"{np.mean(errors[method]):5.1f}" for method in METHODS)
            pooled = [np.concatenate(covered[method]) for method in METHODS[:2]]
            bands = "  ".join(f"{np.mean(s < 1):.2f} {np.mean(s < 1.96):.2f}" for s in pooled)
            print(f"{count:6d}  {1e3 * noise:4.1f}  {means}  {refused}  {bands}", flush=True)


if __name__ == "__main__":
    with threadpool_limits(1):
        main()
