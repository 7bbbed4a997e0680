"""Exploration with files: the touch log to resume from, contacts, and intermediate estimates."""

from __future__ import annotations

from pathlib import Path

from threadpoolctl import threadpool_limits

from lis_grasp.arms.use import ArmUse
from lis_grasp.exploration import (
    Exploration,
    TouchLog,
    begin,
)
from lis_grasp.exploration.strategy import end
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import sole_writer
from lis_grasp.io.surface_files import growth_folder
from lis_grasp.results.folder import (
    LOG,
    Earlier,
    made_from,
    result_file,
    results_folder,
    set_aside,
    view_paths,
)
from lis_grasp.results.growing import watched_steps
from lis_grasp.results.notes import say_object
from lis_grasp.results.progress import SILENT, Progress
from lis_grasp.results.resuming import exploration_content, exploration_header, recorded_probes
from lis_grasp.stages.contact_sources import prior_contacts
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.touch import (
    disturbance_by,
    make_perception,
    make_prober,
    make_strategy,
    touch_steps,
    true_pose,
)
from lis_grasp.task.task import Task
from lis_grasp.views import save_view


def explore_into(
    folder: Path,
    scenario: Scenario,
    *,
    progress: Progress = SILENT,
    earlier: Earlier = "resume",
    arm_use: ArmUse | None = None,
) -> tuple[Scenario, Exploration]:
    """Explore, and write touches.jsonl, contacts.ply and some intermediate estimates (growth/).

    Returns the scenario after the exploration, and the exploration.

    contacts.ply has the touches, then the points of the cloud, unless the object was lost. An
    interrupted exploration, or one of fewer touches, is resumed from its log, and the touches of a
    finished one are used again. If what the exploration depends on has changed since, it starts
    from the beginning, and the earlier results are set aside (see `set_aside`).

    `progress` gets the reason for a start from the beginning, and the steps. `earlier` is what to
    do with results: "resume" the exploration, start "fresh" in any case, or "remake": resume, and
    remove the later files, which the same task makes anew. Demands of new touches on an arm are
    added to `arm_use`.
    """
    task, agent = scenario.task, scenario.agent
    cloud = agent.cloud_contacts
    thinned = prior_contacts(cloud)
    header = exploration_header(scenario)
    log = TouchLog(folder / LOG, provenance.parse(header) | exploration_content(scenario))
    recorded, ending = recorded_probes(log, task, progress, fresh=earlier == "fresh")
    observations = [probe.observation for probe in recorded]
    if not recorded:
        touched, seen = folder / "contacts.ply", sorted(folder.glob("view*.npz"))
        growth = filter(None, [growth_folder(folder)])
        set_aside(
            [*made_from(touched), touched, *growth, *seen, log.path],
            progress,
            "made by an earlier exploration",
        )
    disturbances = [p.disturbance for p in recorded if p.disturbance is not None]
    disturbance = disturbances[-1] if disturbances else None
    for view, path in zip(agent.seen_by, view_paths(folder, len(agent.seen_by)), strict=True):
        save_view(view, path)
    title = f"Touching {scenario.truth.shape.name} with {agent.hand.name}"
    with progress.stage(title) as stage:
        if ending is not None:
            perception, strategy = make_perception(agent.perception, thinned), make_strategy(agent)
            state, X_EO = begin(perception, strategy, observations), recorded[-1].X_EO
            state = end(strategy, state, ending)
        else:
            X_EO = recorded[-1].X_EO if recorded else None
            now = scenario if X_EO is None else scenario.moved(X_EO)
            prober = make_prober(now, observations, arm_use, disturbance)
            log.begin()  # a page shows the object before the first touch
            steps = touch_steps(scenario, prober, observations)
            with_truth = ((state, true_pose(prober), disturbance_by(prober)) for state in steps)
            state, X_EO, disturbance = watched_steps(with_truth, log, agent, header, stage)
            log.end(state.ended)
        exploration = state.result
        stage.result = exploration.summary()
    contacts = exploration.contacts
    if len(state.given.touched):  # the object was not lost
        contacts = contacts.append(cloud)
    after = scenario.after(exploration, X_EO, disturbance)
    facts = provenance.parse(header) | after.facts() | after.warnings(contacts)
    with result_file(folder / "contacts.ply", progress, again=earlier == "remake") as path:
        contacts.save(path, header=provenance.describe(**facts))
    return after, exploration


def explore_object(
    task: Task,
    folder: Path | str | None = None,
    *,
    progress: Progress = SILENT,
    fresh: bool = False,
) -> tuple[Scenario, Exploration]:
    """Explore alone, with the files of `explore_into`; return its result and the scenario.

    For arguments and errors see `lis_grasp.pipeline.run`.

    Examples
    --------
    >>> task = Task.of("box", hand="wsg50", prober="kinematic", touches=3)
    >>> scenario, exploration = pipeline.explore_object(task, "touched_box")
    >>> exploration.made
    3
    """
    task.require_slides()
    folder = results_folder(task, folder)
    scenario = Scenario.from_config(task)
    say_object(scenario, progress)
    with sole_writer(folder), threadpool_limits(1):
        return explore_into(
            folder, scenario, progress=progress, earlier="fresh" if fresh else "resume"
        )
