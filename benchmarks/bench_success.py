"""Lifted and held, planned on the true mesh, on 40 touches, and on 15: objects x seeds, two hands.

    python benchmarks/bench_success.py box torus 004_sugar_box.ply --seeds 20

Objects are of graspable size, 0.2 kg, friction 0.8, and touched by geometry alone. `truth` plans on
the true mesh, the others on the `blend` surface of the first touches; these grasp by touch, three
attempts at the most. A grasp is held that lifts the object, survives shakes of half and of one g
along and about every axis, and has it still at rest in the hand. Intervals: Wilson, 95 %.

Goes on where it was when run again with the same folder.
"""

from __future__ import annotations

import argparse
from collections import Counter
from concurrent.futures import as_completed
from pathlib import Path

import numpy as np
from bench_calibration import tell_calibration
from scipy.stats import binomtest

from lis_grasp import Hand, shapes
from lis_grasp.io.json_lines import append_lines, read_lines
from lis_grasp.pipeline import lift, plan, support_height, touch
from lis_grasp.pipeline.regrasp import grasp_with_tactile_check
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.worker_pool import worker_pool

PLANS = (("allegro", "truth"), ("allegro", 40), ("allegro", 15), ("wsg50", "truth"), ("wsg50", 40))
HEADER = {"benchmark": "success", "format": 2}

Row = dict


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("objects", nargs="*", default=list(shapes.NAMES))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--output", type=Path, default=Path("results/success"))
    options = parser.parse_args()
    path = options.output / "rows.jsonl"
    wanted = [(name, seed) for seed in range(options.seeds) for name in options.objects]
    known = {(row["object"], row["seed"]) for row in read_lines(path)[1]}
    with worker_pool(options.jobs) as pool:
        pending = [pool.submit(trials, *job) for job in wanted if job not in known]
        for done, future in enumerate(as_completed(pending), start=1):
            append_lines(path, HEADER, future.result())
            print(f"\r{done} of {len(pending)}", end="", flush=True)
    print()
    report([row for row in read_lines(path)[1] if (row["object"], row["seed"]) in set(wanted)])


def trials(name: str, seed: int) -> list[Row]:
    """Return one row for each hand and each way to plan."""
    shape = shapes.build(name) if name in shapes.NAMES else shapes.load(name)
    rows = []
    for hand_name in dict.fromkeys(hand for hand, _ in PLANS):
        hand = Hand.load(hand_name)
        config = RunConfig(object=name, hand=hand_name, seed=seed, prober="kinematic")
        exploration = touch(shape, hand, config)
        for planned_on in [on for which, on in PLANS if which == hand_name]:
            attempts, outcome, foretold = 1, None, None
            if planned_on == "truth":
                search = plan(
                    shape.mesh,
                    hand,
                    support=support_height(shape),
                    friction=config.friction,
                    count=config.grasps,
                    seed=seed,
                )
                if search.grasps:
                    foretold = search.grasps[0].quality["success_probability"]
                    outcome = lift(
                        shape, hand, search.grasps[0], mass=config.mass, friction=config.friction
                    )
            else:
                known = exploration.first(int(planned_on))
                tried = list(grasp_with_tactile_check(shape, hand, known, config))
                attempts, outcome = len(tried), tried[-1].outcome
                if outcome is not None:
                    grasp = tried[-1].search.grasps[tried[-1].rank]
                    foretold = grasp.quality["success_probability"]
            rows.append(
                {
                    "object": name,
                    "seed": seed,
                    "hand": hand_name,
                    "planned_on": planned_on,
                    "attempts": attempts,
                    "foretold": foretold,
                    "reason": "no_grasp" if outcome is None else outcome.reason,
                    "lifted": outcome is not None and outcome.lifted,
                    "survived": 0.0 if outcome is None else outcome.acceleration_survived,
                }
            )
    return rows


def report(rows: list[Row]) -> None:
    print(
        "hand, planned on: held (95 %); survived 1 g of those lifted; attempts; what else happened"
    )
    for hand, planned_on in PLANS:
        chosen = [r for r in rows if (r["hand"], r["planned_on"]) == (hand, planned_on)]
        held = sum(row["reason"] == "held" for row in chosen)
        low, high = binomtest(held, len(chosen)).proportion_ci(method="wilson")
        lifted = [row for row in chosen if row["lifted"]]
        survived = sum(row["survived"] > 9.8 for row in lifted)
        failures = Counter(
            f"{Path(row['object']).stem}: {row['reason']}"
            for row in chosen
            if row["reason"] != "held"
        )
        print(
            f"{hand}, {planned_on}: {held} of {len(chosen)} ({low:.0%} to {high:.0%});"
            f" {survived} of {len(lifted)}; {np.mean([r['attempts'] for r in chosen]):.2f};"
            f" {dict(failures)}"
        )
    for hand in dict.fromkeys(hand for hand, _ in PLANS):
        tried = [r for r in rows if r["hand"] == hand and r["foretold"] is not None]
        print(f"\n{hand}: of {len(tried)} grasps executed")
        tell_calibration(
            np.array([row["foretold"] for row in tried]),
            np.array([row["reason"] == "held" for row in tried]),
        )


if __name__ == "__main__":
    main()
