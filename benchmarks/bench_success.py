"""Success rates of lifts, planned on the true mesh, on 40 touches, and on 15: objects x seeds.

    python benchmarks/bench_success.py box torus 004_sugar_box.ply --seeds 20

Objects are of graspable size, 0.2 kg, friction 0.8, and touched by geometry alone. `truth` plans on
the true mesh, the others on the `blend` surface of the first touches; these grasp by touch, with
three attempts at most. A grasp is held that lifts the object, survives shakes of half and of one g
along and about every axis, and has it still at rest in the hand. Intervals: 95 %, for other seeds.

Continues where it stopped when run again with the same folder.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from bench_calibration import calibration_columns

from lis_grasp import Hand, shapes
from lis_grasp.exploration import Exploration
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline import Scenario, lift, plan, touch
from lis_grasp.pipeline.regrasp import grasp_with_tactile_check
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.tables import grouped_table, mean_cell, split
from lis_grasp_studies.study.cells import held_text

HANDS = {"allegro": ("truth", "40", "15"), "wsg50": ("truth", "40")}


@dataclass(frozen=True)
class LiftTrial:
    object: str
    seed: int
    hand: str


@lru_cache(maxsize=1)
def explored(trial: LiftTrial) -> tuple[Scenario, Exploration]:
    name, hand = trial.object, Hand.load(trial.hand)
    shape = shapes.build(name) if name in shapes.NAMES else shapes.load(name)
    facts = {"object": name, "hand": trial.hand, "seed": trial.seed}
    scenario = Scenario.from_config(RunConfig(**facts, prober="kinematic"), shape, hand)
    return scenario, touch(scenario)


def measure(trial: LiftTrial, planned_on: str) -> Row:
    scenario, exploration = explored(trial)
    attempts, outcome, predicted = 1, None, None
    if planned_on == "truth":
        for grasp in plan(scenario.known, scenario.truth.shape.mesh).grasps[:1]:
            predicted = grasp.quality["success_probability"]
            outcome = lift(scenario, grasp)
    else:
        contacts = exploration.first(int(planned_on))
        tried = list(grasp_with_tactile_check(scenario, contacts))
        attempts, outcome = len(tried), tried[-1].outcome
        if outcome is not None:
            grasp = tried[-1].search.grasps[tried[-1].rank]
            predicted = grasp.quality["success_probability"]
    return {
        "attempts": attempts,
        "predicted": predicted,
        "reason": "no_grasp" if outcome is None else outcome.reason,
        "held": outcome is not None and outcome.held,
        "lifted": outcome is not None and outcome.lifted,
        "survived": 0.0 if outcome is None else outcome.acceleration_survived,
    }


def survived(rows: Sequence[Row]) -> str:
    lifted = [row for row in rows if row["lifted"]]
    return f"{sum(row['survived'] > 9.8 for row in lifted)} of {len(lifted)}"


def failures(rows: Sequence[Row]) -> str:
    failed = [row for row in rows if not row["held"]]
    return str(dict(Counter(f"{Path(row['object']).stem}: {row['reason']}" for row in failed)))


def main() -> None:
    defaults = {"objects": list(shapes.NAMES), "seeds": 5, "jobs": 2}
    options = read_options(__doc__, **defaults, output=Path("results/success"))
    experiment = Experiment("success", measure, variant="planned_on")
    rows: list[Row] = []
    for hand, variants in HANDS.items():
        trials = [LiftTrial(n, s, hand) for s in range(options.seeds) for n in options.objects]
        file = options.output / "rows.jsonl"
        rows += experiment.complete(trials, variants, file, jobs=options.jobs)
    columns = [
        ("held [%] (95 %)", held_text),
        ("1 g survived, of those lifted", survived),
        ("attempts", mean_cell("attempts", digits=2)),
        ("other reasons", failures),
    ]
    groups = split(rows, "hand", "planned_on")
    print(grouped_table("success", "Success rates", "hand | planned on", groups, columns).text())
    executed = split((row for row in rows if row["predicted"] is not None), "hand")
    title = "Predicted and observed success"
    print(grouped_table("calibration", title, "hand", executed, calibration_columns()).text())


if __name__ == "__main__":
    main()
