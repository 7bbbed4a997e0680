"""Compare surface estimators on the same noisy contacts.

    python examples/compare_estimators.py --output results/compare_estimators

For whole studies over objects, noise and seeds use `lis-grasp compare`.
"""

import argparse
import csv
from pathlib import Path

from lis_grasp import (
    BlendedImplicitSurface,
    GaussianProcessImplicitSurface,
    LocalImplicitSurface,
    PatchImplicitSurface,
    explore,
    extract_mesh,
    shapes,
    surface_error,
)

ESTIMATORS = (
    GaussianProcessImplicitSurface,
    LocalImplicitSurface,
    PatchImplicitSurface,
    BlendedImplicitSurface,
)
NOISE = {"position_noise": 0.0005, "normal_noise": 0.03}  # [m], [rad]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("results/compare_estimators"))
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)

    pentagon = shapes.build("pentagon")
    exploration = explore(pentagon, known=True, prober="kinematic", touches=20, **NOISE)
    contacts = exploration.contacts

    with (output / "errors.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["estimator", "rmsd_mm", "edge_rmsd_mm"])
        for estimator in ESTIMATORS:
            mesh = extract_mesh(estimator.from_contacts(contacts, **NOISE))
            error = surface_error(mesh, pentagon, contacts, explored_radius=0.25 * pentagon.size)
            row = f"{1e3 * error.rmsd:.2f}", f"{1e3 * error.edge_rmsd:.2f}"
            table.writerow([estimator.__name__, *row])
            print(f"{estimator.__name__:32s} {row[0]} mm, at true edges {row[1]} mm")
    print(f"wrote {output / 'errors.csv'}")


if __name__ == "__main__":
    main()
