"""Speed of grasp planning on one core: rates of each step, and the time to a grasp.

    OMP_NUM_THREADS=1 python benchmarks/bench_grasp.py

Times are processor seconds, which depend less on other work of the machine.
"""

import time
from collections.abc import Callable
from functools import partial

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from lis_grasp import ForceClosureSampler, Hand, epsilon_quality, is_force_closure, shapes
from lis_grasp.geometry import make_pose, unit
from lis_grasp.grasping.contact_wrenches import WrenchModel
from lis_grasp.grasping.epsilon import epsilon_by_expanding_polytope
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.pose_filter import HandPoseFilter
from lis_grasp_studies.harness.program import read_options


def main() -> None:
    options = read_options(__doc__, searches=10)  # of each object and hand
    rng = np.random.default_rng(0)
    qualities(rng)
    poses(rng)
    antipodal(rng)
    for hand_name in ("allegro", "wsg50", "barrett"):
        searches(Hand.load(hand_name), options.searches)


def qualities(rng: np.random.Generator) -> None:
    normals = unit(rng.normal(size=(1024, 4, 3)))
    points = normals * rng.uniform(0.5, 1.5, size=(1024, 4, 1))
    for edges in (8, 4):
        model = WrenchModel(friction=0.8, edges=edges)
        seconds = timed(lambda m=model: epsilon_by_expanding_polytope(points, normals, m))
        rate = f"{1024 / seconds:.0f} a second"
        print(f"epsilon, 4 contacts, pyramids of {edges} edges, batched: {rate}")
    for name, one in (("epsilon", epsilon_quality), ("force closure", is_force_closure)):
        pairs = list(zip(points[:100], normals[:100], strict=True))
        seconds = timed(lambda pairs=pairs, one=one: [one(p, n, friction=0.8) for p, n in pairs])
        print(f"{name}, 4 contacts, one after the other: {100 / seconds:.0f} a second")


def poses(rng: np.random.Generator) -> None:
    mesh = shapes.build("mallet").mesh
    for name in ("allegro", "wsg50"):
        hand = Hand.load(name)
        start = time.process_time()
        pose_filter = HandPoseFilter(hand, mesh)
        made = time.process_time() - start
        R = Rotation.random(20_000, random_state=rng).as_matrix()
        X = make_pose(R, rng.normal(scale=0.1, size=(len(R), 3)))
        q = next(iter(hand.pregrasps.values()))
        seconds = timed(partial(pose_filter.collides, X, q))
        rejected = pose_filter.collides(X, q)
        checker = HandCollisionChecker(hand, mesh)
        touching = np.array([checker.touches_object(pose, q) for pose in X[:2000]])
        found = (rejected[:2000] & touching).sum() / touching.sum()
        print(
            f"poses of {name} filtered: {len(X) / seconds:.0f} a second, after {1e3 * made:.0f} ms;"
            f" of those that collide {found:.0%} are rejected, of others"
            f" {(rejected[:2000] & ~touching).sum()}"
        )


def antipodal(rng: np.random.Generator) -> None:
    """Time collision checks of a parallel-jaw gripper against a mesh of about 10 000 triangles."""
    mesh = trimesh.creation.uv_sphere(0.04, count=(50, 50))
    mesh.apply_scale([1.0, 0.7, 1.3])
    hand = Hand.load("wsg50")
    checker = HandCollisionChecker(hand, mesh)
    R = Rotation.random(2000, random_state=rng).as_matrix()
    center_H = hand.pad_centers(np.eye(4), hand.upper).mean(axis=0)
    X = make_pose(R, rng.normal(scale=0.02, size=(len(R), 3)) - R @ center_H)
    seconds = timed(lambda: [checker.first_collision(pose, hand.upper) for pose in X])
    print(
        f"gripper poses checked by FCL, every link, {len(mesh.faces)} triangles:"
        f" {len(X) / seconds:.0f} a second"
    )


def searches(hand: Hand, count: int) -> None:
    seconds: list[float] = []
    none = 0
    for name in shapes.NAMES:
        mesh = shapes.build(name).mesh
        for seed in range(count):
            start = time.process_time()
            search = ForceClosureSampler(hand).sample(
                mesh,
                rng=np.random.default_rng(seed),
                support_height=mesh.bounds[0, 2],
                count=1,
            )
            seconds.append(time.process_time() - start)
            none += not search.grasps
    low, middle, high = np.percentile(seconds, [25, 50, 75])
    print(
        f"time to a grasp of {hand.name}, in force closure and free of collision: median"
        f" {middle:.2f} s (quartiles {low:.2f} to {high:.2f}, longest {max(seconds):.2f});"
        f" none found in {none} of {len(seconds)} searches"
    )


def timed(work: Callable[[], object]) -> float:
    """Return the shortest processor time of three calls [s]."""
    times = []
    for _ in range(3):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


if __name__ == "__main__":
    main()
