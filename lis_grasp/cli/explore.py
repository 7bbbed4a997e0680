"""`lis-grasp explore`: tactile exploration of an object with a simulated hand."""

from __future__ import annotations

import argparse
from pathlib import Path

from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import PRINTED, next_step, say
from lis_grasp.cli.view import watched
from lis_grasp.results.exploring import explore_object
from lis_grasp.results.folder import LOG, results_folder
from lis_grasp.results.report import exploration_facts, view_facts
from lis_grasp.results.summary import exploration_lines, view_lines
from lis_grasp.task.task import Task


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    opt.add_exploration(parser)
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Explore, print the summary, and return 0, or 1 if no contact was made."""
    if opt.written_scene(options):
        return 0
    task = opt.configure_touch(options)
    folder = results_folder(task, options.output)
    with watched(folder if options.watch else None):
        return _explore(task, folder, fresh=options.fresh)


def _explore(task: Task, folder: Path, *, fresh: bool) -> int:
    scenario, exploration = explore_object(task, folder, progress=PRINTED, fresh=fresh)
    lines = exploration_lines(exploration_facts(scenario, exploration))
    for line in [*lines, *view_lines(view_facts(scenario, exploration).get("views", {}))]:
        say(line)
    path = folder / "contacts.ply"
    say(f"ended: {exploration.ended}")
    say(f"wrote {path} ({len(exploration.contacts)} contacts), {folder / LOG}")
    if not len(exploration.contacts):
        say(next_step("lis-grasp view {} shows where the hand was; no contact was made", folder))
        return 1
    say(next_step("lis-grasp estimate {}", path))
    return 0
