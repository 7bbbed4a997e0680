"""Cost of estimators against the number of contacts: fit, field, mesh, memory.

    python benchmarks/bench_estimators.py
    pip install lis-grasp[baselines]      # for offset_gp (scikit-learn) and poisson (MeshLab)

Contacts are spread evenly over the mallet at 0.20 m. Times are the best of several runs on one
thread. The field is evaluated at 200 000 points within a spacing of the surface; the mesh has cells
of 1/64 of the object; memory is the peak while fitting (tracemalloc, NumPy's arrays). An estimator
whose fit takes longer than --limit gets no more contacts. The last line of an estimator has the k
of time ~ N^k, by least squares on logarithms.
"""

import time
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np

from lis_grasp import Contacts, extract_mesh, shapes
from lis_grasp.evaluation.surface_error import sample_mesh
from lis_grasp.exceptions import LisGraspError
from lis_grasp.io.json_lines import Row
from lis_grasp.surfaces import ESTIMATORS
from lis_grasp_studies.baselines import BASELINES
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.runner import single_thread
from lis_grasp_studies.harness.tables import grouped_table, mean_cell, values_of

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


def measure(make: Callable[[Contacts], Any], count: int) -> Row:
    contacts = even_contacts(count)
    rng = np.random.default_rng(0)
    aside = contacts.spacing * rng.uniform(-1.0, 1.0, (QUERIES, 3))
    queries = contacts.points[rng.integers(count, size=QUERIES)] + aside
    surface = make(contacts)
    tracemalloc.start()
    make(contacts)
    memory = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return {
        "contacts": count,
        "fit": best_time(lambda: make(contacts)),
        "field": best_time(lambda: surface.evaluate(queries)) / QUERIES,
        "mesh": best_time(lambda: extract_mesh(surface, resolution=0.2 / 64), budget=0.1),
        "memory": memory,
    }


def exponent(rows: list[Row], column: str) -> str:
    logs = np.log([values_of(rows, name) for name in ("contacts", column)])
    return f"N^{np.polyfit(*logs, 1)[0]:.2f} ({column})"


def main() -> None:
    names = [*ESTIMATORS, "hermite_rbf", "offset_gp", "poisson"]
    options = read_options(__doc__, sizes=list(SIZES), limit=20.0, estimators=names)
    columns = [
        ("fit [ms]", mean_cell("fit", 1e3)),
        ("field [us/point]", mean_cell("field", 1e6, 2)),
        ("mesh [s]", mean_cell("mesh", digits=2)),
        ("memory [MB]", mean_cell("memory", 2**-20)),
    ]
    for name in options.estimators:
        rows: list[Row] = []
        for count in options.sizes:
            try:
                rows.append(measure({**ESTIMATORS, **BASELINES}[name], count))
            except LisGraspError as error:
                print(f"{name} {count} {error}", flush=True)
                break
            if rows[-1]["fit"] > options.limit:
                break
        groups = {row["contacts"]: [row] for row in rows}
        print(grouped_table(name, name, "contacts", groups, columns).text(), flush=True)
        if len(rows) > 2:
            print("grows as", ", ".join(exponent(rows, c) for c in ("fit", "field", "memory")))


if __name__ == "__main__":
    with single_thread():
        main()
