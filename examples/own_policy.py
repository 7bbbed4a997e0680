"""Choose the next touch with your own exploration policy.

    python examples/own_policy.py --output results/own_policy

The policy here touches the object from above at random places. A class with `next_probe` is enough.
"""

import argparse
from pathlib import Path

from lis_grasp import estimate, explore, extract_mesh
from lis_grasp.exploration import Probe, Workspace


class FromAbove:
    def __init__(self, space: Workspace) -> None:
        self.space = space

    def next_probe(self, contacts, surface, *, outcomes, rng):
        """Return the next probe, or None when nothing is left to touch."""
        half = 0.5 * self.space.size
        target = self.space.center.copy()
        target[:2] += rng.uniform(-0.6 * half, 0.6 * half, size=2)
        # From half the object's size above the target, down to its lowest place.
        return Probe(target, direction=[0.0, 0.0, -1.0], standoff=2.0 * half, overshoot=half)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("results/own_policy"))
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)

    exploration = explore("mallet", known=True, prober="kinematic", policy=FromAbove, touches=12)
    contacts = exploration.contacts
    contacts.save(output / "contacts.ply")
    extract_mesh(estimate(contacts)).export(output / "surface.ply")

    low, high = 1e3 * contacts.bounds[:, 2]
    print(exploration.summary())
    print(f"contacts from {low:.0f} to {high:.0f} mm in height, the object's middle is at 0")
    print(f"wrote {output / 'contacts.ply'} and {output / 'surface.ply'}")


if __name__ == "__main__":
    main()
