"""Describe your own hand with a URDF and a YAML file, and grasp with it.

    python examples/own_hand.py --output results/own_hand

The hand here is the shipped parallel-jaw gripper with less force and a wider narrow opening.
"""

import argparse
import shutil
from pathlib import Path

import numpy as np
import yaml

from lis_grasp import ForceClosureSampler, Hand, shapes
from lis_grasp.robots.shipped_models import model_path


def write_hand(folder: Path) -> Path:
    """Write a hand's URDF and YAML; return the path of the YAML."""
    shutil.copy(model_path("hands/wsg50/wsg50.urdf"), folder / "gripper.urdf")
    text = model_path("hands/wsg50/wsg50.yaml").read_text(encoding="utf-8")
    description = yaml.safe_load(text)
    description["name"] = "gentle_gripper"
    description["urdf"] = "gripper.urdf"  # relative to the YAML
    description["max_contact_force"] = 15  # [N] of one finger
    description["pregrasps"] = {"wide": [0.055, 0.055], "narrow": [0.03, 0.03]}  # joints [m]
    path = folder / "gripper.yaml"
    path.write_text(yaml.safe_dump(description), encoding="utf-8")
    return path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("results/own_hand"))
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)

    hand = Hand.load(write_hand(output))
    print(f"{hand.name}: joints {', '.join(hand.joint_names)}, {len(hand.pads)} pads")

    box = shapes.build("box", 0.12)
    search = ForceClosureSampler(hand, friction=0.8).sample(
        box.mesh,
        rng=np.random.default_rng(0),
        support_height=box.mesh.bounds[0, 2],
        count=3,
    )
    print(f"{len(search.grasps)} grasps on a box of {1e3 * box.size:.0f} mm")
    for grasp in search.grasps:
        squeeze = np.linalg.norm(grasp.contact_forces, axis=1).max()
        print(f"  epsilon {grasp.quality['epsilon']:.3f}, squeeze {squeeze:.1f} N a finger")
    search.save(output / "grasps.json")
    print(f"wrote {output / 'gripper.yaml'} and {output / 'grasps.json'}")


if __name__ == "__main__":
    main()
