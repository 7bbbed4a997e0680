"""`lis-grasp paper`: reproduction of every figure and table of the paper, in one report."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, get_args

from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import Stage, say
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.experiments.baselines import BASELINES
from lis_grasp.experiments.compared_estimators import OURS
from lis_grasp.experiments.paper.paper_results import ResultsFile, run_trials
from lis_grasp.experiments.paper.paper_trials import Experiment, trials
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.worker_pool import process_count

_OUTPUT = Path("results/paper")
_SEEDS, _QUICK_SEEDS = 10, 2
_QUICK_CONTENDERS = ("lis", "lis_as_published", "gpis", "blend")
_CONTENDERS = (*OURS, "hermite_rbf", "offset_rbf")


def add_parser(verbs: Any) -> None:
    """Add the verb to the command line."""
    parser = verbs.add_parser(
        "paper", help="reproduce every figure and table of the paper in one report.html"
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help=f"{_QUICK_SEEDS} seeds and {len(_QUICK_CONTENDERS)} estimators: about two minutes",
    )
    parser.add_argument(
        "--seeds", type=int, metavar="N", help=f"seeds of every experiment (default: {_SEEDS})"
    )
    parser.add_argument(
        "--estimators",
        nargs="+",
        choices=(*OURS, *BASELINES),
        metavar="NAME",
        help=f"estimators to compare (default: {', '.join(_CONTENDERS)}; also"
        f" {', '.join(name for name in BASELINES if name not in _CONTENDERS)}, which need"
        " lis-grasp[baselines])",
    )
    opt.add_jobs(parser)
    opt.add_output(parser, str(_OUTPUT))
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Run the missing trials, draw the figures, write the report."""
    from lis_grasp.experiments.paper.paper_figures import draw_pictures
    from lis_grasp.experiments.paper.paper_page import write_report
    from lis_grasp.experiments.paper.paper_tables import rows_as_csv

    default = _QUICK_SEEDS if options.quick else _SEEDS
    seeds = default if options.seeds is None else options.seeds
    jobs = process_count(options.jobs)
    if seeds < 1:
        raise InvalidOptionError.out_of_range("--seeds", seeds, "at least 1")
    output = options.output or _OUTPUT
    names = tuple(options.estimators or (_QUICK_CONTENDERS if options.quick else _CONTENDERS))
    for needed in ("lis", "gpis", RunConfig().estimator):
        if needed not in names:
            raise InvalidOptionError(
                f"the report compares with '{needed}': add it to --estimators",
                option="--estimators",
                value=names,
            )
    file = ResultsFile(output / "results.jsonl")
    wanted = trials(get_args(Experiment), seeds)
    with Stage("Running the experiments") as stage:
        for done, total in run_trials(file, wanted, names, jobs=jobs):
            stage.count(done, total)
        stage.result = f"{len(wanted)} trials of {len(names)} estimators"
    keys = {(t.experiment, t.object, t.seed) for t in wanted}
    rows = [
        row
        for row in file.read()
        if (row["experiment"], row["object"], row["seed"]) in keys and row["estimator"] in names
    ]
    rows.sort(key=lambda r: (r["experiment"], r["object"], r["seed"], names.index(r["estimator"])))
    command = "lis-grasp paper" + (" --quick" if options.quick else "")
    if options.seeds:
        command += f" --seeds {seeds}"
    if options.estimators:
        command += f" --estimators {' '.join(names)}"
    with Stage("Drawing the figures") as stage:
        pictures = list(draw_pictures(rows, progress=stage.count))
        stage.result = f"{len(pictures)} figures"
    report = output / "report.html"
    write_report(report, rows, pictures, command=command, estimator=RunConfig().estimator)
    write_text(output / "trials.csv", rows_as_csv(rows))
    say(f"wrote {report}, {output / 'trials.csv'}")
    say(f"next: open {report} in a browser")
