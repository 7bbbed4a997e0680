"""`lis-grasp motion`: joint trajectories of an arm for a grasp and its lift."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from lis_grasp.arms.placement import best_bases
from lis_grasp.arms.station import Station, Table
from lis_grasp.arms.transit import GraspMotion, closing_motion, plan_grasp_motion
from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import Stage, say
from lis_grasp.exceptions import InvalidFileError, InvalidOptionError, LisGraspError
from lis_grasp.geometry import require_pose
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.io.surface_files import load_surface
from lis_grasp.io.trajectory_files import write_joint_trajectory, write_trajectory_csv
from lis_grasp.results.summary import REJECTIONS
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.shipped_models import ARM_NAMES
from lis_grasp.stages.configured_arm import base_at
from lis_grasp.stages.surroundings import find_surroundings
from lis_grasp.task.recorded_facts import read_facts, recorded_base
from lis_grasp.task.task import Task


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    parser.add_argument("grasps_file", type=Path, metavar="GRASPS", help="grasps.json of `grasp`")
    parser.add_argument(
        "--arm",
        metavar="ARM",
        help="an arm's YAML file, or a name: iiwa14; of vendors' arms franka_panda, ur5e and more"
        f" (default: as recorded, else {ARM_NAMES[0]})",
    )
    parser.add_argument(
        "--base",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="place of the arm's base [m]: z above the table (default: as recorded, else chosen)",
    )
    parser.add_argument(
        "--rank", type=int, metavar="N", help="rank of the grasp (default: the best within reach)"
    )
    opt.add_options(parser, "hand", "seed", recorded=True)
    opt.add_output(parser, "motion in the folder of GRASPS")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Plan the motion, and write its parts as CSV and YAML."""
    recorded = read_facts(options.grasps_file, usual="grasps.json")
    name = options.arm or recorded.get("arm") or ARM_NAMES[0]
    task = Task.from_facts(vars(options), {**recorded, "arm": name})
    hand = Hand.load(task.robot.hand)
    grasps = _grasps(options.grasps_file, options.rank, hand)
    folder = options.output or options.grasps_file.parent / "motion"
    surface = options.grasps_file.with_name("surface.ply")
    mesh = load_surface(surface) if surface.is_file() else None
    if mesh is None:
        say(f"warning: without {surface} the paths do not avoid the object")
    height = float(recorded.get("support_height", 0.0))
    X_WE = require_pose("X_WE", recorded.get("X_WE", np.eye(4)))
    arm, surroundings = Arm.load(name), find_surroundings(task, height).in_frame(X_WE)
    with Stage(f"Planning the motion of {arm.name} with {hand.name}") as stage:
        rank, station, motion = _first_motion(
            grasps,
            _stations(options, recorded, arm, hand, Table(height, surroundings=surroundings)),
            mesh,
            rng=np.random.default_rng(task.seed),
        )
        stage.result = (
            f"grasp {rank}, {motion.approach.duration:.1f} s to it, {motion.lift.duration:.1f} s up"
        )
    closing = closing_motion(hand, grasps[rank])
    for name, part in (("approach", motion.approach), ("close", closing), ("lift", motion.lift)):
        columns = part.joint_names, part.times, part.positions, part.velocities
        write_trajectory_csv(folder / f"{name}.csv", *columns)
        write_joint_trajectory(folder / f"{name}.yaml", *columns, part.accelerations)
    place = ", ".join(f"{x:.3f}" for x in station.X_WA[:3, 3])
    say(f"base of {arm.name} at ({place}) m in the frame of the grasps")
    say(f"wrote {folder}: approach, close and lift, each as .csv and .yaml")


def _first_motion(
    grasps: Mapping[int, Grasp],
    stations: Sequence[Station],
    mesh: trimesh.Trimesh | None,
    *,
    rng: np.random.Generator,
) -> tuple[int, Station, GraspMotion]:
    """Return the first grasp that a station can carry out, by its rank, and its motion."""
    reasons: Counter[str] = Counter()
    for rank, grasp in grasps.items():
        for station in stations:
            motion = plan_grasp_motion(station, mesh, grasp, rng=rng)
            if not isinstance(motion, str):
                return rank, station, motion
            reasons[motion] += 1
    most = reasons.most_common(1)[0][0]
    raise LisGraspError(
        f"arm {stations[0].arm.name} has no motion for {len(grasps)} grasps, mostly because"
        f" {REJECTIONS.get(most, most)}; plan grasps within its reach"
    )


def _grasps(path: Path, rank: int | None, hand: Hand) -> dict[int, Grasp]:
    """Return the grasps of a file by rank, or the one of the given rank."""
    grasps = dict(enumerate(GraspSearch.load(path).grasps, start=1))
    if not grasps:
        raise InvalidFileError(f"{path} must have a grasp; it has none: plan again", path=path)
    if rank not in (None, *grasps):
        raise InvalidOptionError.out_of_range("rank", rank, f"1 to {len(grasps)} in {path.name}")
    names = {grasp.hand for grasp in grasps.values() if grasp.joint_names != hand.joint_names}
    if names:
        raise InvalidOptionError(
            f"hand must be the one of the grasps, {', '.join(names)}; it is {hand.name}",
            option="hand",
            value=hand.name,
        )
    return grasps if rank is None else {rank: grasps[rank]}


def _stations(
    options: argparse.Namespace, recorded: dict[str, Any], arm: Arm, hand: Hand, table: Table
) -> list[Station]:
    """Return the stations to try: at the given, else recorded, else several bases, best first."""
    X_EA = recorded_base(vars(options), recorded)
    if X_EA is None and options.base is not None:
        X_EA = base_at(options.base, table.height)
    if X_EA is None:
        return best_bases(arm, hand, table=table)
    return [Station.make(arm, hand, X_EA, table=table)]
