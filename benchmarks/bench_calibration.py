"""Does a grasp hold as often as foretold? Lifts planned on few touches.

    python benchmarks/bench_calibration.py box torus 004_sugar_box.ply --seeds 0 1

Each object is touched 15 times by geometry alone. Surfaces of the first 5, 8 and 15 contacts
(`blend`), 5 and 10 (`gpis`), and 8 (`lis`) are grasped; the best grasp and the last of ten are
lifted. Prints the expected calibration error (ten bins of equal width, weighted by what is in
them) of `success_probability`, what was foretold and what held for each estimator, how well it
orders (area under the ROC curve), and a logistic fit to the lifts of `blend`. The constants in use
and the lifts that they were fitted to are in `lis_grasp/grasping/success_model.json`: evaluate with
other seeds. Also: how often grasps held that fingers felt to be in force closure at half the
friction, and others.

Goes on where it was when run again with the same folder.
"""

from __future__ import annotations

import argparse
from concurrent.futures import as_completed
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.stats import rankdata

from lis_grasp import Contacts, Hand, shapes
from lis_grasp.evaluation.calibration import calibration_bins, expected_calibration_error
from lis_grasp.exceptions import EstimationError, InvalidContactsError
from lis_grasp.grasping.grasp_ranking import SUCCESS_MODEL, robust_epsilon_on
from lis_grasp.io.json_lines import append_lines, read_lines
from lis_grasp.pipeline import estimate, lift, plan, support_height, touch
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.worker_pool import worker_pool

BUDGETS = (("blend", 5), ("blend", 8), ("blend", 15), ("gpis", 5), ("gpis", 10), ("lis", 8))
HEADER = {"benchmark": "calibration", "format": 1}

Row = dict


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("objects", nargs="*", default=list(shapes.NAMES))
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--hand", default="allegro")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--output", type=Path, default=Path("results/calibration"))
    options = parser.parse_args()
    path = options.output / "rows.jsonl"
    wanted = [(name, seed, options.hand) for seed in options.seeds for name in options.objects]
    known = {(row["object"], row["seed"], row["hand"]) for row in read_lines(path)[1]}
    with worker_pool(options.jobs) as pool:
        pending = [pool.submit(lifts, *job) for job in wanted if job not in known]
        for done, future in enumerate(as_completed(pending), start=1):
            append_lines(path, HEADER, future.result())
            print(f"\r{done} of {len(pending)} objects", end="", flush=True)
    print()
    rows = [r for r in read_lines(path)[1] if (r["object"], r["seed"], r["hand"]) in set(wanted)]
    report([row for row in rows if row["reason"] is not None])


def lifts(name: str, seed: int, hand_name: str) -> list[Row]:
    """Return one row a lift, or one that says that there was none."""
    shape = shapes.build(name) if name in shapes.NAMES else shapes.load(name)
    hand = Hand.load(hand_name)
    config = RunConfig(object=name, hand=hand_name, touches=15, seed=seed, prober="kinematic")
    exploration = touch(shape, hand, config)
    rows: list[Row] = [{"object": name, "seed": seed, "hand": hand_name, "reason": None}]
    for estimator, count in BUDGETS:
        rows += [
            {**rows[0], "estimator": estimator, "touches": count, **row}
            for row in _lifts_on(shape, hand, exploration.first(count), estimator, seed)
        ]
    return rows


def _lifts_on(
    shape: shapes.Shape, hand: Hand, contacts: Contacts, estimator: str, seed: int
) -> list[Row]:
    try:
        _, mesh = estimate(contacts, estimator)
    except (EstimationError, InvalidContactsError):
        return []
    support = support_height(shape)
    found = plan(mesh, hand, support=support, friction=0.8, count=10, seed=seed).grasps
    rows = []
    for grasp in dict.fromkeys([*found[:1], *found[-1:]]):
        outcome = lift(shape, hand, grasp, mass=0.2, friction=0.8)
        felt = outcome.measured_contacts
        rows.append(
            {
                **grasp.quality,
                "held": outcome.held,
                "reason": outcome.reason,
                "felt": robust_epsilon_on(mesh, hand, felt.points, felt.normals, friction=0.8)
                if len(felt) >= 2
                else None,
            }
        )
    return rows


def report(rows: list[Row]) -> None:
    held = np.array([row["held"] for row in rows])
    foretold = np.array([row["success_probability"] for row in rows])
    print(f"{len(rows)} lifts, {held.mean():.0%} held")
    tell_calibration(foretold, held)
    for estimator in dict.fromkeys(row["estimator"] for row in rows):
        mine = np.array([row["estimator"] == estimator for row in rows])
        print(
            f"{estimator}: {foretold[mine].mean():.2f} foretold, {held[mine].mean():.2f} of"
            f" {mine.sum()} held"
        )
    for name in ("success_probability", "epsilon_robust", "closure_probability"):
        print(f"area under the ROC curve of {name}: {_area([r[name] for r in rows], held):.3f}")
    default = np.array([row["estimator"] == "blend" for row in rows])
    fit = _fit([row for row, chosen in zip(rows, default, strict=True) if chosen], held[default])
    print("logistic fit to the lifts of blend:", np.round(fit, 2))
    felt = np.array([np.nan if row["felt"] is None else row["felt"] for row in rows])
    for name, chosen in (
        ("fewer than two fingers felt it", np.isnan(felt)),
        ("felt, no robust force closure", felt == 0.0),
        ("felt in robust force closure", felt > 0.0),
    ):
        print(f"{name}: {held[chosen].sum()} of {chosen.sum()} held")


def tell_calibration(foretold: np.ndarray, held: np.ndarray) -> None:
    """Print how often grasps held, by what was foretold, and the expected calibration error."""
    for count, probability, share in calibration_bins(foretold, held):
        print(f"foretold {probability:.2f}: {share:.2f} of {count} held")
    print(f"expected calibration error {expected_calibration_error(foretold, held):.3f}")


def _area(values: list[float], held: np.ndarray) -> float:
    """Return how often a grasp that held is above one that did not (Mann and Whitney)."""
    ranks, good = rankdata(values), held.sum()
    return float((ranks[held].sum() - good * (good + 1) / 2) / (good * (len(held) - good)))


def _fit(rows: list[Row], held: np.ndarray) -> np.ndarray:
    """Return the likeliest constants of the success probability, with a weak prior about 0."""
    columns = np.column_stack(
        [
            np.ones(len(rows)),
            *(
                np.log([row[name] + offset for row in rows])
                for name, offset in SUCCESS_MODEL["offsets"].items()
            ),
        ]
    )
    sign = np.where(held, -1.0, 1.0)

    def loss(w: np.ndarray) -> float:
        return float(np.logaddexp(0.0, sign * (columns @ w)).sum() + 0.05 * (w[1:] ** 2).sum())

    return minimize(loss, np.zeros(3)).x


if __name__ == "__main__":
    main()
