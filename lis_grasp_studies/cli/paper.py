"""`lis-grasp paper`: reproduction of every figure and table of the paper, in one report."""

from __future__ import annotations

import argparse
from pathlib import Path

from lis_grasp.cli.progress import Stage, next_step, say
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.io.atomic_writing import sole_writer, write_text

HELP = "reproduce every figure and table of the paper in one report.html"
EXAMPLES = (("--quick", "the figures and tables with few seeds"),)

_OUTPUT = Path("results/paper")
_SEEDS, _QUICK_SEEDS = 10, 2
_QUICK_ESTIMATORS = ("lis", "lis_as_published", "gpis", "blend")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    from lis_grasp.cli import options as opt
    from lis_grasp_studies.baselines import BASELINES
    from lis_grasp_studies.harness.page import add_figures

    names = _default_estimators()
    parser.add_argument(
        "--quick",
        action="store_true",
        help=f"{_QUICK_SEEDS} seeds and {len(_QUICK_ESTIMATORS)} estimators: about two minutes on"
        " two idle cores",
    )
    parser.add_argument(
        "--seeds", type=int, metavar="N", help=f"seeds of every experiment (default: {_SEEDS})"
    )
    parser.add_argument(
        "--estimators",
        nargs="+",
        metavar="NAME",
        help=f"estimators to compare (default: {', '.join(names)}; also"
        f" {', '.join(name for name in BASELINES if name not in names)})",
    )
    add_figures(parser)
    opt.add_jobs(parser)
    opt.add_output(parser, str(_OUTPUT))
    parser.set_defaults(execute=execute)


def _default_estimators() -> tuple[str, ...]:
    from lis_grasp_studies.estimators import OURS

    return (*OURS, "hermite_rbf", "offset_rbf")


def execute(options: argparse.Namespace) -> None:
    """Run the missing trials, draw the figures, write the report."""
    from lis_grasp.task.task import option_default
    from lis_grasp_studies.harness.page import write_figures
    from lis_grasp_studies.harness.rows import TrialResults
    from lis_grasp_studies.harness.runner import local_scheduler
    from lis_grasp_studies.paper.report import draw_pictures, write_report
    from lis_grasp_studies.paper.tables import rows_as_csv
    from lis_grasp_studies.paper.trials import EXPERIMENTS, PAPER, paper_trials

    default = _QUICK_SEEDS if options.quick else _SEEDS
    seeds = default if options.seeds is None else options.seeds
    scheduler = local_scheduler(options.jobs)
    if seeds < 1:
        raise InvalidOptionError.out_of_range("--seeds", seeds, "at least 1")
    output = options.output or _OUTPUT
    options.until_end.enter_context(sole_writer(output))
    names = _estimators(options)
    results = TrialResults(output / "results.jsonl", PAPER.kind)
    trials = paper_trials(EXPERIMENTS, range(seeds))
    with Stage("Running the experiments") as stage:
        for done, total in PAPER.run_missing(trials, names, results, scheduler):
            stage.count(done, total)
        stage.result = f"{len(trials)} trials of {len(names)} estimators"
    rows = PAPER.rows(trials, names, results)
    command = "lis-grasp paper" + (" --quick" if options.quick else "")
    if options.seeds:
        command += f" --seeds {seeds}"
    if options.estimators:
        command += f" --estimators {' '.join(names)}"
    with Stage("Drawing the figures") as stage:
        pictures = list(draw_pictures(rows, progress=stage.count))
        stage.result = f"{len(pictures)} figures"
    report = output / "report.html"
    write_report(report, rows, pictures, command=command, estimator=option_default("estimator"))
    write_text(output / "trials.csv", rows_as_csv(rows))
    write_figures(options.figures, pictures)
    say(f"wrote {report}, {output / 'trials.csv'}")
    say(next_step("open {} in a browser", report))


def _estimators(options: argparse.Namespace) -> tuple[str, ...]:
    from lis_grasp.surfaces.estimators import find_estimator
    from lis_grasp.task.task import option_default
    from lis_grasp_studies.estimators import COMPARED

    default = _QUICK_ESTIMATORS if options.quick else _default_estimators()
    names = tuple(options.estimators or default)
    for name in names:
        find_estimator(name, registry=COMPARED, option="--estimators")
    for needed in ("lis", "gpis", option_default("estimator")):
        if needed not in names:
            raise InvalidOptionError(
                f"the report compares with '{needed}': add it to --estimators",
                option="--estimators",
                value=names,
            )
    return names
