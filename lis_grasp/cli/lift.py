"""`lis-grasp lift`: simulate the lift of planned grasps on the true object."""

from __future__ import annotations

import argparse
from pathlib import Path

from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import PRINTED, next_step, say
from lis_grasp.results.lifted_file import LIFTED_WITH, lift_file
from lis_grasp.results.placed import place_lines
from lis_grasp.results.summary import LIFT_REASONS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    parser.add_argument("grasps_file", type=Path, metavar="GRASPS", help="grasps.json of `grasp`")
    opt.add_object_argument(parser, required_name=False)
    parser.add_argument(
        "--best", type=int, default=1, metavar="N", help="lift with the N best grasps (default: 1)"
    )
    opt.add_jobs(parser)
    opt.add_options(parser, *LIFTED_WITH, recorded=True)
    opt.add_output(parser, "the folder of GRASPS")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Simulate the lift with each of the best grasps, and print the outcomes."""
    used = opt.given(options, "best", "jobs", "object", "size", "units", "up", *LIFTED_WITH)
    made = lift_file(options.grasps_file, options.output, progress=PRINTED, **used)
    held = sum(lift["held"] for lift in made.lifts)
    say(f"held {held} of {len(made.lifts)} grasps, {made.mass:.3g} kg")
    for reason in dict.fromkeys(lift["reason"] for lift in made.lifts if not lift["held"]):
        ranks = ", ".join(str(lift["rank"]) for lift in made.lifts if lift["reason"] == reason)
        say(f"grasp {ranks} not held: {LIFT_REASONS.get(reason, reason)}")
    for lift in made.lifts:
        for line in place_lines(lift):
            say(line if len(made.lifts) == 1 else f"grasp {lift['rank']} {line}")
    say(f"wrote {made.path}")
    say(next_step("lis-grasp view {}", made.path.parent))
