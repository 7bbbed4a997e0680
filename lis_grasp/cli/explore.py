"""`lis-grasp explore`: touch an object with a simulated hand, write the contacts."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from lis_grasp import pipeline
from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import Stage, say
from lis_grasp.cli.results_folder import remove_made_from
from lis_grasp.exploration import Exploration, TouchLog
from lis_grasp.hands.hand import Hand
from lis_grasp.io import provenance
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.shapes import Shape

LOG = "touches.jsonl"

TOUCH_OPTIONS = (
    *("hand", "estimator", "prober", "fingers", "free", "mass", "friction", "policy"),
    *("until_coverage", "until_uncertainty", "max_seconds", "position_noise", "normal_noise"),
    *("touches", "seed"),
)
"""The options of an exploration, beside its object."""

# Plain names of facts in the header of a log.
_MEANING = {"source": "state of lis_grasp", "touch_log": "format"}


def add_parser(verbs: Any) -> None:
    """Add the verb to the command line."""
    parser = verbs.add_parser("explore", help="touch an object, write contacts.ply")
    opt.add_object(parser)
    opt.add_options(parser, *TOUCH_OPTIONS)
    opt.add_output(parser, "results/<run>")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Explore, and write the contacts."""
    config = opt.configure(options)
    output = options.output or opt.default_output(config)
    shape = opt.load_object(config)
    hand = Hand.load(config.hand)
    exploration = touch_with_log(config, shape, hand, output)
    path = output / "contacts.ply"
    exploration.contacts.save(path, header=explored_header(config, shape))
    say(f"ended: {exploration.ended}")
    say(f"wrote {path} ({len(exploration.contacts)} contacts), {output / LOG}")
    say(f"next: lis-grasp estimate {path}")


def touch_with_log(config: RunConfig, shape: Shape, hand: Hand, output: Path) -> Exploration:
    """Touch, with a log in the folder of results; go on where an interrupted log ends.

    A log of another configuration, or by another state of the package, which might have chosen
    other probes, is begun anew. So are the results of an earlier exploration in the folder.
    """
    facts = provenance.parse(explored_header(config, shape))
    log = TouchLog(output / LOG, facts | {"source": provenance.source_digest()})
    differing = log.differing()
    known = len(log.resume())
    if known:
        say(f"going on from {known} probes in {log.path}")
    elif differing:
        names = ", ".join(_MEANING.get(name, name) for name in differing)
        say(f"beginning anew: {log.path} is of another {names}")
    if not known:
        remove_made_from(output / "contacts.ply", with_itself=True)
    with Stage(f"Touching {shape.name} with {hand.name}") as stage:
        exploration = pipeline.touch(shape, hand, config, log=log, progress=stage.count)
        stage.result = exploration.summary()
    return exploration


def explored_header(config: RunConfig, shape: Shape) -> str:
    """Return the header of contacts: the configuration, and the height the object stands at."""
    later = ("grasps", "attempts", *(() if config.free else ("mass", "friction")))
    facts = {name: value for name, value in config.facts().items() if name not in later}
    return provenance.describe(**facts, support_height=pipeline.support_height(shape))
