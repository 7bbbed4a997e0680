"""Resumption of an exploration: its dependencies, and the reuse of recorded probes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lis_grasp.exploration import (
    LoggedProbe,
    TouchLog,
)
from lis_grasp.exploration.policy import POLICY_NAMES
from lis_grasp.io import provenance
from lis_grasp.results.progress import Progress
from lis_grasp.robots.shipped_models import HAND_REGISTRY, hand_path
from lis_grasp.stages.scenario import Scenario
from lis_grasp.surfaces.estimators import ESTIMATOR_NAMES
from lis_grasp.task.task import LIFTING, Task
from lis_grasp.world.files import file_of

# An exploration runs this module and those that it imports. The values of a task are separate
# facts.
_RUNS, _CONFIGURATION = "lis_grasp.stages.touch", "lis_grasp.task.task"


def recorded_probes(
    log: TouchLog, task: Task, progress: Progress, *, fresh: bool
) -> tuple[tuple[LoggedProbe, ...], str | None]:
    """Return the probes to reuse, and why they ended; report which, or why there are none.

    Those of a log that is not reused stay in it.
    """
    recording = log.read()
    if not fresh and task.robot.arm is None and _asks_for_more(recording.changes):
        log.go_on()
        recording = log.read()
    recorded, ending, why = recording.probes, recording.ending, None
    if fresh and log.path.exists():
        why = ", as asked"
    elif recording.changes:
        why = f": {_reason(recording.changes, task)}"
    elif ending is not None and task.robot.arm is not None:
        why = ": the log lacks what touches demand of the arm"
    if why is not None:
        progress.say(f"starting from the beginning{why}")
        return (), None
    if recorded and ending is not None:
        progress.say(f"using the {len(recorded)} probes of the same exploration in {log.path}")
    elif recorded:
        progress.say(f"resuming after {len(recorded)} probes in {log.path}")
    return recorded, ending if recorded else None


def _asks_for_more(changes: Mapping[str, tuple[Any, Any]]) -> bool:
    """Return whether the only change is a larger number of touches: a policy does not know it."""
    before, now = changes.get("touches", (0, 0))
    return set(changes) == {"touches"} and before < now


def exploration_header(scenario: Scenario) -> str:
    """Return the facts of an exploration as the header of its files."""
    task = scenario.task
    is_pushed, ends_on_grasp = task.world.is_free, task.decide.until_success is not None
    loads = () if is_pushed or ends_on_grasp else ("mass", "friction")
    later = (*LIFTING, *loads)
    facts = {name: value for name, value in task.facts().items() if name not in later}
    poses = {name: value for name, value in scenario.facts().items() if name != "X_EO"}
    return provenance.describe(**facts, **poses)


def exploration_content(scenario: Scenario) -> dict[str, str]:
    """Return hashes of the code that an exploration runs, and of its files and plug-ins.

    A world counts by its bodies: its files name others.
    """
    task, world = scenario.task, scenario.truth.surroundings
    skipped = [_CONFIGURATION]
    if task.decide.until_success is None:  # no grasp is planned
        skipped.append("lis_grasp.grasping")
    if task.world.prober != "dynamic":
        skipped.append("lis_grasp.simulation")
    files = {f"{name}_digest": file for name, file in _files(task).items()}
    digests = {name: provenance.digest_of(file) for name, file in files.items()}
    if len(world):
        digests["world_digest"] = world.digest
    return {"source": provenance.source_digest(_RUNS, tuple(skipped))} | digests


def _files(task: Task) -> dict[str, Path]:
    """Return the files that an exploration depends on, by the fact that names them."""
    hand, facts = task.robot.hand, task.facts()
    named = {name: file_of(facts.get(name) or "") for name in ("object", "cloud", "arm", "world")}
    files = {name: file for name, file in named.items() if file.is_file()}
    files["hand"] = hand_path(hand)
    plugged = {
        "estimator": ESTIMATOR_NAMES.source_file(facts["estimator"]),
        "policy": POLICY_NAMES.source_file(facts["policy"]),
    }
    if hand in HAND_REGISTRY.names:
        plugged["hand_plugin"] = HAND_REGISTRY.source_file(hand)
    return files | {name: file for name, file in plugged.items() if file is not None}


def _reason(changes: Mapping[str, tuple[Any, Any]], task: Task) -> str:
    """Return in words the first change that prevents resuming an exploration."""
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
