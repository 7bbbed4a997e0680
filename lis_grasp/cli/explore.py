"""`lis-grasp explore`: tactile exploration of an object with a simulated hand."""

from __future__ import annotations

import argparse
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from lis_grasp import pipeline
from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import Stage, say
from lis_grasp.cli.results_folder import LOG, remove_made_from, results_folder
from lis_grasp.exceptions import EstimationError, InvalidMeshError
from lis_grasp.exploration import Exploration, ExplorationState, ProbeOutcome, TouchLog
from lis_grasp.grasping.hand_opening import largest_opening, narrowest_width
from lis_grasp.io import provenance
from lis_grasp.io.folder_lock import sole_writer
from lis_grasp.io.surface_files import remove_growth, save_growth
from lis_grasp.lifting.arm_use import ArmUse
from lis_grasp.meshing import extract_mesh
from lis_grasp.pipeline.report_json import exploration_facts
from lis_grasp.pipeline.scenario import Scenario
from lis_grasp.pipeline.summary import exploration_lines
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape
from lis_grasp.surfaces.carved_implicit_surface import above_table

TOUCH_OPTIONS = (
    *("hand", "estimator", "prober", "fingers", "mass", "friction", "policy"),
    *(
        "until_success",
        "until_coverage",
        "until_uncertainty",
        "max_seconds",
        "position_noise",
        "normal_noise",
    ),
    *("force_threshold", "taxel_pitch", "cloud", "touches", "seed", "arm", "base"),
)
"""The options of an exploration, beside its object."""

# Intermediate estimates that are kept, and the cells along the bounds of their meshes.
_STEPS, _CELLS = 7, 26
# Contacts of the first of them; with fewer the surface is nearly a guess.
_FIRST = 3

# Plain names of facts in the header of a log.
_MEANING = {
    "source": "state of lis_grasp",
    "touch_log": "format",
    "object_digest": "content of the object's file",
    "hand_digest": "content of the hand's file",
    "cloud_digest": "content of the cloud",
    "arm_digest": "content of the arm's file",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    opt.add_object(parser)
    opt.add_conditions(parser)
    opt.add_options(parser, *TOUCH_OPTIONS)
    opt.add_output(parser, "results/<run>")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Explore, and write the contacts."""
    config = opt.configure_touch(options)
    output = results_folder(config, options.output)
    scenario = Scenario.from_config(config)
    opt.announced(scenario.truth.shape)
    options.until_end.enter_context(sole_writer(output))
    warn_if_too_wide(scenario.truth.shape, scenario.known.hand)
    exploration = explore_with_log(scenario, output)
    after = scenario.after(exploration)
    for line in exploration_lines(exploration_facts(after, exploration)):
        say(line)
    path = output / "contacts.ply"
    say(f"ended: {exploration.ended}")
    say(f"wrote {path} ({len(exploration.contacts)} contacts), {output / LOG}")
    say(f"next: lis-grasp estimate {path}")


def warn_if_too_wide(shape: Shape, hand: Hand) -> None:
    """Print a warning if the object is everywhere wider than the hand opens."""
    opening = largest_opening(hand)
    if not 0.0 < opening < float(shape.mesh.extents.min()):  # the box bounds the width
        return
    width = narrowest_width(shape.mesh)
    if width > opening:
        say(
            f"warning: {shape.name} is {1e3 * width:.0f} mm wide where it is narrowest, and"
            f" {hand.name} opens {1e3 * opening:.0f} mm: only a rim or a handle can be grasped;"
            " check the units of the mesh (--units), or take a smaller object"
        )


class _Log:
    """Watch that writes the log and some intermediate estimates, and shows the progress."""

    def __init__(self, log: TouchLog, scenario: Scenario, header: str, stage: Stage) -> None:
        self._log, self._scenario, self._header, self._stage = log, scenario, header, stage
        self._counts = growth_counts(scenario.known.touches)
        known = log.resume()[:-1]
        self._last = len(Exploration.replay(known, touches=scenario.known.touches).contacts)

    def record(self, outcome: ProbeOutcome) -> None:
        self._log.append(outcome)

    def observe(self, state: ExplorationState) -> None:
        known = self._scenario.known
        self._stage.count(len(state.contacts), known.touches)
        # One touch can make several contacts and so pass a count.
        contacts, surface, before = len(state.contacts), state.surface, self._last
        if surface is None or not state.is_new:
            return
        self._last = contacts
        if contacts < known.touches and any(before < c <= contacts for c in self._counts):
            with suppress(EstimationError, InvalidMeshError):  # too few contacts for a surface
                cell = float(np.ptp(surface.bounds, axis=0).max()) / _CELLS
                mesh = extract_mesh(above_table(surface, known.table), resolution=cell)
                save_growth(self._log.path.parent, contacts, mesh, self._header)


def explore_with_log(
    scenario: Scenario, output: Path, arm_use: ArmUse | None = None
) -> Exploration:
    """Explore, and write touches.jsonl, contacts.ply and some intermediate estimates (growth/).

    contacts.ply has the touches, then the points of the cloud, unless the object was lost. What new
    touches demand of an arm is added to `arm_use`.

    An interrupted exploration is resumed from its log, and the touches of a finished one are used
    again. With another configuration or another state of the package it starts from the beginning,
    and the earlier results are removed.
    """
    config = scenario.config
    loads = () if config.free or config.until_success is not None else ("mass", "friction")
    later = ("grasps", "attempts", "simulator", *loads)
    facts = {name: value for name, value in config.facts().items() if name not in later}
    header = provenance.describe(
        **facts,
        **{name: scenario.facts()[name] for name in ("support_height", "X_WO")},
    )
    cloud = (
        None if config.cloud is None else pipeline.load_source(pipeline.ContactSource(config.cloud))
    )
    content = {
        f"{name}_digest": provenance.digest_of(Path(file))
        for name, file in (
            ("object", config.object),
            ("hand", config.hand),
            ("cloud", config.cloud),
            ("arm", config.arm),
        )
        if file is not None and Path(file).is_file()
    }
    source = {"source": provenance.source_digest()} | content
    log = TouchLog(output / LOG, provenance.parse(header) | source)
    differing, finished = log.differing(), log.ending() is not None
    if (
        finished and scenario.known.station is not None
    ):  # what touches demand of an arm is not in the log
        log.path.unlink()
    known = log.resume()
    if known and finished:
        say(f"using the {len(known)} probes of the same exploration in {log.path}")
    elif known:
        say(f"resuming after {len(known)} probes in {log.path}")
    elif differing:
        names = ", ".join(_MEANING.get(name, name) for name in differing)
        say(f"starting from the beginning: {log.path} has another {names}")
    if not known:
        remove_growth(output)
    if finished or not known:
        remove_made_from(output / "contacts.ply", with_itself=True)
    title = f"Touching {scenario.truth.shape.name} with {scenario.known.hand.name}"
    with Stage(title) as stage:
        exploration = _explore(scenario, log, _Log(log, scenario, header, stage), arm_use)
        stage.result = exploration.summary()
    contacts = exploration.contacts
    if cloud is not None and not any(outcome.lost for outcome in exploration.outcomes):
        contacts = contacts.append(cloud)
    facts = provenance.parse(header) | scenario.after(exploration).facts()
    contacts.save(output / "contacts.ply", header=provenance.describe(**facts))
    return exploration


def _explore(scenario: Scenario, log: TouchLog, watch: _Log, arm_use: ArmUse | None) -> Exploration:
    recorded, ending = log.resume(), log.ending()
    if ending is not None:
        touches = scenario.known.touches
        return replace(Exploration.replay(recorded, touches=touches), ended=ending)
    prober = pipeline.make_prober(scenario, recorded, arm_use)
    exploration = pipeline.touch(scenario, prober=prober, recorded=recorded, watch=watch)
    log.end(exploration.ended)
    return exploration


def growth_counts(contacts: int) -> list[int]:
    """Return the numbers of contacts whose estimates are kept, all below `contacts`.

    Their ratios are about equal: the first contacts change the surface most.
    """
    if contacts <= 2:
        return []
    first = min(_FIRST, contacts - 1)
    counts = {round(first * (contacts / first) ** (k / _STEPS)) for k in range(_STEPS)}
    return sorted(count for count in counts if count < contacts)
