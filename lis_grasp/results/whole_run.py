"""A whole run with its files: touch, estimate, mesh, grasp, lift and shake, report and page."""

from __future__ import annotations

import logging
from contextlib import suppress
from pathlib import Path

from threadpoolctl import threadpool_limits

from lis_grasp.arms.use import ArmUse
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import LisGraspError
from lis_grasp.io.atomic_writing import sole_writer, write_json
from lis_grasp.results.exploring import explore_into
from lis_grasp.results.first_contacts import touched_contacts
from lis_grasp.results.folder import SCENE, Earlier, made_from, remove, results_folder, set_aside
from lis_grasp.results.page import write_scene_of
from lis_grasp.results.preparing import prepared, require_runnable
from lis_grasp.results.progress import SILENT, Progress, Stopwatch
from lis_grasp.results.report import build_report
from lis_grasp.results.run_results import Run
from lis_grasp.results.stage_files import OF_CONTACTS, StoredStages
from lis_grasp.stages.regrasp import grasp_with_tactile_check
from lis_grasp.task.recorded_facts import read_facts
from lis_grasp.task.scene_file import load_scene, write_scene
from lis_grasp.task.task import Task

_LOG = logging.getLogger(__name__)


def run_task(
    task: Task,
    folder: Path | str | None = None,
    *,
    progress: Progress = SILENT,
    fresh: bool = False,
) -> Run:
    """Run every stage, and write the file of each as soon as it is done.

    An interrupted exploration is resumed, and a finished one is used again, if nothing that it
    depends on has changed. Files that were made from earlier ones are removed.

    Parameters
    ----------
    task
        The task.
    folder
        Folder of results; None for one in ``results/`` that is named after the task.
    progress
        Gets a message for every stage and step.
    fresh
        Explore from the beginning in any case.

    Raises
    ------
    LisGraspError
        If an input cannot be used, no contact was made, or a stage fails.

    Examples
    --------
    >>> task = Task.of("box", hand="wsg50", prober="kinematic", touches=12)
    >>> pipeline.run(task, "box_by_wsg50").lift["held"]
    True
    """
    require_runnable(task)
    folder, watch, arm_use = results_folder(task, folder), Stopwatch(), ArmUse()
    scenario = prepared(task, progress)
    # Threads change the order of sums, and thus the last digits of results.
    with sole_writer(folder), threadpool_limits(1):
        again = _made(folder / SCENE, task)
        earlier: Earlier = "fresh" if fresh else "remake" if again else "resume"
        if scenario.agent.views is not None:
            with watch.measure("see"):  # what is known before the first touch
                scenario.agent.perception.prior.given(Contacts.empty())
        with watch.measure("touch"):
            after, exploration = explore_into(
                folder, scenario, progress=progress, earlier=earlier, arm_use=arm_use
            )
            contacts = touched_contacts(folder, exploration, scenario)
        later = made_from(folder / "contacts.ply")
        if again:
            remove(later)
        else:
            set_aside(later, progress, "made with other options")
        write_scene(task, folder / SCENE)
        stages = StoredStages(folder, watch, progress)
        attempts = tuple(grasp_with_tactile_check(after, contacts, stages))
        with progress.stage("Reporting"), watch.measure("report"):
            _LOG.info("comparing the estimate and the grasps with the true object")
            report = build_report(after, exploration, attempts, arm_use)
            estimated = read_facts(folder / "surface.ply")
            report |= {name: estimated[name] for name in OF_CONTACTS if name in estimated}
            _LOG.info("drawing the scene")
            write_scene_of(folder, report)
        report["timings"] = {name: round(seconds, 3) for name, seconds in watch.seconds.items()}
        report["timings"]["total"] = round(sum(watch.seconds.values()), 3)
        write_json(folder / "report.json", report)
    return Run.load(folder)


def _made(scene: Path, task: Task) -> bool:
    """Return whether a run of the same task, perhaps an interrupted one, wrote a folder's scene."""
    with suppress(LisGraspError):
        return load_scene(scene) == task
    return False
