"""Coverage and edge error by policy, against touches, probes and time: objects x seeds.

    python benchmarks/bench_policies.py --seeds 10

The Allegro-size hand touches each object of 0.20 m by geometry alone (the kinematic prober). The
reachable surface is what a ball of the fingertip's radius can touch; it counts as covered within a
step (50 mm) of a contact. Edge errors are those of the `blend` surface of the first contacts, over
all sharp edges of the object, touched or not, so that they depend on the places of touches alone.
`uncertainty` follows a Gaussian process, the usual rule; `spread` and `frontier` use `blend`. Time
is that of the hand's motion: approach, touch, retreat, and the way round the object to the next.

Continues where it stopped when run again with the same folder. Intervals: 95 %, bootstrap over
seeds.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import matplotlib
import numpy as np

from lis_grasp import Hand, extract_mesh, shapes
from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_samples import sample_mesh, sample_segments
from lis_grasp.exploration import (
    Exploration,
    ExplorationSetup,
    TactileSensor,
    Workspace,
    explore,
)
from lis_grasp.exploration.targets import transfer_seconds
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline import make_policy, workspace
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.shapes import Shape
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.surfaces import ESTIMATORS
from lis_grasp_studies.runner import local_scheduler, run_trials, single_thread
from lis_grasp_studies.trial_results import Job, TrialResults, missing_jobs

matplotlib.use("Agg")
from matplotlib import pyplot as plt

TIP_RADIUS = 0.012
POLICIES = {
    "spread": "blend",
    "swift": "blend",
    "frontier": "blend",
    "uncertainty": "gpis",
    "random": "blend",
}
EDGE_COUNTS = (*range(6, 25, 2), 28, 32, 40)
COVERED, EDGE_GOAL = 0.9, 0.002


@dataclass(frozen=True)
class PolicyTrial:
    object: str
    seed: int
    touches: int


def key(trial: PolicyTrial, policy: str) -> tuple:
    return trial.object, trial.seed, trial.touches, policy


def key_of(row: Row) -> tuple:
    return row["object"], row["seed"], row["touches"], row["policy"]


def reachable_points(shape: Shape) -> np.ndarray:
    points, faces = sample_mesh(shape.mesh, 3000)
    centers = points + TIP_RADIUS * shape.mesh.face_normals[faces]
    free, _ = distances_to_mesh(centers, shape.mesh)
    return points[free > 0.98 * TIP_RADIUS]


def edge_error(shape: Shape, contacts: Contacts) -> float:
    mesh = extract_mesh(ESTIMATORS["blend"](contacts), resolution=shape.size / 40)
    off, _ = distances_to_mesh(sample_segments(shape.edges, 800), mesh)
    return float(np.sqrt(np.mean(off**2)))


def run(job: Job) -> list[Row]:
    """Return one row for each policy."""
    return [explore_with(policy, job.trial) for policy in job.variants]


def explore_with(policy: str, trial: PolicyTrial) -> Row:
    name, seed, touches = trial.object, trial.seed, trial.touches
    shape = shapes.build(name, shapes.PAPER_SIZE)
    space = workspace(shape)
    with single_thread():
        exploration = explore(
            KinematicProber(Hand.load("allegro"), shape.mesh),
            ExplorationSetup(
                make_policy(policy, space, TactileSensor()),
                ESTIMATORS[POLICIES[policy]],
                touches=touches,
                space=space,
            ),
            rng=np.random.default_rng(seed),
        )
        contacts = exploration.contacts
        apart = np.linalg.norm(reachable_points(shape)[:, None] - contacts.points, axis=-1)
        nearest = np.minimum.accumulate(apart, axis=1)  # (P, N)
        edges = {}
        if len(shape.edges):
            for k in EDGE_COUNTS:
                if k <= len(contacts):
                    edges[str(k)] = edge_error(shape, contacts.subset(slice(0, k)))
    probes = _probes_at_contacts(exploration)
    seconds = motion_seconds(exploration, space)
    return {
        "object": name,
        "policy": policy,
        "seed": seed,
        "touches": touches,
        "coverage": np.mean(nearest < space.step, axis=0).tolist(),
        "probes": probes,
        "seconds": seconds[np.array(probes) - 1].tolist(),
        "edges": edges,
    }


def motion_seconds(exploration: Exploration, space: Workspace) -> np.ndarray:
    """Return the time from the first motion to the end of each probe, transfers included [s]."""
    total, totals, before = 0.0, [], None
    for outcome in exploration.outcomes:
        if outcome.duration > 0.0:
            start, direction = outcome.probe.start, outcome.probe.direction
            outside = start - space.approach_distance(start, direction) * direction
            if before is not None:
                total += float(transfer_seconds(outside, before[None], space)[0])
            before = outside
        total += outcome.duration
        totals.append(total)
    return np.array(totals)


def _probes_at_contacts(exploration: Exploration) -> list[int]:
    """Return how many probes it took to each contact."""
    counts = [
        len(Exploration.replay(exploration.outcomes[:k]).contacts)
        for k in range(1, len(exploration.outcomes) + 1)
    ]
    wanted = np.arange(1, len(exploration.contacts) + 1)
    return (np.searchsorted(counts, wanted) + 1).tolist()


def touches_to_cover(row: Row, *, probes: bool) -> int:
    """Return touches (or probes) to 90 % coverage; one more than were made where that failed."""
    reached = np.flatnonzero(np.array(row["coverage"]) >= COVERED)
    if not len(reached):
        return (row["probes"][-1] if probes else row["touches"]) + 1
    return row["probes"][reached[0]] if probes else int(reached[0]) + 1


def touches_to_edges(row: Row) -> int:
    """Return touches until the error of all edges is 2 mm; two more than tried where it fails."""
    good = [int(k) for k, error in row["edges"].items() if error <= EDGE_GOAL]
    return min(good, default=EDGE_COUNTS[-1] + 2)


def seconds_until(row: Row, touches: int) -> float:
    """Return the seconds of motion until so many touches; of all that were made if it is more."""
    return row["seconds"][min(touches, len(row["seconds"])) - 1]


MEASURES = {
    "touches to 90 %": lambda row: touches_to_cover(row, probes=False),
    "probes to 90 %": lambda row: touches_to_cover(row, probes=True),
    "seconds to 90 %": lambda row: seconds_until(row, touches_to_cover(row, probes=False)),
    "touches to 2 mm": touches_to_edges,
    "seconds to 2 mm": lambda row: seconds_until(row, touches_to_edges(row)),
}
OF_EDGES = ("touches to 2 mm", "seconds to 2 mm")


def interval(values: np.ndarray) -> tuple[float, float, float]:
    """Return the mean of (objects, seeds), and its 95 % interval over seeds."""
    rng = np.random.default_rng(0)
    drawn = rng.integers(values.shape[1], size=(2000, values.shape[1]))
    low, high = np.quantile(values[:, drawn].mean(axis=(0, 2)), [0.025, 0.975])
    return float(values.mean()), float(low), float(high)


def by_object(rows: list[Row], policy: str, measure) -> np.ndarray:
    mine = [row for row in rows if row["policy"] == policy]
    names = list(dict.fromkeys(row["object"] for row in mine))
    return np.array([[measure(r) for r in mine if r["object"] == name] for name in names], float)


def edge_errors(rows: list[Row], policy: str) -> np.ndarray:
    """Return errors [mm] of (objects with edges, seeds, numbers of touches)."""
    edged = [row for row in rows if row["edges"]]
    return by_object(
        edged, policy, lambda row: [1e3 * row["edges"].get(str(k), np.nan) for k in EDGE_COUNTS]
    )


def touches_to_mean(errors: np.ndarray) -> float:
    """Return from how many touches on the mean over objects and seeds is 2 mm or less."""
    mean = np.log(np.nanmean(errors, axis=(0, 1)) / (1e3 * EDGE_GOAL))
    above = np.flatnonzero(mean > 0.0)
    if not len(above):
        return EDGE_COUNTS[0]
    k = above[-1]
    if k + 1 == len(mean):
        return np.inf
    return float(np.interp(0.0, [-mean[k], -mean[k + 1]], EDGE_COUNTS[k : k + 2]))


def print_means(rows: list[Row]) -> None:
    """Print the touches to a mean error of 2 mm, and `spread` against the others."""
    of = {policy: edge_errors(rows, policy) for policy in POLICIES}
    rng = np.random.default_rng(0)
    seeds = of["spread"].shape[1]
    drawn = rng.integers(seeds, size=(2000, seeds))
    draws = {p: np.array([touches_to_mean(e[:, d]) for d in drawn]) for p, e in of.items()}
    print("\ntouches from which on the mean error at the edges, over objects, is 2 mm or less")
    for policy, errors in of.items():
        low, high = np.quantile(draws[policy], [0.025, 0.975], method="nearest")
        print(f"{policy:12s} {touches_to_mean(errors):5.1f} ({low:.1f} to {high:.1f})")
    reduction = 1.0 - touches_to_mean(of["spread"]) / touches_to_mean(of["uncertainty"])
    low, high = np.quantile(1.0 - draws["spread"] / draws["uncertainty"], [0.025, 0.975])
    print(f"spread below uncertainty: {reduction:.0%} ({low:.0%} to {high:.0%})")


def print_table(rows: list[Row]) -> None:
    edged = [row for row in rows if row["edges"]]
    print("policy      " + "".join(f"{name:>23s}" for name in MEASURES))
    for policy in POLICIES:
        values = [
            by_object(edged if name in OF_EDGES else rows, policy, measure)
            for name, measure in MEASURES.items()
        ]
        cells = ["{:.1f} ({:.1f} to {:.1f})".format(*interval(v)) for v in values]
        print(f"{policy:12s}" + "".join(f"{cell:>23s}" for cell in cells))
    for mine, reference in (("spread", "random"), ("spread", "uncertainty"), ("swift", "spread")):
        reductions = []
        for name, measure in MEASURES.items():
            one, other = (
                by_object(edged if name in OF_EDGES else rows, policy, measure).mean()
                for policy in (mine, reference)
            )
            reductions.append(f"{name} {100.0 * (1.0 - one / other):.0f} %")
        print(f"{mine} below {reference}: " + ", ".join(reductions))
    print("\nper object, touches to 90 % | touches to 2 mm (mean over seeds)")
    for name in dict.fromkeys(row["object"] for row in rows):
        cells = []
        for policy in POLICIES:
            mine = [r for r in rows if r["object"] == name and r["policy"] == policy]
            cover = np.mean([touches_to_cover(r, probes=False) for r in mine])
            edge = (
                f"{np.mean([touches_to_edges(r) for r in mine]):.0f}" if mine[0]["edges"] else "-"
            )
            cells.append(f"{policy} {cover:.0f} | {edge}")
        print(f"{name:16s} " + "   ".join(cells))


def plot(rows: list[Row], path: Path) -> None:
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.6), layout="constrained")
    touches = min(len(row["coverage"]) for row in rows)
    counts = np.arange(1, touches + 1)
    for policy in POLICIES:
        covered = by_object(rows, policy, lambda row: row["coverage"][:touches])
        edges = edge_errors(rows, policy)
        for axes, x, values in (
            (left, counts, 100.0 * covered),
            (right, np.array(EDGE_COUNTS), edges),
        ):
            bands = np.array([interval(values[:, :, k]) for k in range(len(x))])
            (line,) = axes.plot(x, bands[:, 0], label=policy)
            axes.fill_between(x, bands[:, 1], bands[:, 2], color=line.get_color(), alpha=0.2)
    left.axhline(100.0 * COVERED, color="0.6", linewidth=0.8)
    right.axhline(1e3 * EDGE_GOAL, color="0.6", linewidth=0.8)
    left.set(xlabel="touches", ylabel="reachable surface covered [%]", xlim=(1, touches))
    right.set(xlabel="touches", ylabel="edge error [mm]", yscale="log")
    left.legend(frameon=False)
    figure.savefig(path, dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--touches", type=int, default=40)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--output", type=Path, default=Path("results/policies"))
    arguments = parser.parse_args()
    results = TrialResults(arguments.output / "rows.jsonl", "policies")
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    trials = [PolicyTrial(name, seed, arguments.touches) for seed in seeds for name in shapes.NAMES]
    jobs = missing_jobs(trials, list(POLICIES), {key_of(row) for row in results.read()}, key)
    for done, total in run_trials(jobs, len(jobs), results, local_scheduler(arguments.jobs), run):
        print(f"\r{done} of {total}", end="", flush=True)
    print()
    order = {key(t, policy): k for k, (t, policy) in enumerate(product(trials, POLICIES))}
    rows = [row for row in results.read() if key_of(row) in order]
    rows.sort(key=lambda row: order[key_of(row)])
    print_table(rows)
    print_means(rows)
    plot(rows, arguments.output / "policies.png")
    print(f"\nwrote {results.path}, {arguments.output / 'policies.png'}")


if __name__ == "__main__":
    main()
