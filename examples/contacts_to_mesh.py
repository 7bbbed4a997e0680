"""Estimate a closed surface mesh from your own contacts.

    python examples/contacts_to_mesh.py --output results/contacts_to_mesh

The contacts here are a cube of 6 cm in a robot's frame R, in millimetres. Replace them by yours.
"""

import argparse
from pathlib import Path

import numpy as np

from lis_grasp import BlendedImplicitSurface, Contacts, extract_mesh

# Contact points [mm] and the directions from the object to the finger, in R: four on each face.
CENTER_MM = np.array([400, 0, 120])
FACES = np.vstack([np.eye(3), -np.eye(3)])
ACROSS = np.roll(FACES, 1, axis=1), np.roll(FACES, 2, axis=1)
POINTS_MM = np.vstack(
    [CENTER_MM + 30 * FACES + a * ACROSS[0] + b * ACROSS[1] for a in (-18, 18) for b in (-18, 18)]
)
NORMALS = np.tile(FACES, (4, 1))

# The pose of R in the object frame O [m]: O's origin is 400 mm ahead of R's and 120 mm above it.
X_OR = np.eye(4)
X_OR[:3, 3] = [-0.4, 0.0, -0.12]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("results/contacts_to_mesh"))
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)

    contacts = Contacts(
        points=1e-3 * POINTS_MM @ X_OR[:3, :3].T + X_OR[:3, 3],
        normals=NORMALS @ X_OR[:3, :3].T,
    )
    contacts.save(output / "contacts.ply")

    # One standard deviation of the sensor: 0.5 mm in position, 0.02 rad in the normal.
    surface = BlendedImplicitSurface.from_contacts(
        contacts, position_noise=0.0005, normal_noise=0.02
    )
    mesh = extract_mesh(surface)
    mesh.export(output / "surface.ply")

    print(f"{len(contacts)} contacts, {1e3 * contacts.extent:.0f} mm in the largest extent")
    print(f"mesh of {len(mesh.faces)} triangles, watertight: {mesh.is_watertight}")
    print(f"volume {1e6 * mesh.volume:.1f} cm^3; a cube of 6 cm has {6**3} cm^3")
    print(f"wrote {output / 'contacts.ply'} and {output / 'surface.ply'}")


if __name__ == "__main__":
    main()
