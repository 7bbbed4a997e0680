"""Time and outcome of simulated lifts: the best grasps planned on the true built-in shapes.

python benchmarks/bench_lift.py [--hand allegro] [--seeds 1] [--best 1] [--masses 0.1,0.2,0.5]
"""

from __future__ import annotations

import argparse
import time
from collections import Counter

import numpy as np

from lis_grasp import ForceClosureSampler, Hand, shapes
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.robots.shipped_models import HAND_NAMES
from lis_grasp.simulation.drake.lift import simulate_lift


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hand", default=HAND_NAMES[0])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--best", type=int, default=1, help="grasps to try of each search")
    parser.add_argument("--masses", default="0.2", help="[kg], separated by commas")
    options = parser.parse_args()
    hand = Hand.load(options.hand)
    masses = [float(mass) for mass in options.masses.split(",")]
    reasons: dict[float, Counter[str]] = {mass: Counter() for mass in masses}
    seconds = []
    for name in shapes.NAMES:
        mesh = shapes.build(name).mesh
        support_height = float(mesh.bounds[0, 2])
        for seed in range(options.seeds):
            search = ForceClosureSampler(hand).sample(
                mesh, rng=np.random.default_rng(seed), support_height=support_height
            )
            if not search.grasps:
                print(f"{name:16} seed {seed}  no grasp: {dict(search.rejections)}", flush=True)
            for rank, grasp in enumerate(search.grasps[: options.best], start=1):
                for mass in masses:
                    start = time.perf_counter()
                    outcome = simulate_lift(
                        LiftSetup(mesh, hand, grasp, support_height=support_height, mass=mass)
                    )
                    seconds.append(time.perf_counter() - start)
                    reasons[mass][outcome.reason] += 1
                    print(
                        f"{name:16} seed {seed}  grasp {rank}  {mass:.2f} kg  {outcome.reason:12}"
                        f"  slip {1e3 * outcome.slip:5.1f} mm  {seconds[-1]:4.1f} s"
                        f" for {outcome.duration:.1f} s simulated",
                        flush=True,
                    )
    for mass, counts in reasons.items():
        print(f"{mass:.2f} kg: {counts['held']} of {counts.total()} held; {dict(counts)}")
    if seconds:
        print(f"a trial: median {np.median(seconds):.1f} s, longest {max(seconds):.1f} s")


if __name__ == "__main__":
    main()
