"""Explore an unknown object, estimate its surface, plan a grasp and simulate the lift.

    python examples/explore_to_lift.py --output results/explore_to_lift

This is `lis-grasp run box --known` in Python, one function a stage. Only touch and lift take
the true object.
"""

import argparse
from pathlib import Path

import lis_grasp as lg


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("results/explore_to_lift"))
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)

    # The kinematic prober touches by geometry alone; "dynamic" simulates every touch in Drake.
    box = lg.shapes.build("box")
    exploration = lg.explore(box, "allegro", known=True, prober="kinematic", touches=15)
    exploration.contacts.save(output / "contacts.ply")
    print(f"touch: {exploration.summary()}")

    mesh = lg.extract_mesh(lg.estimate(exploration.contacts))
    mesh.export(output / "surface.ply")
    print(f"estimate: {1e6 * mesh.volume:.0f} cm^3, true {1e6 * box.mesh.volume:.0f} cm^3")

    search = lg.plan(mesh, "allegro")
    search.save(output / "grasps.json")
    print(f"grasp: best of {len(search)}, epsilon {search.best.epsilon:.3f}")

    outcome = lg.lift(box, search.best)
    print(f"lift: lifted {outcome.lifted}, held {outcome.held}, slip {1e3 * outcome.slip:.1f} mm")
    outcome.motion.save(output / "motion.npz")
    print(f"wrote contacts, surface, grasps and motion to {output}")


if __name__ == "__main__":
    main()
