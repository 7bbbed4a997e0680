"""`lis-grasp explore`: tactile exploration of an object with a simulated hand."""

from __future__ import annotations

import argparse
from contextlib import suppress
from pathlib import Path

import numpy as np

from lis_grasp import pipeline
from lis_grasp.arms.station import Station
from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import Stage, say
from lis_grasp.cli.results_folder import LOG, remove_made_from, results_folder
from lis_grasp.exceptions import EstimationError, InvalidMeshError
from lis_grasp.exploration import Exploration, ExplorationState, TouchLog
from lis_grasp.grasping.hand_opening import largest_opening, narrowest_width
from lis_grasp.io import provenance
from lis_grasp.io.folder_lock import sole_writer
from lis_grasp.io.surface_files import remove_growth, save_growth
from lis_grasp.lifting.arm_use import ArmUse
from lis_grasp.meshing import extract_mesh
from lis_grasp.pipeline.arm_station import make_station, station_after, station_facts
from lis_grasp.pipeline.report_json import exploration_facts
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.summary import exploration_lines
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape
from lis_grasp.surfaces.carved_implicit_surface import above_table
from lis_grasp.typing import FloatArray

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
    shape, X_WO = opt.place_object(config)
    hand = Hand.load(config.hand)
    options.until_end.enter_context(sole_writer(output))
    warn_if_too_wide(shape, hand)
    station = make_station(config, hand, pipeline.support_height(shape, config))
    exploration = explore_with_log(config, shape, hand, output, X_WO, station)
    for line in exploration_lines(exploration_facts(config, shape, hand, exploration)):
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


def explore_with_log(
    config: RunConfig,
    shape: Shape,
    hand: Hand,
    output: Path,
    X_WO: FloatArray | None,
    station: Station | None = None,
    arm_use: ArmUse | None = None,
) -> Exploration:
    """Explore, and write touches.jsonl, contacts.ply and some intermediate estimates (growth/).

    The shape is at its pose X_WO (4, 4), if it has one. contacts.ply has the touches, then the
    points of the cloud, unless the object was lost. The station's arm carries the hand; None for a
    free hand. What new touches demand of it is added to `arm_use`.

    An interrupted exploration is resumed from its log, and the touches of a finished one are used
    again. With another configuration or another state of the package it starts from the beginning,
    and the earlier results are removed.
    """
    loads = () if config.free or config.until_success is not None else ("mass", "friction")
    later = ("grasps", "attempts", "simulator", *loads)
    facts = {name: value for name, value in config.facts().items() if name not in later}
    header = provenance.describe(
        **facts,
        support_height=pipeline.support_height(shape, config),
        X_WO=None if X_WO is None else X_WO.tolist(),
    )
    cloud = None if config.cloud is None else pipeline.load_source(config.cloud)
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
    if finished and station is not None:  # what touches demand of an arm is not in the log
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
    counts = growth_counts(config.touches)
    table = pipeline.table_of(config, pipeline.support_height(shape, config))
    last = len(Exploration.replay(known[:-1], touches=config.touches).contacts)

    def watch(state: ExplorationState) -> None:
        nonlocal last
        stage.count(len(state.contacts), config.touches)
        # One touch can make several contacts and so pass a count.
        contacts, surface, before = len(state.contacts), state.surface, last
        if surface is None or not state.is_new:
            return
        last = contacts
        if contacts < config.touches and any(before < count <= contacts for count in counts):
            with suppress(EstimationError, InvalidMeshError):  # too few contacts for a surface
                cell = float(np.ptp(surface.bounds, axis=0).max()) / _CELLS
                mesh = extract_mesh(above_table(surface, table), resolution=cell)
                save_growth(output, contacts, mesh, header)

    with Stage(f"Touching {shape.name} with {hand.name}") as stage:
        exploration = pipeline.touch(
            shape,
            hand,
            config,
            log=log,
            observe=watch,
            station=station,
            arm_use=arm_use,
        )
        stage.result = exploration.summary()
    contacts = exploration.contacts
    if cloud is not None and not any(outcome.lost for outcome in exploration.outcomes):
        contacts = contacts.append(cloud)
    end = exploration.simulated_pose  # of a free object, in the frame of the contacts
    moved = {} if end is None else {"X_EO": end.tolist()}
    moved |= station_facts(station_after(station, exploration))
    contacts.save(
        output / "contacts.ply", header=provenance.merge(provenance.parse(header), **moved)
    )
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
