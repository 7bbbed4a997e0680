"""Errors of estimators on contacts of a real robot's fingertips (iCub), against scanned models.

    python benchmarks/bench_real_touches.py FOLDER [--pair SET=MODEL ...]

FOLDER has measurements/*.off (points only, in the robot's root frame) and models/*.off; the page
docs/real-touches.md says where to get it. The object's pose is unknown: the points are fitted to
the model (iterative closest points from many starts), for scoring only. Errors are root mean
squares within 30 mm of a contact, in millimetres: estimate to truth / truth to estimate.
"""

import time
from dataclasses import replace
from pathlib import Path

import igl
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from lis_grasp import Contacts, extract_mesh, surface_error
from lis_grasp.exceptions import LisGraspError
from lis_grasp.geometry import angle_between, apply_pose, make_pose
from lis_grasp.shapes import Shape
from lis_grasp.surfaces import ESTIMATORS, estimate_normals, load_contacts
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.runner import single_thread
from lis_grasp_studies.harness.tables import Table

MODELS = {"measCleaner_exp": "cleaner", "measRobot_exp": "robot"}
EXPLORED = 0.03
NOISE = 0.007  # of the points [m]: what the best rigid fit to the models leaves
NORMAL_NOISE = np.deg2rad(15.0)  # of normals taken from the model
STARTS, ROUNDS = 60, 80


def fit_pose(points: np.ndarray, mesh: trimesh.Trimesh) -> tuple[np.ndarray, float]:
    """Return the rigid pose (4, 4) that brings points next to a mesh, and the rms left [m]."""
    best, least = np.eye(4), np.inf
    for turn in Rotation.random(STARTS, rng=np.random.default_rng(0)):
        R = turn.as_matrix()
        pose = make_pose(R, mesh.centroid - R @ points.mean(axis=0))
        previous = np.inf
        for _ in range(ROUNDS):
            moved = apply_pose(pose, points)
            squares, _, closest = igl.point_mesh_squared_distance(moved, mesh.vertices, mesh.faces)
            rms = float(np.sqrt(squares.mean()))
            if previous - rms < 1e-7:
                break
            previous = rms
            pose, _, _ = trimesh.registration.procrustes(
                points, closest, reflection=False, scale=False
            )
        if rms < least:
            best, least = pose, rms
    return best, least


def normals_of_model(points: np.ndarray, mesh: trimesh.Trimesh) -> np.ndarray:
    _, faces, _ = igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces)
    return np.asarray(mesh.face_normals[faces])


def main() -> None:
    options = read_options(
        __doc__,
        folder=Path,
        estimators=list(ESTIMATORS),
        pair=[f"{name}={model}" for name, model in MODELS.items()],
    )
    pairs = dict(pair.split("=") for pair in options.pair)
    body: list[tuple[str, ...]] = []
    for name, model in pairs.items():
        mesh = trimesh.load(options.folder / "models" / f"{model}.off")
        estimated = load_contacts(
            options.folder / "measurements" / f"{name}.off", position_noise=NOISE
        )
        pose, rms = fit_pose(estimated.points, mesh)
        points = apply_pose(pose, estimated.points)
        true_normals = normals_of_model(points, mesh)
        noise = np.full(len(points), NOISE)
        estimated = estimate_normals(points, position_noise=noise)
        angle = np.degrees(angle_between(estimated.normals, true_normals))
        stated = np.degrees(np.median(estimated.normal_noise))
        print(
            f"{name}: {len(points)} points, {1e3 * rms:.1f} mm rms from {model}.off; estimated"
            f" normals {angle.mean():.0f} deg off (median {np.median(angle):.0f}), stated"
            f" {stated:.0f} deg"
        )
        truth = Shape.from_mesh(mesh, model)
        variants = {
            "estimated": estimated,
            "estimated, noise unsaid": replace(estimated, position_noise=None, normal_noise=None),
            "of the model": Contacts(
                points,
                true_normals,
                position_noise=noise,
                normal_noise=np.full(len(points), NORMAL_NOISE),
            ),
        }
        for kind, contacts in variants.items():
            cells = []
            for estimator in options.estimators:
                start = time.perf_counter()
                try:
                    surface = ESTIMATORS[estimator](contacts)
                    seconds = time.perf_counter() - start
                    found = extract_mesh(surface)
                    error = surface_error(found, truth, contacts, explored_radius=EXPLORED)
                except LisGraspError as failure:
                    cells.append(f"failed: {failure}")
                    continue
                both = 1e3 * error.rmsd, 1e3 * error.rmsd_truth_to_estimate
                cells.append(f"{both[0]:.1f} / {both[1]:.1f} ({seconds:.1f})")
            body.append((name, kind, *cells))
    title = "rms [mm] within 30 mm of a contact: estimate to truth / truth to estimate (seconds)"
    head = ("set", "normals", *options.estimators)
    print(Table("real_touches", title, head, tuple(body)).text())


if __name__ == "__main__":
    with single_thread():
        main()
