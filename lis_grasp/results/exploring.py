"""Exploration with files: the touch log to resume from, contacts, and intermediate estimates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from threadpoolctl import threadpool_limits

from lis_grasp.arms.use import ArmUse
from lis_grasp.exceptions import EstimationError, InvalidMeshError
from lis_grasp.exploration import (
    Exploration,
    ExplorationState,
    LoggedProbe,
    TouchLog,
    begin,
)
from lis_grasp.exploration.policy import POLICY_NAMES
from lis_grasp.exploration.strategy import end
from lis_grasp.grasping.hand_capacity import narrowest_width
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import sole_writer
from lis_grasp.io.surface_files import remove_growth, save_growth
from lis_grasp.meshing import extract_mesh
from lis_grasp.results.folder import LOG, remove_made_from, result_file, results_folder
from lis_grasp.results.progress import SILENT, Progress, StageProgress
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import opening_range
from lis_grasp.robots.shipped_models import HAND_REGISTRY, hand_path
from lis_grasp.shapes import Shape
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.contact_sources import prior_contacts
from lis_grasp.stages.estimate import SurfaceEstimate
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.touch import (
    make_perception,
    make_prober,
    make_strategy,
    touch_steps,
    true_pose,
)
from lis_grasp.surfaces.estimators import ESTIMATOR_NAMES
from lis_grasp.task.task import LIFTING, Task
from lis_grasp.typing import FloatArray

# Intermediate estimates that are kept, and the cells along the bounds of their meshes.
_STEPS, _CELLS = 7, 26
# Contacts of the first of them; with fewer the surface is nearly a guess.
_FIRST = 3


def explore_into(
    folder: Path,
    scenario: Scenario,
    *,
    progress: Progress = SILENT,
    fresh: bool = False,
    arm_use: ArmUse | None = None,
) -> tuple[Scenario, Exploration]:
    """Explore, and write touches.jsonl, contacts.ply and some intermediate estimates (growth/).

    Returns the scenario after the exploration, and the exploration.

    contacts.ply has the touches, then the points of the cloud, unless the object was lost. An
    interrupted exploration is resumed from its log, and the touches of a finished one are used
    again. If what the exploration depends on has changed since, it starts from the beginning, and
    the earlier results are removed.

    `progress` gets the reason for a start from the beginning, and the steps. With `fresh` it starts
    from the beginning in any case. What new touches demand of an arm is added to
    `arm_use`.
    """
    task, agent = scenario.task, scenario.agent
    cloud = agent.cloud_contacts
    prior = prior_contacts(cloud)
    header = _header(scenario)
    log = TouchLog(folder / LOG, provenance.parse(header) | _content(task))
    recorded, ending = _recorded_probes(log, task, progress, fresh=fresh)
    observations = [probe.observation for probe in recorded]
    if not recorded:
        remove_growth(folder)
        remove_made_from(folder / "contacts.ply", progress)
        (folder / "contacts.ply").unlink(missing_ok=True)
    title = f"Touching {scenario.truth.shape.name} with {agent.hand.name}"
    with progress.stage(title) as stage:
        if ending is not None:
            perception, strategy = make_perception(agent.perception, prior), make_strategy(agent)
            state, X_EO = begin(perception, strategy, observations), recorded[-1].X_EO
            state = end(strategy, state, ending)
        else:
            X_EO = recorded[-1].X_EO if recorded else None
            now = scenario if X_EO is None else scenario.moved(X_EO)
            prober = make_prober(now, observations, arm_use)
            log.begin()  # a page shows the object before the first touch
            steps = touch_steps(scenario, prober, observations)
            with_truth = ((state, true_pose(prober)) for state in steps)
            state, X_EO = _watched(with_truth, log, agent, header, stage)
            log.end(state.ended)
        exploration = state.result
        stage.result = exploration.summary()
    contacts = exploration.contacts
    if len(state.prior):  # the object was not lost since
        contacts = contacts.append(cloud)
    after = scenario.after(exploration, X_EO)
    facts = provenance.parse(header) | after.facts() | after.warnings(contacts)
    with result_file(folder / "contacts.ply", progress) as path:
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

    Arguments and errors are those of `lis_grasp.pipeline.run`.

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
        return explore_into(folder, scenario, progress=progress, fresh=fresh)


def say_object(scenario: Scenario, progress: Progress) -> None:
    """Report the repairs of the true object's mesh, and whether it is too wide for the hand."""
    say_repairs(scenario.truth.shape, progress)
    say_width(scenario.truth.shape.mesh, scenario.agent.hand, progress)


def say_repairs(shape: Shape, progress: Progress) -> None:
    """Report the repairs of an object's mesh."""
    for repair in shape.repairs:
        progress.say(f"repaired: {repair}")


def say_width(mesh: trimesh.Trimesh, hand: Hand, progress: Progress) -> None:
    """Report whether a mesh is too wide for the hand."""
    low, high = opening_range(hand)
    if not 0.0 < high < float(mesh.extents.min()):  # the box bounds the width
        return
    width = narrowest_width(mesh)
    if width > high:
        progress.say(
            f"warning: the object is {1e3 * width:.0f} mm wide where it is narrowest, and"
            f" {hand.name} holds widths of {1e3 * low:.0f} to {1e3 * high:.0f} mm: only a rim or a"
            " handle can be grasped; check the units of the mesh (`units`), or take a smaller"
            " object"
        )


def growth_counts(contacts: int) -> list[int]:
    """Return the numbers of contacts whose estimates are kept, all below `contacts`.

    Their ratios are about equal: the first contacts change the surface most.
    """
    if contacts <= 2:
        return []
    first = min(_FIRST, contacts - 1)
    counts = {round(first * (contacts / first) ** (k / _STEPS)) for k in range(_STEPS)}
    return sorted(count for count in counts if count < contacts)


def _watched(
    steps: Iterator[tuple[ExplorationState, FloatArray | None]],
    log: TouchLog,
    agent: Agent,
    header: str,
    stage: StageProgress,
) -> tuple[ExplorationState, FloatArray | None]:
    """Write the log and some intermediate estimates, report the progress, and return the end.

    Each step is a state, and beside it the true pose of a free object.
    """
    state, X_EO = next(steps)  # after the recorded probes, the last of which may lack its estimate
    kept = Exploration.replay(state.observations[:-1], touches=agent.decide.touches).made
    counts = growth_counts(agent.decide.touches)
    while not state.ended:
        made = state.made
        last = state.observations[-1] if state.observations else None
        if last is not None and (last.is_lost or last.is_joined):
            stage.note(last.outcome.reason)
        stage.count(made, agent.decide.touches)
        if state.surface is not None and state.is_new:
            # One touch can make several contacts and so pass a count.
            if made < agent.decide.touches and any(kept < count <= made for count in counts):
                with suppress(EstimationError, InvalidMeshError):  # too few for a surface
                    surface = SurfaceEstimate(state.known, agent.perception).surface
                    cell = float(np.ptp(surface.bounds, axis=0).max()) / _CELLS
                    mesh = extract_mesh(surface, resolution=cell)
                    save_growth(log.path.parent, len(state.contacts), mesh, header)
            kept = made
        state, X_EO = next(steps)
        if not state.ended:
            log.append(state.observations[-1], X_EO)
    return state, X_EO


# An exploration runs this module and those that it imports. The values of a configuration are
# facts of their own.
_RUNS, _CONFIGURATION = "lis_grasp.stages.touch", "lis_grasp.task.task"


def _recorded_probes(
    log: TouchLog, task: Task, progress: Progress, *, fresh: bool
) -> tuple[tuple[LoggedProbe, ...], str | None]:
    """Return the probes to continue or reuse, and why they ended; say which, or why none."""
    recording = log.read()
    recorded, ending, why = recording.probes, recording.ending, None
    if fresh and log.path.exists():
        why = ", as asked"
    elif recording.changes:
        why = f": {_reason(recording.changes, task)}"
    elif ending is not None and task.robot.arm is not None:
        why = ": the log lacks what touches demand of the arm"
    if why is not None:
        log.path.unlink()
        progress.say(f"starting from the beginning{why}")
        return (), None
    if recorded and ending is not None:
        progress.say(f"using the {len(recorded)} probes of the same exploration in {log.path}")
    elif recorded:
        progress.say(f"resuming after {len(recorded)} probes in {log.path}")
    return recorded, ending if recorded else None


def _header(scenario: Scenario) -> str:
    """Return the facts of an exploration as the header of its files."""
    task = scenario.task
    is_pushed, ends_on_grasp = task.world.is_free, task.decide.until_success is not None
    loads = () if is_pushed or ends_on_grasp else ("mass", "friction")
    later = (*LIFTING, "obstacles", *loads)
    facts = {name: value for name, value in task.facts().items() if name not in later}
    poses = {name: value for name, value in scenario.facts().items() if name != "X_EO"}
    return provenance.describe(**facts, **poses)


def _content(task: Task) -> dict[str, str]:
    """Return hashes of the code that an exploration runs, and of its files and plug-ins."""
    skipped = [_CONFIGURATION]
    if task.decide.until_success is None:  # no grasp is planned
        skipped.append("lis_grasp.grasping")
    if task.world.prober != "dynamic":
        skipped.append("lis_grasp.simulation")
    files = {f"{name}_digest": file for name, file in _files(task).items()}
    digests = {name: provenance.digest_of(file) for name, file in files.items()}
    return {"source": provenance.source_digest(_RUNS, tuple(skipped))} | digests


def _files(task: Task) -> dict[str, Path]:
    """Return the files that an exploration depends on, by the fact that names them."""
    hand, facts = task.robot.hand, task.facts()
    named = {name: facts[name] for name in ("object", "cloud", "arm")}
    files = {name: Path(file) for name, file in named.items() if file and Path(file).is_file()}
    files["hand"] = hand_path(hand)
    plugged = {
        "estimator": ESTIMATOR_NAMES.source_file(facts["estimator"]),
        "policy": POLICY_NAMES.source_file(facts["policy"]),
    }
    if hand in HAND_REGISTRY.names:
        plugged["hand_plugin"] = HAND_REGISTRY.source_file(hand)
    return files | {name: file for name, file in plugged.items() if file is not None}


def _reason(changes: Mapping[str, tuple[Any, Any]], task: Task) -> str:
    """Return in words why an exploration cannot be resumed: the first that explains others."""
    facts = [name for name in changes if name in task.facts()]
    if facts:
        shown = {n: ["not given" if v is None else v for v in changes[n]] for n in facts}
        return "; ".join(f"{n} is {now}, and was {before}" for n, (before, now) in shown.items())
    edited = [name for name in changes if name.endswith("_digest")]
    if edited:
        files = _files(task)
        names = (name.removesuffix("_digest") for name in edited)
        texts = (files[name].name if name in files else f"the file of {name}" for name in names)
        return f"{' and '.join(texts)} was edited"
    if "version" in changes:
        before, now = changes["version"]
        return f"version {before} of lis_grasp made the log, this is {now}"
    if "source" in changes:
        return "lis_grasp itself was edited"
    return f"another {' and '.join(changes)}"
