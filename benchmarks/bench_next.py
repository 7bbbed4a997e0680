"""Time of an answer of the service for touches, `lis-grasp next --serve`, with many contacts.

    python benchmarks/bench_next.py
    python benchmarks/bench_next.py box mallet --hands allegro --touches 40

The service is another process, asked over its standard streams; points feel the object without
noise. Times are of the client's clock, which needs an idle machine, and of the service's processor,
which does not (on Linux).
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from itertools import product
from pathlib import Path

import numpy as np
import trimesh

from lis_grasp import shapes
from lis_grasp.io.json_lines import Row
from lis_grasp.typing import FloatArray
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.tables import grouped_table, mean_cell, median_cell

_MEASURED = 11  # touches, about the wanted number


def feel(mesh: trimesh.Trimesh, start: FloatArray, end: FloatArray) -> Row:
    """Return the contact of a point that moves, as a request reports it."""
    points, _, faces = mesh.ray.intersects_location([start], [end - start], multiple_hits=False)
    if not len(points) or np.linalg.norm(points[0] - start) > np.linalg.norm(end - start):
        return {"status": "missed", "free_points": [start.tolist()]}
    normals = mesh.face_normals[faces].tolist()
    return {"points": points.tolist(), "normals": normals, "free_points": [start.tolist()]}


def processor_seconds(process: int) -> float:
    """Return the processor time of another process, which the kernel counts in steps of 10 ms."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure(name: str, hand: str, estimator: str, touches: int) -> list[Row]:
    """Explore an object until there are some more contacts than wanted; return answers near it."""
    shape = shapes.build(name)
    options = ["--hand", hand, "--estimator", estimator, "--support", str(shape.mesh.bounds[0, 2])]
    center = [str(x) for x in shape.mesh.bounds.mean(axis=0)]
    options += ["--size", str(shape.size), "--center", *center]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "lis_grasp.cli.main", "next", "--serve", *options]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        with subprocess.Popen([*command, "--output", folder], **pipes) as service:

            def ask(request: Row) -> Row:
                service.stdin.write(json.dumps(request).encode() + b"\n")
                service.stdin.flush()
                return json.loads(service.stdout.readline())

            touch = ask({"request": "next"})
            for _ in range(4 * touches):
                report = feel(shape.mesh, np.array(touch["start"]), np.array(touch["end"]))
                start, before = time.perf_counter(), processor_seconds(service.pid)
                touch = ask({"request": "next", **report})
                seconds = time.perf_counter() - start
                used = processor_seconds(service.pid) - before
                if not touch["ok"] or touch["contacts"] > touches + _MEASURED // 2:
                    break
                if abs(touch["contacts"] - touches) <= _MEASURED // 2:
                    rows.append({"seconds": seconds, "processor": used})
            ask({"request": "stop"})
    return rows


def main() -> None:
    """Print a table of the times of answers, by hand and estimator."""
    options = read_options(
        __doc__,
        objects=["box", "mallet", "cylinder", "sphere"],
        hands=["allegro", "wsg50"],
        estimators=["blend", "gpis"],
        touches=40,
    )
    groups: dict[tuple[str, str], list[Row]] = {}
    for hand, estimator in product(options.hands, options.estimators):
        groups[hand, estimator] = rows = []
        for name in options.objects:
            rows += measure(name, hand, estimator, options.touches)
            print(hand, estimator, name, rows[-1], flush=True)
    columns = [
        ("answers", lambda rows: str(len(rows))),
        ("median [ms]", median_cell("seconds", 1e3, 0)),
        ("processor median [ms]", median_cell("processor", 1e3, 0)),
        ("processor mean [ms]", mean_cell("processor", 1e3, 0)),
    ]
    title = f"Answers with about {options.touches} contacts"
    print(grouped_table("next", title, "hand | estimator", groups, columns).text())


if __name__ == "__main__":
    main()
