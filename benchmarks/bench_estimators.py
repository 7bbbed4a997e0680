"""Cost of estimators against the number of contacts: fit, added contact, field, mesh, memory.

    python benchmarks/bench_estimators.py
    pip install lis-grasp[baselines]      # for offset_gp (scikit-learn) and poisson (MeshLab)

Contacts are spread evenly over the mallet at 0.20 m. Times are the best of several runs on one
thread. The field is evaluated at 200 000 points within a spacing of the surface; the mesh has cells
of 1/64 of the object; memory is the peak while fitting (tracemalloc, NumPy's arrays). An estimator
whose fit takes longer than the limit gets no more contacts. The last line of an estimator has the k
of time ~ N^k, by least squares on logarithms.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from lis_grasp import Contacts, extract_mesh, shapes
from lis_grasp.evaluation.surface_samples import sample_mesh
from lis_grasp.exceptions import LisGraspError
from lis_grasp.surfaces import ESTIMATORS
from lis_grasp_studies.baselines import BASELINES

SIZES = (50, 100, 200, 500, 1000, 2000, 5000)
QUERIES = 200_000


def even_contacts(count: int) -> Contacts:
    shape = shapes.build("mallet", shapes.PAPER_SIZE)
    points, faces = sample_mesh(shape.mesh, count)
    return Contacts(points, np.asarray(shape.mesh.face_normals)[faces])


def best_time(function: Callable[[], object], budget: float = 0.5) -> float:
    """Return the shortest time of a call [s], of as many calls as fit into the budget."""
    least, spent = np.inf, 0.0
    while spent < budget:
        start = time.perf_counter()
        function()
        taken = time.perf_counter() - start
        least, spent = min(least, taken), spent + taken
    return least


@dataclass(frozen=True)
class Costs:
    fit: float
    field: float
    mesh: float
    memory: int


def measure(make: Callable[[Contacts], Any], count: int) -> Costs:
    contacts = even_contacts(count)
    rng = np.random.default_rng(0)
    aside = contacts.spacing * rng.uniform(-1.0, 1.0, (QUERIES, 3))
    queries = contacts.points[rng.integers(count, size=QUERIES)] + aside
    surface = make(contacts)
    tracemalloc.start()
    make(contacts)
    memory = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    fit = best_time(lambda: make(contacts))
    return Costs(
        fit=fit,
        field=best_time(lambda: surface.evaluate(queries)) / QUERIES,
        mesh=best_time(lambda: extract_mesh(surface, resolution=0.2 / 64), budget=0.1),
        memory=memory,
    )


def exponent(sizes: list[int], times: list[float]) -> float:
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    parser.add_argument("--limit", type=float, default=20.0, help="longest fit [s]")
    parser.add_argument(
        "--estimators", nargs="+", default=[*ESTIMATORS, "hermite_rbf", "offset_gp", "poisson"]
    )
    arguments = parser.parse_args()
    print("estimator        N   fit [ms]  field [us/point]  mesh [s]  memory [MB]")
    for name in arguments.estimators:
        sizes: list[int] = []
        costs: list[Costs] = []
        for count in arguments.sizes:
            try:
                c = measure({**ESTIMATORS, **BASELINES}[name], count)
            except LisGraspError as error:
                print(f"{name:12s} {count:5d} {error}", flush=True)
                break
            sizes.append(count)
            costs.append(c)
            print(
                f"{name:12s} {count:5d} {1e3 * c.fit:10.1f} {1e6 * c.field:17.2f} {c.mesh:9.2f}"
                f" {c.memory / 2**20:12.1f}",
                flush=True,
            )
            if c.fit > arguments.limit:
                break
        if len(sizes) > 2:
            print(
                f"{name:12s} grows as N^{exponent(sizes, [c.fit for c in costs]):.2f} (fit),"
                f" N^{exponent(sizes, [c.field for c in costs]):.2f} (field),"
                f" N^{exponent(sizes, [float(c.memory) for c in costs]):.2f} (memory)",
                flush=True,
            )


if __name__ == "__main__":
    with threadpool_limits(1):
        main()
