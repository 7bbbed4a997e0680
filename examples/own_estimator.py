"""Explore an object with your own surface estimator.

    python examples/own_estimator.py --output results/own_estimator

The estimator here is the tangent plane of the nearest contact. A class with these four members is
enough: nothing is registered or inherited.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp import Contacts, explore, extract_mesh, shapes, surface_error


class NearestPlane:
    def __init__(self, contacts: Contacts) -> None:
        self.contacts, self.tree = contacts, cKDTree(contacts.points)
        margin = 0.15 * contacts.extent
        self.bounds = contacts.bounds + [[-margin], [margin]]  # (2, 3) [m]

    def evaluate(self, points):  # (..., 3) -> (...): negative inside
        nearest = self.tree.query(points)[1]
        offset = points - self.contacts.points[nearest]
        return np.sum(offset * self.contacts.normals[nearest], axis=-1)

    def gradient(self, points):  # (..., 3) -> (..., 3): outward
        return self.contacts.normals[self.tree.query(points)[1]]

    def uncertainty(self, points):  # (..., 3) -> (...): one standard deviation [m]
        return 0.2 * self.tree.query(points)[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("results/own_estimator"))
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)

    pentagon = shapes.build("pentagon")
    how = {"known": True, "prober": "kinematic", "policy": "frontier", "touches": 15}
    exploration = explore(pentagon, estimator=NearestPlane, **how)
    mesh = extract_mesh(NearestPlane(exploration.contacts))
    mesh.export(output / "surface.ply")
    near = 0.25 * pentagon.size
    error = surface_error(mesh, pentagon, exploration.contacts, explored_radius=near)
    print(exploration.summary())
    print(f"error {1e3 * error.rmsd:.1f} mm where explored; wrote {output / 'surface.ply'}")


if __name__ == "__main__":
    main()
