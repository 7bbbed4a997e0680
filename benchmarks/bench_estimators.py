"""How estimators slow down with the number of contacts: fit, one contact more, field, mesh, memory.

    python benchmarks/bench_estimators.py
    pip install lis-grasp[baselines]      # for offset_gp (scikit-learn) and poisson (MeshLab)

Contacts are spread evenly over the mallet at 0.20 m. Times are the best of several runs on one
thread; the field is asked at 20 000 points within a spacing of the surface, the mesh has cells of
1/64 of the object, memory is what fitting holds at its peak (tracemalloc, NumPy's arrays). An
estimator whose fit took more than the limit is not tried with more contacts. Last, the exponent k of
time ~ N^k between the smallest and the largest N, by least squares on logarithms.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
from collections.abc import Callable

import numpy as np
from threadpoolctl import threadpool_limits

from lis_grasp import Contacts, extract_mesh, shapes
from lis_grasp.evaluation.surface_samples import sample_mesh
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.surfaces import ESTIMATORS
from lis_grasp.surfaces.baselines import BASELINES

SIZES = (50, 100, 200, 500, 1000, 2000, 5000)
QUERIES = 20_000


def even_contacts(count: int) -> Contacts:
    shape = shapes.build("mallet", shapes.PAPER_SIZE)
    points, faces = sample_mesh(shape.mesh, count)
    return Contacts(points, np.asarray(shape.mesh.face_normals)[faces])


def best_time(function: Callable[[], object], budget: float = 0.5) -> float:
    """Return the least time of a call [s], of as many calls as fit into the budget, one at least."""
    least, spent = np.inf, 0.0
    while spent < budget:
        start = time.perf_counter()
        function()
        taken = time.perf_counter() - start
        least, spent = min(least, taken), spent + taken
    return least


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    parser.add_argument("--limit", type=float, default=20.0, help="longest fit [s]")
    parser.add_argument(
        "--estimators", nargs="+", default=[*ESTIMATORS, "hermite_rbf", "offset_gp", "poisson"]
    )
    arguments = parser.parse_args()
    print("estimator        N   fit [ms]  one more [ms]  field [us/point]  mesh [s]  memory [MB]")
    for name in arguments.estimators:
        make = {**ESTIMATORS, **BASELINES}[name]
        table: list[tuple[int, float, float, float]] = []
        for count in arguments.sizes:
            contacts = even_contacts(count)
            rng = np.random.default_rng(0)
            chosen = rng.integers(count, size=QUERIES)
            queries = contacts.points[chosen] + contacts.spacing * rng.uniform(
                -1.0, 1.0, (QUERIES, 3)
            )
            try:
                surface = make(contacts)
            except InvalidOptionError as error:
                print(f"{name:12s} {error}")
                break
            tracemalloc.start()
            make(contacts)
            memory = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            fit = best_time(lambda: make(contacts))
            most, last = contacts.subset(slice(0, -1)), contacts.subset(slice(count - 1, None))
            before = make(most)
            if hasattr(before, "with_contacts"):
                more = best_time(lambda: before.with_contacts(last))
            else:
                more = fit
            field = best_time(lambda: surface.evaluate(queries)) / QUERIES
            mesh = best_time(lambda: extract_mesh(surface, resolution=0.2 / 64), budget=0.1)
            table.append((count, fit, more, field))
            print(
                f"{name:12s} {count:5d} {1e3 * fit:10.1f} {1e3 * more:14.1f} {1e6 * field:17.2f}"
                f" {mesh:9.2f} {memory / 2**20:12.1f}",
                flush=True,
            )
            if fit > arguments.limit:
                break
        if len(table) > 2:
            logs = np.log(np.array(table))
            slopes = [np.polyfit(logs[:, 0], logs[:, k], 1)[0] for k in (1, 2, 3)]
            print(
                f"{name:12s} grows as N^{slopes[0]:.2f} (fit), N^{slopes[1]:.2f} (one more),"
                f" N^{slopes[2]:.2f} (field)",
                flush=True,
            )


if __name__ == "__main__":
    with threadpool_limits(1):
        main()
