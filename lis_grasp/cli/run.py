"""`lis-grasp run`: the whole pipeline, with one folder of results."""

from __future__ import annotations

import argparse
from pathlib import Path

from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import PRINTED, complain, next_step, say, say_search
from lis_grasp.cli.view import watched
from lis_grasp.exceptions import EstimationError, InvalidOptionError, LisGraspError, counted
from lis_grasp.results.folder import PAGE, RUN_FILES, results_folder
from lis_grasp.results.summary import run_lines
from lis_grasp.results.whole_run import run_task
from lis_grasp.stages.scenario import find_object
from lis_grasp.task.task import LIFTING, Task

_SEVERAL = Path("results/objects")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    opt.add_exploration(parser, "free_space", *LIFTING)
    several = "further objects: each gets a folder of its name in --output"
    parser.add_argument("more", metavar="OBJECT", nargs="*", default=[], help=several)
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run every stage, and print the summary, for each object.

    Returns 0, or 1 if no grasp was found for one of them, or it was not placed as asked.
    """
    if opt.written_scene(options):
        return 0
    if options.more:
        return _run_each(options, [options.object, *options.more], options.output or _SEVERAL)
    task = opt.configure_touch(options)
    folder = results_folder(task, options.output)
    with watched(folder if options.watch else None):
        return _run(task, folder, fresh=options.fresh)


def _run_each(options: argparse.Namespace, objects: list[str], output: Path) -> int:
    names = [Path(name).stem for name in objects]
    if options.watch or len({*names}) < len(names):
        raise InvalidOptionError(
            "several objects need different names, and no --watch", option="object", value=objects
        )
    tasks = [opt.configure_touch(options) for options.object in objects]
    folders = [results_folder(t, output / n) for t, n in zip(tasks, names, strict=True)]
    for task in tasks:
        find_object(task.world)
    failed, code = [], 0
    for name, task, folder in zip(names, tasks, folders, strict=True):
        try:
            code = _run(task, folder, fresh=options.fresh) or code
        except LisGraspError as error:
            failed.append(name)
            complain(f"{name}: {error}")
    if failed:
        of = f"of {counted(len(names), 'object')}, {len(failed)} failed"
        raise EstimationError(f"{of}: {', '.join(failed)}")
    return code


def _run(task: Task, folder: Path, *, fresh: bool) -> int:
    run = run_task(task, folder, progress=PRINTED, fresh=fresh)
    found = run.grasps is None or len(run.grasps) > 0
    if run.grasps is not None and not found:
        say_search(run.grasps)
    for line in run_lines(run.report or {}):
        say(line)
    say(f"wrote {run.folder}/{', '.join(RUN_FILES)}")
    say(next_step("open {}, or: lis-grasp view {}", run.folder / PAGE, run.folder))
    placed = (run.report or {}).get("place", {}).get("placed", True)
    return 0 if found and placed else 1
