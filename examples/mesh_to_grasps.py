"""Plan force-closure grasps on your own mesh.

    python examples/mesh_to_grasps.py --output results/mesh_to_grasps

The mesh here is a bracket in millimetres, as a CAD program exports it. Replace it by yours.
"""

import argparse
from pathlib import Path

import numpy as np
import trimesh

from lis_grasp import ForceClosureSampler, Hand, shapes


def write_bracket(path: Path) -> None:
    """Write a bracket [mm] that stands on z = 0: a foot and a wall."""
    foot = trimesh.creation.box(bounds=[[-30, -25, 0], [30, 25, 12]])
    wall = trimesh.creation.box(bounds=[[-30, -25, 0], [-16, 25, 100]])
    trimesh.boolean.union([foot, wall]).export(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("results/mesh_to_grasps"))
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)

    write_bracket(output / "bracket.stl")
    bracket = shapes.load(output / "bracket.stl", units="mm")
    print(f"bracket of {1e3 * bracket.size:.0f} mm, repairs: {list(bracket.repairs) or 'none'}")

    search = ForceClosureSampler(Hand.load("wsg50"), friction=0.6).sample(
        bracket.mesh,
        rng=np.random.default_rng(0),
        support_height=bracket.mesh.bounds[0, 2],
        count=5,
    )
    print(f"{len(search.grasps)} grasps of {search.candidates} candidates")
    for reason, number in search.rejections.items():
        print(f"  rejected {number:4d}: {reason}")
    for grasp in search.grasps:
        print(f"  epsilon {grasp.quality['epsilon']:.3f} with {', '.join(grasp.contact_fingers)}")
    search.save(output / "grasps.json")
    print(f"wrote {output / 'grasps.json'}")


if __name__ == "__main__":
    main()
