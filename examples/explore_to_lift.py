"""Explore an unknown object, estimate its surface, plan a grasp and simulate the lift.

    python examples/explore_to_lift.py --output results/explore_to_lift

This is `lis-grasp run --known` in Python: each stage is one function of `lis_grasp.pipeline`.
"""

import argparse
from pathlib import Path

from lis_grasp import pipeline


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("results/explore_to_lift"))
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)

    # The kinematic prober touches by geometry alone; "dynamic" simulates every touch in Drake.
    config = pipeline.RunConfig(object="box", prober="kinematic", touches=15)
    scenario = pipeline.Scenario.from_config(config)
    box = scenario.truth.shape

    exploration = pipeline.touch(scenario)
    exploration.contacts.save(output / "contacts.ply")
    print(f"touch: {exploration.summary()}")

    # The robot decides by what is known, and never by the true object.
    _, mesh = pipeline.estimate(scenario.agent, exploration.contacts)
    mesh.export(output / "surface.ply")
    print(f"estimate: {1e6 * mesh.volume:.0f} cm^3, true {1e6 * box.mesh.volume:.0f} cm^3")

    search = pipeline.plan(scenario.agent, mesh)
    search.save(output / "grasps.json")
    best = search.grasps[0]
    print(f"grasp: best of {len(search.grasps)}, epsilon {best.quality['epsilon']:.3f}")

    outcome = pipeline.lift(scenario, best)
    print(f"lift: lifted {outcome.lifted}, held {outcome.held}, slip {1e3 * outcome.slip:.1f} mm")
    outcome.motion.save(output / "motion.npz")
    print(f"wrote contacts, surface, grasps and motion to {output}")


if __name__ == "__main__":
    main()
