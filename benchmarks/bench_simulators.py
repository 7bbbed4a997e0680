"""Agreement of the two simulators, Drake and MuJoCo: the same grasps lifted in both.

    python benchmarks/bench_simulators.py --grasps 12

Objects are the built-in shapes and the six further ones of the table of hands, on the three shipped
hands. Of each object and hand, half of the grasps are good: the best planned on the true mesh,
lifted at 0.2 kg and friction 0.8. The other half is doubtful, so that both outcomes occur: the same
grasps, with the object displaced by 10 mm along x and y and turned by 10 degrees about z (standard
deviations), at 0.1 to 1 kg and friction 0.15 to 0.6.

Where the simulators disagree, `--limits` repeats both lifts with a tenth more and less mass and
friction, and displaced by 0.5 mm: outcomes that change are at the limit of the grip.

Continues where it stopped when run again with the same folder. To lift in one simulator again, as
after a change of it, remove its file of rows.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from lis_grasp import Hand, shapes
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.io.json_lines import Row, append_lines, read_lines
from lis_grasp.lifting.outcome import LiftOutcome
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.motion import OBJECT
from lis_grasp.pipeline import plan
from lis_grasp.robots.shipped_models import HAND_NAMES
from lis_grasp.simulation.drake.lift import simulate_lift as lift_in_drake
from lis_grasp.simulation.mujoco.lift import simulate_lift as lift_in_mujoco
from lis_grasp_studies.hand_table import FURTHER_OBJECTS
from lis_grasp_studies.test_objects.shape_sets import graspable_shape

SIMULATORS = {"drake": lift_in_drake, "mujoco": lift_in_mujoco}
GOOD = {"mass": 0.2, "friction": 0.8}
DISPLACEMENT, TURN = 0.01, np.deg2rad(10.0)  # standard deviations of a doubtful grasp [m, rad]
MASSES, FRICTIONS = (0.1, 1.0), (0.15, 0.6)  # of doubtful grasps [kg, 1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--objects", nargs="+", default=[*shapes.NAMES, *FURTHER_OBJECTS])
    parser.add_argument("--hands", nargs="+", default=HAND_NAMES)
    parser.add_argument("--grasps", type=int, default=12, help="of each object and hand")
    parser.add_argument("--simulators", nargs="*", default=list(SIMULATORS), choices=SIMULATORS)
    parser.add_argument("--output", type=Path, default=Path("results/simulators"))
    parser.add_argument("--limits", action="store_true", help="repeat lifts that disagree")
    options = parser.parse_args()
    count = options.grasps // 2
    for rank in range(count):  # all objects and hands early, so that an interrupted run has each
        for name in options.objects:
            for hand in options.hands:
                planned = planned_grasps(options.output, name, hand, count)
                for simulator in options.simulators if rank < len(planned.grasps) else ():
                    lift(options.output, simulator, name, hand, rank, planned.grasps[rank])
    report(options.output)
    if options.limits:
        report_limits(options.output, count)


@cache
def mesh_of(name: str) -> trimesh.Trimesh:
    if name in shapes.NAMES:
        return shapes.build(name).mesh
    return graspable_shape(name).mesh


def planned_grasps(folder: Path, name: str, hand: str, count: int) -> GraspSearch:
    """Return the best grasps on the true mesh, from the folder if they were planned before."""
    path = folder / "grasps" / f"{name}-{hand}.json"
    if not path.exists():
        mesh = mesh_of(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        support = float(mesh.bounds[0, 2])
        loaded = Hand.load(hand)
        plan(mesh, loaded, support=support, friction=0.8, count=count, seed=0).save(path)
    return GraspSearch.load(path)


def lift(folder: Path, simulator: str, name: str, hand: str, rank: int, grasp: Grasp) -> None:
    """Lift with a grasp in both conditions, and append the rows that are not there yet."""
    path = folder / f"{simulator}.jsonl"
    done = {key(row) for row in read_lines(path)[1]}
    loaded = Hand.load(hand)
    for quality in ("good", "doubtful"):
        if (name, hand, rank, quality) in done:
            continue
        conditions = conditions_of(name, hand, rank, quality)
        start = time.perf_counter()
        outcome = simulate(simulator, name, loaded, grasp, conditions)
        facts = {"object": name, "hand": hand, "rank": rank, "quality": quality}
        facts |= {"mass": conditions["mass"], "friction": conditions["friction"]}
        facts["seconds"] = round(time.perf_counter() - start, 2)
        append_lines(path, {"simulator": simulator}, [facts | facts_of(outcome, loaded)])
        print(f"{simulator} {name} {hand} {rank} {quality}: {outcome.reason}", flush=True)


def simulate(simulator: str, name: str, hand: Hand, grasp: Grasp, conditions: dict) -> LiftOutcome:
    """Return the outcome of a lift in a simulator."""
    mesh = mesh_of(name)
    height = float(mesh.bounds[0, 2])
    return SIMULATORS[simulator](LiftSetup(mesh, hand, grasp, height, **conditions))


def conditions_of(name: str, hand: str, rank: int, quality: str) -> dict:
    """Return mass, friction and the object's pose X_WO of a grasp; the same in both simulators."""
    if quality == "good":
        return GOOD
    rng = np.random.default_rng([*name.encode(), *hand.encode(), rank])
    X_WO = np.eye(4)
    X_WO[:3, :3] = Rotation.from_rotvec([0.0, 0.0, rng.normal(0.0, TURN)]).as_matrix()
    X_WO[:2, 3] = rng.normal(0.0, DISPLACEMENT, 2)
    mass = float(np.exp(rng.uniform(*np.log(MASSES))))
    return {"mass": mass, "friction": float(rng.uniform(*FRICTIONS)), "X_WO": X_WO}


def facts_of(outcome: LiftOutcome, hand: Hand) -> Row:
    X_WH = outcome.motion.poses[hand.base_link][-1] @ hand.X_LH
    X_HO = np.linalg.inv(X_WH) @ outcome.motion.poses[OBJECT][-1]
    return {
        "lifted": outcome.lifted,
        "held": outcome.held,
        "reason": outcome.reason,
        "slip": outcome.slip,
        "turn": outcome.turn,
        "survived": outcome.acceleration_survived,
        "duration": outcome.duration,
        "touching": sorted(outcome.measured_contacts.fingers or ()),
        "X_HO": X_HO.round(6).tolist(),
    }


def key(row: Row) -> tuple:
    return row["object"], row["hand"], row["rank"], row["quality"]


def report(folder: Path) -> None:
    """Print agreement by object, hand and quality, and the reasons against each other."""
    pairs = pairs_in(folder)
    if not pairs:
        return
    print("\n| grasps | number | held in Drake | held in MuJoCo | agree |", end="")
    print(" agree on lifted | kappa |\n|---|---|---|---|---|---|---|")
    print(line("all", pairs))
    for field in ("quality", "hand", "object"):
        for value in dict.fromkeys(first[field] for first, _ in pairs):
            print(line(value, [pair for pair in pairs if pair[0][field] == value]))
    counts = Counter((first["reason"], second["reason"]) for first, second in pairs)
    columns = sorted({second for _, second in counts})
    print(f"\n| Drake \\ MuJoCo | {' | '.join(columns)} |\n|---|{'---|' * len(columns)}")
    for reason in sorted({first for first, _ in counts}):
        print(f"| {reason} | {' | '.join(str(counts[reason, c] or '') for c in columns)} |")
    for name, rows in zip(SIMULATORS, zip(*pairs, strict=True), strict=True):
        held = [row["slip"] for row in rows if row["held"]]
        seconds = np.median([row["seconds"] for row in rows])
        print(
            f"\n{name}: slip of held {1e3 * np.median(held):.1f} mm, {seconds:.1f} s a lift", end=""
        )
    print("\n\ndisagreements:")
    for first, second in disagreements(folder):
        outcomes = (
            f"{row['reason']} at {row['duration']:.1f} s, slip {1e3 * row['slip']:.1f} mm, turn"
            f" {np.degrees(row['turn']):.0f} deg"
            for row in (first, second)
        )
        load = f"{first['mass']:.2f} kg {first['friction']:.2f}"
        print(f"{' '.join(map(str, key(first)))} {load}: {'; '.join(outcomes)}")


def pairs_in(folder: Path) -> list[tuple[Row, Row]]:
    """Return the rows of both simulators of the same grasps."""
    found = [{key(r): r for r in read_lines(folder / f"{s}.jsonl")[1]} for s in SIMULATORS]
    return [(found[0][k], found[1][k]) for k in found[0] if k in found[1]]


def disagreements(folder: Path) -> list[tuple[Row, Row]]:
    """Return the pairs of rows that do not agree on `held`."""
    return [pair for pair in pairs_in(folder) if pair[0]["held"] != pair[1]["held"]]


def report_limits(folder: Path, count: int) -> None:
    """Print how often lifts that disagree are held in slightly different conditions."""
    print(
        "\nheld in Drake and in MuJoCo, of mass and friction x 0.9, 1.1, and 0.5 mm aside in x, y:"
    )
    for first, second in disagreements(folder):
        name, hand, rank, quality = key(first)
        grasp, loaded = planned_grasps(folder, name, hand, count).grasps[rank], Hand.load(hand)
        conditions = {"X_WO": np.eye(4)} | conditions_of(name, hand, rank, quality)
        changed = [
            conditions | {what: factor * conditions[what]}
            for what in ("mass", "friction")
            for factor in (0.9, 1.1)
        ]
        for axis in (0, 1):
            X_WO = conditions["X_WO"].copy()
            X_WO[axis, 3] += 5e-4
            changed.append(conditions | {"X_WO": X_WO})
        held = [
            [int(simulate(simulator, name, loaded, grasp, each).held) for each in changed]
            for simulator in SIMULATORS
        ]
        at_limit = any(
            len({own, *varied}) > 1
            for own, varied in zip((int(first["held"]), int(second["held"])), held, strict=True)
        )
        label = "at the limit" if at_limit else "NOT at the limit"
        print(f"{' '.join(map(str, key(first)))}: {held[0]}, {held[1]}: {label}", flush=True)


def line(name: str, pairs: Sequence[tuple[Row, Row]]) -> str:
    held = np.array([[row["held"] for row in pair] for pair in pairs])
    lifted = np.array([[row["lifted"] for row in pair] for pair in pairs])
    agree = float((held[:, 0] == held[:, 1]).mean())
    rates = held.mean(axis=0)
    chance = float(rates.prod() + (1.0 - rates).prod())
    kappa = "" if chance == 1.0 else f"{(agree - chance) / (1.0 - chance):.2f}"
    return (
        f"| {name} | {len(pairs)} | {held[:, 0].sum()} | {held[:, 1].sum()} | {100 * agree:.0f} %"
        f" | {100 * (lifted[:, 0] == lifted[:, 1]).mean():.0f} % | {kappa} |"
    )


if __name__ == "__main__":
    main()
