"""`lis-grasp benchmark`: your estimator, policy, planner or hand by the frozen protocol."""

from __future__ import annotations

import argparse
import json
import logging
import re
from pathlib import Path
from typing import TYPE_CHECKING

from lis_grasp.cli.progress import Stage, say
from lis_grasp.exceptions import EstimationError
from lis_grasp.io.atomic_writing import sole_writer, write_text
from lis_grasp_studies.harness.program import add_scheduler, scheduler_of

if TYPE_CHECKING:
    from lis_grasp_studies.evaluation.configuration import Configuration
    from lis_grasp_studies.evaluation.results import EvaluationResults

HELP = "measure your estimator, policy, planner or hand by a frozen protocol"
EXAMPLES = (
    ("my.module:Class --quick", "few objects: minutes on two cores"),
    ("blend --jobs 2", "all tracks of an estimator; run again, it continues"),
)

_OUTPUT = Path("results/benchmark")
_LOG = logging.getLogger("lis_grasp")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    from lis_grasp.cli import options as opt

    parser.description = (
        "Measure one estimator, policy, planner or hand on 100 objects and contacts that never"
        " change, and write a row with intervals over objects, losses to the baselines first. Run"
        " again, it continues."
    )
    parser.add_argument(
        "name", metavar="NAME", help="a name, my.module:Class, or the YAML file of a hand"
    )
    parser.add_argument("--quick", action="store_true", help="the first objects of each track")
    parser.add_argument(
        "--tracks", nargs="+", metavar="TRACK", help="some tracks of its kind (default: all)"
    )
    add_scheduler(parser)
    opt.add_output(parser, f"{_OUTPUT}/NAME")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Measure what is missing, and write the row and its table."""
    from lis_grasp_studies.benchmark.protocol import Protocol, kind_of
    from lis_grasp_studies.benchmark.row import benchmark_row, scores_of
    from lis_grasp_studies.benchmark.scores import score_table
    from lis_grasp_studies.evaluation.results import EvaluationResults
    from lis_grasp_studies.harness.tables import write_tables

    name, kind = options.name, kind_of(options.name)
    protocol = Protocol.load()
    configuration = protocol.configuration(kind, name, quick=options.quick, tracks=options.tracks)
    output: Path = options.output or _OUTPUT / re.sub(r"\W+", "_", name)
    options.until_end.enter_context(sole_writer(output))
    results = EvaluationResults(output)
    failure = _measure(configuration, results, options)
    parts = configuration.ordered(results.read())
    found = scores_of(protocol, name, parts)
    table = score_table(found, f"{kind} {name}")
    row = benchmark_row(protocol, name, kind, parts, found)
    write_text(output / "row.json", json.dumps(row, indent=2) + "\n")
    write_tables(output, [table])
    say(table.text())
    say(f"wrote {output}/row.json, scores.csv, rows.jsonl")
    if failure is not None:
        raise failure


def _measure(
    configuration: Configuration, results: EvaluationResults, options: argparse.Namespace
) -> EstimationError | None:
    """Measure what is missing; return the error of trials that failed, after all others."""
    from lis_grasp_studies.evaluation.part import Places
    from lis_grasp_studies.evaluation.results import Evaluation

    run = Evaluation(configuration, Places(), results, scheduler_of(options))
    with Stage("Measuring") as stage:
        try:
            for done, total, _ in run.run():
                stage.count(done, total)
                stage.result = f"{done} of {total} trials"
        except EstimationError as error:
            return error
    return None
