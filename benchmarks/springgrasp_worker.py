"""Plan grasps with SpringGrasp; run by bench_springgrasp.py in SpringGrasp's own interpreter.

    python springgrasp_worker.py SPRINGGRASP_FOLDER JOB.json RESULT.json

The job names points in SpringGrasp's world, whose table is at `TABLE`, friction, the number of
iterations and a seed. The result has one grasp for each of SpringGrasp's initial palm poses.
Settings and their order are those of its optimize_pregrasp.py, which also opens windows and is
therefore not called. Nothing of lis_grasp is imported.
"""

from __future__ import annotations

import json
import os
import sys
import time
import types
from pathlib import Path

# Height [m] of the floor to which its process_pcd.py projects points, to close an object below.
TABLE = 0.013
# optimize_pregrasp.py: points, their noise, points inside and outside, and their noise.
_MOST_POINTS = 200
_DATA_NOISE, _INSIDE_NOISE, _OUTSIDE_NOISE = 0.005, 0.05, 0.2
_INSIDE_POINTS, _INSIDE_VALUE = 50, -0.3
_LEAST_BOUND, _MARGIN = 0.1, 0.01
_SPRINGS = (80.0, 80.0, 80.0, 160.0)  # initial compliance [N/m]
_MASS = 0.5  # its default; without gravity, also its default, it is not used
_CONTACT = 0.7  # of the way from target to pregrasp: where it plans the contact
_FIRST_KEPT = 21  # iteration after which SpringGrasp keeps the best


def main() -> int:
    folder, job_file, result_file = (Path(name).absolute() for name in sys.argv[1:4])
    job = json.loads(job_file.read_text())
    os.chdir(folder)
    sys.path[:0] = [str(folder), str(folder / "thirdparty/differentiable-robot-model")]
    # Used by its planners on meshes only, and made for CUDA.
    stub = types.ModuleType("torchsdf")
    stub.compute_sdf = None
    sys.modules["torchsdf"] = stub
    try:
        import spring_grasp_planner.optimizers  # noqa: F401
    except ImportError as error:
        print(f"SpringGrasp cannot be imported from {folder}: {error}", file=sys.stderr)
        return 1
    import torch

    torch.set_num_threads(1)
    plan(job | {"iterations": 1})  # a warm-up
    result_file.write_text(json.dumps(plan(job)))
    return 0


def plan(job: dict) -> dict:
    import numpy as np
    import torch
    from spring_grasp_planner.initial_guesses import WRIST_OFFSET
    from utils import robot_configs

    torch.manual_seed(job["seed"])
    points = np.array(job["points"])
    cpu, wall = time.process_time(), time.perf_counter()
    points = np.vstack([points, points * [1.0, 1.0, 0.0] + [0.0, 0.0, TABLE]])
    if len(points) > _MOST_POINTS:
        import open3d

        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
        points = np.asarray(cloud.farthest_point_down_sample(_MOST_POINTS).points)
    center = (points.min(axis=0) + points.max(axis=0)) / 2.0
    surface = fit(points, center)
    palms = WRIST_OFFSET.copy()
    palms[:, :3] += center * [1.0, 1.0, 2.0]
    config = robot_configs["allegro"]
    optimizer = optimizer_class()(
        "assets/allegro_hand/allegro_hand_description_left.urdf",
        ee_link_names=config["ee_link_name"],
        ee_link_offsets=config["ee_link_offset"].tolist(),
        anchor_link_names=config["collision_links"],
        anchor_link_offsets=config["collision_offsets"].tolist(),
        collision_pairs=config["collision_pairs"],
        ref_q=config["ref_q"].tolist(),
        optimize_target=True,
        optimize_palm=True,
        num_iters=job["iterations"],
        palm_offset=palms,
        mass=_MASS,
        com=center,
        gravity=False,
    )
    count = len(palms)
    q = torch.tensor(config["ref_q"].tolist()).unsqueeze(0).double().repeat(count, 1)
    springs = torch.tensor([_SPRINGS]).repeat(count, 1)
    tips = optimizer.forward_kinematics(q, torch.from_numpy(palms))
    middle = tips.mean(dim=1, keepdim=True)
    targets = middle + 0.3 * (tips - middle)
    q, springs, targets, palms, margins, _, _ = optimizer.optimize(
        q, targets, springs, job["friction"], surface, verbose=False
    )
    tips = optimizer.forward_kinematics(q, palms)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    contacts = targets + _CONTACT * (tips - targets)
    normals = surface.compute_normal(contacts)
    found = {
        "joint_positions": q,
        "springs": springs,
        "targets": targets,
        "palms": palms,
        "margins": margins,
        "tips": tips,
        "contacts": contacts,
        "normals": normals,
        "costs": optimizer.best,
    }
    return {name: value.detach().tolist() for name, value in found.items()} | {
        "cpu": cpu,
        "wall": wall,
    }


def fit(points, center):
    """Return SpringGrasp's Gaussian process implicit surface of points, as optimize_pregrasp.py."""
    import numpy as np
    import torch
    from gpis.gpis import GPIS

    extent = points.max(axis=0) - points.min(axis=0)
    bound = max(extent.max() / 2.0 + _MARGIN, _LEAST_BOUND)
    corners = [[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)]
    faces = [[-1, 0, 0], [0, -1, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1]]
    outside = torch.from_numpy(bound * np.array(corners + faces, dtype=float) + center)
    data = torch.from_numpy(points)
    weights = torch.softmax(torch.rand(_INSIDE_POINTS, len(data)).double() * 100, dim=1)
    groups = (
        (outside, bound, _OUTSIDE_NOISE),
        (data, 0.0, _DATA_NOISE),
        (weights @ data, bound * _INSIDE_VALUE, _INSIDE_NOISE),
    )
    surface = GPIS(0.08, 1)
    surface.fit(
        torch.vstack([group for group, _, _ in groups]),
        torch.vstack([torch.full((len(group), 1), value).double() for group, value, _ in groups]),
        noise=torch.cat([torch.full((len(group),), noise).double() for group, _, noise in groups]),
    )
    return surface


def optimizer_class() -> type:
    """Return SpringGrasp's optimiser, which also keeps the cost of the grasps that it returns."""
    import torch
    from spring_grasp_planner.optimizers import SpringGraspOptimizer

    class Optimizer(SpringGraspOptimizer):
        iteration, best = 0, None

        def closure(self, *arguments, **options):
            loss = super().closure(*arguments, **options)
            total = self.total_loss.detach()
            if self.best is None:
                self.best = torch.full_like(total, torch.inf)
            if self.iteration >= _FIRST_KEPT:
                self.best = torch.minimum(self.best, total)
            self.iteration += 1
            return loss

    return Optimizer


if __name__ == "__main__":
    sys.exit(main())
