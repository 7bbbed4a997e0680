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

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np

from lis_grasp import Hand, extract_mesh, shapes
from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_error import sample_mesh, sample_segments
from lis_grasp.exploration import (
    Exploration,
    ExplorationSetup,
    TactileSensor,
    Workspace,
    explore,
)
from lis_grasp.exploration.targets import transfer_seconds
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline.scenario import workspace
from lis_grasp.pipeline.stages import make_policy
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.shapes import Shape
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.surfaces import ESTIMATORS
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.tables import grouped_table, mean_cell, split, where

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


def reachable_points(shape: Shape) -> np.ndarray:
    points, faces = sample_mesh(shape.mesh, 3000)
    centers = points + TIP_RADIUS * shape.mesh.face_normals[faces]
    free, _ = distances_to_mesh(centers, shape.mesh)
    return points[free > 0.98 * TIP_RADIUS]


def edge_error(shape: Shape, contacts: Contacts) -> float:
    mesh = extract_mesh(ESTIMATORS["blend"](contacts), resolution=shape.size / 40)
    off, _ = distances_to_mesh(sample_segments(shape.edges, 800), mesh)
    return float(np.sqrt(np.mean(off**2)))


def measure(trial: PolicyTrial, policy: str) -> Row:
    """Return how an exploration covers an object, and its edge errors."""
    shape = shapes.build(trial.object, shapes.PAPER_SIZE)
    space = workspace(shape)
    exploration = explore(
        KinematicProber(Hand.load("allegro"), shape.mesh),
        ExplorationSetup(
            make_policy(policy, space, TactileSensor()),
            ESTIMATORS[POLICIES[policy]],
            touches=trial.touches,
            space=space,
        ),
        rng=np.random.default_rng(trial.seed),
    )
    contacts = exploration.contacts
    apart = np.linalg.norm(reachable_points(shape)[:, None] - contacts.points, axis=-1)
    nearest = np.minimum.accumulate(apart, axis=1)  # (P, N)
    counts = [k for k in EDGE_COUNTS if k <= len(contacts) and len(shape.edges)]
    probes = _probes_at_contacts(exploration)
    return {
        "coverage": np.mean(nearest < space.step, axis=0).tolist(),
        "probes": probes,
        "seconds": motion_seconds(exploration, space)[np.array(probes) - 1].tolist(),
        "edges": {str(k): edge_error(shape, contacts.subset(slice(0, k))) for k in counts},
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


MEASURES: dict[str, Callable[[Row], float]] = {
    "touches to 90 %": lambda row: touches_to_cover(row, probes=False),
    "probes to 90 %": lambda row: touches_to_cover(row, probes=True),
    "seconds to 90 %": lambda row: seconds_until(row, touches_to_cover(row, probes=False)),
    "touches to 2 mm": touches_to_edges,
    "seconds to 2 mm": lambda row: seconds_until(row, touches_to_edges(row)),
}


def interval(values: np.ndarray) -> tuple[float, float, float]:
    """Return the mean of (objects, seeds), and its 95 % interval over seeds."""
    rng = np.random.default_rng(0)
    drawn = rng.integers(values.shape[1], size=(2000, values.shape[1]))
    low, high = np.quantile(values[:, drawn].mean(axis=(0, 2)), [0.025, 0.975])
    return float(values.mean()), float(low), float(high)


def by_object(rows: Sequence[Row], measure: Callable[[Row], object]) -> np.ndarray:
    """Return values (objects, seeds, ...) of the rows of one policy."""
    return np.array([[measure(r) for r in part] for part in split(rows, "object").values()], float)


def measured(rows: Sequence[Row]) -> list[Row]:
    """Return rows with their measures; those of edges only where there are edges."""
    return [
        row | {n: m(row) for n, m in MEASURES.items() if row["edges"] or not n.endswith("2 mm")}
        for row in rows
    ]


def with_interval(name: str) -> Callable[[Sequence[Row]], str]:
    def cell(rows: Sequence[Row]) -> str:
        known = [row for row in rows if name in row]
        return "{:.1f} ({:.1f} to {:.1f})".format(*interval(by_object(known, lambda r: r[name])))

    return cell


def edge_errors(rows: Sequence[Row]) -> np.ndarray:
    """Return errors [mm] of (objects with edges, seeds, numbers of touches)."""
    edged = [row for row in rows if row["edges"]]
    return by_object(
        edged, lambda row: [1e3 * row["edges"].get(str(k), np.nan) for k in EDGE_COUNTS]
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


def print_means(errors: dict[str, np.ndarray]) -> None:
    """Print the touches to a mean error of 2 mm."""
    rng, seeds = np.random.default_rng(0), errors["spread"].shape[1]
    drawn = rng.integers(seeds, size=(2000, seeds))
    draws = {p: np.array([touches_to_mean(e[:, d]) for d in drawn]) for p, e in errors.items()}
    print("touches from which on the mean error at the edges, over objects, is 2 mm or less")
    for policy, values in errors.items():
        low, high = np.quantile(draws[policy], [0.025, 0.975], method="nearest")
        print(f"{policy:12s} {touches_to_mean(values):5.1f} ({low:.1f} to {high:.1f})")


def plot(rows: Sequence[Row], path: Path) -> None:
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.6), layout="constrained")
    touches = min(len(row["coverage"]) for row in rows)
    counts = np.arange(1, touches + 1)
    for policy, part in split(rows, "policy").items():
        covered = by_object(part, lambda row: row["coverage"][:touches])
        for axes, x, values in (
            (left, counts, 100.0 * covered),
            (right, np.array(EDGE_COUNTS), edge_errors(part)),
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
    defaults = {"seeds": 10, "first_seed": 0, "touches": 40, "jobs": 2}
    options = read_options(__doc__, **defaults, output=Path("results/policies"))
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    trials = [PolicyTrial(name, seed, options.touches) for seed in seeds for name in shapes.NAMES]
    experiment = Experiment("policies", measure, variant="policy")
    file = options.output / "rows.jsonl"
    rows = measured(experiment.complete(trials, list(POLICIES), file, jobs=options.jobs))
    columns = [(name, with_interval(name)) for name in MEASURES]
    groups = split(rows, "policy")
    print(grouped_table("policies", "Mean (95 %)", "policy", groups, columns).text())
    print_means({policy: edge_errors(part) for policy, part in groups.items()})
    columns = [
        (
            policy,
            lambda rows, p=policy: " | ".join(
                mean_cell(n, digits=0)(where(rows, policy=p))
                for n in ("touches to 90 %", "touches to 2 mm")
            ),
        )
        for policy in POLICIES
    ]
    title = "Touches to 90 % | to 2 mm"
    print(grouped_table("objects", title, "object", split(rows, "object"), columns).text())
    plot(rows, options.output / "policies.png")


if __name__ == "__main__":
    main()
