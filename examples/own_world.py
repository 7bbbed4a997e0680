"""Touch and grasp in a bin of your own, which Drake's model directives describe.

    python examples/own_world.py --output results/own_world

The same on the command line: `lis-grasp run box --region 0.2 0.2 0.2 --world
examples/own_world/bin.dmd.yaml --at middle`.
"""

import argparse
from pathlib import Path

import lis_grasp as lg

DIRECTIVES = Path(__file__).parent / "own_world" / "bin.dmd.yaml"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("results/own_world"))
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)

    # The object is on the table at the frame `middle`, inside of the bin.
    world = lg.load_world(DIRECTIVES, at="middle")
    for body in world:
        print(f"{body.name}: {'fixed' if body.is_fixed else 'free'}, {len(body.geometries)} shapes")

    exploration = lg.explore(
        "box", "wsg50", world=world, region=(0.2, 0.2, 0.2), prober="kinematic", touches=12
    )
    contacts = exploration.contacts
    contacts.save(output / "contacts.ply")
    nearest = world.distances(contacts.points).min()
    print(f"touch: {exploration.summary()}")
    print(f"the contact nearest to a body is {1e3 * nearest:.0f} mm from it")

    mesh = lg.extract_mesh(lg.estimate(contacts, support_height=0.0))
    mesh.export(output / "surface.ply")
    search = lg.plan(mesh, "wsg50", world=world, support_height=0.0)
    search.save(output / "grasps.json")
    print(f"grasp: best of {len(search)}, epsilon {search.best.epsilon:.3f}")
    print(f"wrote contacts, surface and grasps to {output}")


if __name__ == "__main__":
    main()
