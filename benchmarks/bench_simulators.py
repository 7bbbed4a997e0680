"""Agreement of the two simulators, Drake and MuJoCo: the same grasps lifted in both.

    python benchmarks/bench_simulators.py --grasps 12

Objects are the built-in shapes and the six further ones of the table of hands, on the three shipped
hands. Of each object and hand, half of the grasps are good: the best planned on the true mesh,
lifted at 0.2 kg and friction 0.8. The other half is doubtful, so that both outcomes occur: the same
grasps, with the object displaced by 10 mm along x and y and turned by 10 degrees about z (standard
deviations), at 0.1 to 1 kg and friction 0.15 to 0.6.

Where the simulators disagree, `--limits` repeats both lifts with a tenth more and less mass and
friction, and displaced by 0.5 mm: outcomes that change are at the limit of the grip.

Continues where it stopped when run again with the same folder.
"""

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from lis_grasp import Hand, shapes
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.io.json_lines import Row
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.pipeline import plan
from lis_grasp.robots.shipped_models import HAND_NAMES
from lis_grasp.simulation.drake.lift import simulate_lift as lift_in_drake
from lis_grasp.simulation.mujoco.lift import simulate_lift as lift_in_mujoco
from lis_grasp_studies.hand_table import FURTHER_OBJECTS
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.tables import Column, grouped_table, median_cell, split, where
from lis_grasp_studies.test_objects.shape_sets import graspable_shape

SIMULATORS = {"drake": lift_in_drake, "mujoco": lift_in_mujoco}
GOOD = {"mass": 0.2, "friction": 0.8}
DISPLACEMENT, TURN = 0.01, np.deg2rad(10.0)  # standard deviations of a doubtful grasp [m, rad]
MASSES, FRICTIONS = (0.1, 1.0), (0.15, 0.6)  # of doubtful grasps [kg, 1]
ASIDE = 5e-4  # [m]


@dataclass(frozen=True)
class GraspTrial:
    object: str
    hand: str
    rank: int
    quality: str
    count: int  # grasps planned of an object and hand

    @property
    def conditions(self) -> dict:
        """Mass, friction and the object's pose X_WO; the same in both simulators."""
        if self.quality == "good":
            return GOOD
        rng = np.random.default_rng([*self.object.encode(), *self.hand.encode(), self.rank])
        X_WO = np.eye(4)
        X_WO[:3, :3] = Rotation.from_rotvec([0.0, 0.0, rng.normal(0.0, TURN)]).as_matrix()
        X_WO[:2, 3] = rng.normal(0.0, DISPLACEMENT, 2)
        mass = float(np.exp(rng.uniform(*np.log(MASSES))))
        return {"mass": mass, "friction": float(rng.uniform(*FRICTIONS)), "X_WO": X_WO}


@lru_cache(maxsize=4)
def planned(name: str, hand_name: str, count: int) -> tuple[trimesh.Trimesh, Hand, list[Grasp]]:
    shape = shapes.build(name) if name in shapes.NAMES else graspable_shape(name)
    mesh, hand = shape.mesh, Hand.load(hand_name)
    support = float(mesh.bounds[0, 2])
    search = plan(mesh, hand, support=support, friction=0.8, count=count, seed=0)
    return mesh, hand, list(search.grasps)


def outcome(trial: GraspTrial, simulator: str, conditions: dict | None = None) -> Row:
    mesh, hand, grasps = planned(trial.object, trial.hand, trial.count)
    if trial.rank >= len(grasps):
        return {"reason": None}
    conditions = trial.conditions if conditions is None else conditions
    start, height = time.perf_counter(), float(mesh.bounds[0, 2])
    result = SIMULATORS[simulator](LiftSetup(mesh, hand, grasps[trial.rank], height, **conditions))
    names = ("lifted", "held", "reason", "slip", "turn", "duration")
    facts = {name: conditions[name] for name in GOOD}
    facts["seconds"] = round(time.perf_counter() - start, 2)
    return facts | {name: getattr(result, name) for name in names}


def changed(trial: GraspTrial, simulator: str) -> Row:
    """Return how often a lift is held in slightly different conditions."""
    conditions = {"X_WO": np.eye(4)} | trial.conditions
    cases = [
        conditions | {what: factor * conditions[what]} for what in GOOD for factor in (0.9, 1.1)
    ]
    for axis in (0, 1):
        X_WO = conditions["X_WO"].copy()
        X_WO[axis, 3] += ASIDE
        cases.append(conditions | {"X_WO": X_WO})
    return {"held": [bool(outcome(trial, simulator, case)["held"]) for case in cases]}


def pairs_of(rows: Sequence[Row]) -> list[tuple[Row, Row]]:
    """Return the rows of both simulators of the same grasps."""
    groups = split(rows, *GraspTrial.__dataclass_fields__)
    return [tuple(group) for group in groups.values() if len(group) == 2]


def disagreements(rows: Sequence[Row]) -> list[tuple[Row, Row]]:
    return [(drake, mujoco) for drake, mujoco in pairs_of(rows) if drake["held"] != mujoco["held"]]


def agreement(rows: Sequence[Row], column: str) -> str:
    same = [drake[column] == mujoco[column] for drake, mujoco in pairs_of(rows)]
    return f"{100.0 * np.mean(same):.0f} %"


def kappa(rows: Sequence[Row]) -> str:
    """Return Cohen's kappa of both simulators' `held`."""
    held = np.array([[row["held"] for row in pair] for pair in pairs_of(rows)])
    agree, rates = float((held[:, 0] == held[:, 1]).mean()), held.mean(axis=0)
    chance = float(rates.prod() + (1.0 - rates).prod())
    return "" if chance == 1.0 else f"{(agree - chance) / (1.0 - chance):.2f}"


COLUMNS: list[Column] = [
    ("grasps", lambda rows: str(len(pairs_of(rows)))),
    ("held in Drake", lambda rows: str(len(where(rows, simulator="drake", held=True)))),
    ("held in MuJoCo", lambda rows: str(len(where(rows, simulator="mujoco", held=True)))),
    ("agree", lambda rows: agreement(rows, "held")),
    ("agree on lifted", lambda rows: agreement(rows, "lifted")),
    ("kappa", kappa),
]


def report(rows: Sequence[Row]) -> None:
    """Print agreement by object, hand and quality, reasons against each other, disagreements."""
    groups = {"all": rows}
    for column in ("quality", "hand", "object"):
        groups |= split(rows, column)
    print(grouped_table("agreement", "Agreement", "grasps", groups, COLUMNS).markdown())
    both = Counter((drake["reason"], mujoco["reason"]) for drake, mujoco in pairs_of(rows))
    print("reasons in Drake, in MuJoCo:", dict(both.most_common()))
    held = split(where(rows, held=True), "simulator")
    columns = [("slip [mm]", median_cell("slip", 1e3)), ("a lift [s]", median_cell("seconds"))]
    print(grouped_table("held", "Held, medians", "simulator", held, columns).markdown())
    for pair in disagreements(rows):
        ends = (f"{row['reason']}, slip {1e3 * row['slip']:.1f} mm" for row in pair)
        print(*(pair[0][name] for name in GraspTrial.__dataclass_fields__), "; ".join(ends))


def main() -> None:
    defaults = {"objects": [*shapes.NAMES, *FURTHER_OBJECTS], "hands": list(HAND_NAMES)}
    defaults |= {"grasps": 12, "limits": False, "jobs": 2}
    options = read_options(__doc__, **defaults, output=Path("results/simulators"))
    count = options.grasps // 2
    trials = [
        GraspTrial(name, hand, rank, quality, count)
        for rank in range(count)
        for name in options.objects
        for hand in options.hands
        for quality in ("good", "doubtful")
    ]

    def complete(kind: str, measure, trials: list[GraspTrial]) -> list[Row]:
        experiment = Experiment(kind, measure, variant="simulator")
        file = options.output / f"{kind}.jsonl"
        return experiment.complete(trials, list(SIMULATORS), file, jobs=options.jobs)

    rows = [r for r in complete("simulators", outcome, trials) if r["reason"] is not None]
    report(rows)
    if options.limits:
        names = GraspTrial.__dataclass_fields__
        differing = [GraspTrial(**{n: row[n] for n in names}) for row, _ in disagreements(rows)]
        for drake, mujoco in pairs_of(complete("limits", changed, differing)):
            at_limit = any(len(set(row["held"])) > 1 for row in (drake, mujoco))
            label = "at the limit" if at_limit else "NOT at the limit"
            print(*(drake[name] for name in names), drake["held"], mujoco["held"], label)


if __name__ == "__main__":
    main()
