"""Resumption of an exploration: what it depends on, and which recorded outcomes count."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lis_grasp.exploration import ProbeOutcome, TouchLog
from lis_grasp.exploration.policy import POLICY_NAMES
from lis_grasp.io import provenance
from lis_grasp.pipeline.progress import Progress
from lis_grasp.pipeline.results_folder import LOG
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.scenario import Scenario
from lis_grasp.robots.shipped_models import HAND_REGISTRY, hand_path
from lis_grasp.surfaces.estimators import ESTIMATOR_NAMES

# An exploration runs this module and those that it imports. The values of a configuration are
# facts of their own.
_RUNS, _CONFIGURATION = "lis_grasp.pipeline.stages", "lis_grasp.pipeline.run_config"


def recorded_outcomes(
    log: TouchLog, config: RunConfig, progress: Progress, *, fresh: bool
) -> tuple[tuple[ProbeOutcome, ...], str | None]:
    """Return the outcomes to continue or reuse, and why they ended; say which, or why none."""
    recording = log.read()
    recorded, ending, why = recording.outcomes, recording.ending, None
    if fresh and log.path.exists():
        why = ", as asked"
    elif recording.changes:
        why = f": {_reason(recording.changes, config)}"
    elif ending is not None and config.arm is not None:
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


def exploration_header(scenario: Scenario) -> str:
    """Return the facts of an exploration as the header of its files."""
    config = scenario.config
    loads = () if config.free or config.until_success is not None else ("mass", "friction")
    later = ("grasps", "attempts", "simulator", "obstacles", *loads)
    facts = {name: value for name, value in config.facts().items() if name not in later}
    poses = scenario.facts()
    return provenance.describe(**facts, support_height=poses["support_height"], X_WO=poses["X_WO"])


def touch_log(folder: Path, config: RunConfig, header: str) -> TouchLog:
    """Return the log of an exploration in a folder, which knows all that it depends on."""
    return TouchLog(folder / LOG, provenance.parse(header) | _content(config))


def _content(config: RunConfig) -> dict[str, str]:
    """Return hashes of the code that an exploration runs, and of its files and plug-ins."""
    skipped = [_CONFIGURATION]
    if config.until_success is None:  # no grasp is planned
        skipped.append("lis_grasp.grasping")
    if config.prober != "dynamic":
        skipped.append("lis_grasp.simulation")
    files = {f"{name}_digest": file for name, file in _files(config).items()}
    digests = {name: provenance.digest_of(file) for name, file in files.items()}
    return {"source": provenance.source_digest(_RUNS, tuple(skipped))} | digests


def _files(config: RunConfig) -> dict[str, Path]:
    """Return the files that an exploration depends on, by the fact that names them."""
    named = {name: getattr(config, name) for name in ("object", "cloud", "arm")}
    files = {name: Path(file) for name, file in named.items() if file and Path(file).is_file()}
    files["hand"] = hand_path(config.hand)
    plugged = {
        "estimator": ESTIMATOR_NAMES.source_file(config.estimator),
        "policy": POLICY_NAMES.source_file(config.policy),
    }
    if config.hand in HAND_REGISTRY.names:
        plugged["hand_plugin"] = HAND_REGISTRY.source_file(config.hand)
    return files | {name: file for name, file in plugged.items() if file is not None}


def _reason(changes: Mapping[str, tuple[Any, Any]], config: RunConfig) -> str:
    """Return in words why an exploration cannot be resumed: the first that explains others."""
    facts = [name for name in changes if name in config.facts()]
    if facts:
        texts = (f"{n} is {_shown(changes[n][1])}, and was {_shown(changes[n][0])}" for n in facts)
        return "; ".join(texts)
    edited = [name for name in changes if name.endswith("_digest")]
    if edited:
        files = _files(config)
        names = (name.removesuffix("_digest") for name in edited)
        texts = (files[name].name if name in files else f"the file of {name}" for name in names)
        return f"{' and '.join(texts)} was edited"
    if "version" in changes:
        before, now = changes["version"]
        return f"version {before} of lis_grasp made the log, this is {now}"
    if "source" in changes:
        return "lis_grasp itself was edited"
    return f"another {' and '.join(changes)}"


def _shown(value: Any) -> str:
    return "not given" if value is None else str(value)
