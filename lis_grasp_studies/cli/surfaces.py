"""`lis-grasp surfaces`: errors of estimators on many contact sets of many objects."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import get_args

from lis_grasp.cli.progress import Stage, next_step, say
from lis_grasp.exceptions import InvalidOptionError, require_at_least, require_packages
from lis_grasp.io.atomic_writing import sole_writer

HELP = "compare estimates on even, random, clustered and noisy contacts of many objects"
EXAMPLES = (("--quick --estimator my.module:Class", "your estimator beside ours"),)

_OUTPUT = Path("results/surfaces")
_PART, _QUICK_PART = 4, 30
_REFERENCE = "gpis_best"
_QUICK = (_REFERENCE,)
_ESTIMATORS = (_REFERENCE, "hermite_rbf", "thin_plate", "ransac_csg")
_SETS = ("evaluation", "development")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    from lis_grasp.cli import options as opt
    from lis_grasp.task.task import option_default
    from lis_grasp_studies.harness.page import add_figures
    from lis_grasp_studies.harness.program import add_estimator

    parser.description = (
        "Estimate the surfaces of test objects of five families from even, random, clustered"
        " and noisy contacts, and write tables of errors, losses and calibration. Run again, it"
        " continues with the missing trials."
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help=f"each object in one case of {_QUICK_PART}, against GPIS alone: about two minutes",
    )
    parser.add_argument(
        "--shapes",
        choices=_SETS,
        default=_SETS[0],
        help="evaluation shapes, or those that settings were chosen on (default: evaluation)",
    )
    parser.add_argument("--families", nargs="+", metavar="NAME", help="families (default: all)")
    parser.add_argument(
        "--meshes", type=Path, metavar="FOLDER", help="folder of mesh files, such as scans, to add"
    )
    parser.add_argument(
        "--estimators",
        nargs="+",
        metavar="NAME",
        help=f"all estimators to compare (default: {option_default('estimator')} and"
        f" {', '.join(_ESTIMATORS)}); --estimator keeps these and adds one",
    )
    add_estimator(parser)
    parser.add_argument(
        "--subject", metavar="NAME", help="estimator in question (default: the first)"
    )
    parser.add_argument(
        "--reference",
        default=_REFERENCE,
        metavar="NAME",
        help=f"estimator that ratios are to (default: {_REFERENCE})",
    )
    parser.add_argument(
        "--box",
        default="contacts",
        metavar="BOX",
        help="meshing box: contacts (that of gpis, for all), explored (clips nothing that is"
        " measured), or own (default: contacts)",
    )
    parser.add_argument(
        "--part", type=int, metavar="N", help=f"one case of N for each object (default: {_PART})"
    )
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="seeds (default: 1)")
    add_figures(parser)
    opt.add_jobs(parser)
    opt.add_output(parser, str(_OUTPUT))
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Run the missing trials, and write the tables."""
    from lis_grasp_studies.contact_study.contact_sets import CASES
    from lis_grasp_studies.contact_study.report import write_contact_report
    from lis_grasp_studies.contact_study.score import SURFACES, TRUTH, surface_trials
    from lis_grasp_studies.harness.page import write_figures
    from lis_grasp_studies.harness.rows import TrialResults
    from lis_grasp_studies.harness.runner import local_scheduler

    names = _estimators(options)
    shapes = _shapes(options)
    part = (_QUICK_PART if options.quick else _PART) if options.part is None else options.part
    require_at_least(1, seeds=options.seeds)
    if not 1 <= part <= len(CASES):
        raise InvalidOptionError.out_of_range("--part", part, f"from 1 to {len(CASES)}")
    scheduler = local_scheduler(options.jobs)
    output = options.output or _OUTPUT
    options.until_end.enter_context(sole_writer(output))
    results = TrialResults(output / "results.jsonl", SURFACES.kind)
    trials = surface_trials(shapes, part=part, seeds=range(options.seeds), box=options.box)
    made = (*names, TRUTH)
    with Stage("Running the trials") as stage:
        for done, total in SURFACES.run_missing(trials, made, results, scheduler):
            stage.count(done, total)
        stage.result = f"{len(trials)} contact sets, {len(names)} estimators"
    chart = write_contact_report(
        output,
        SURFACES.rows(trials, made, results),
        subject=options.subject or names[0],
        reference=options.reference,
        estimators=names,
        command=_command(options),
    )
    write_figures(options.figures, [chart])
    say(f"wrote {output / 'surfaces.md'}, each table and rows.csv beside it")
    say(next_step("read {}", output / "surfaces.md"))


def _estimators(options: argparse.Namespace) -> tuple[str, ...]:
    from lis_grasp.surfaces.estimators import find_estimator
    from lis_grasp.task.task import option_default
    from lis_grasp_studies.contact_study.score import Box
    from lis_grasp_studies.estimators import COMPETITORS, TUNED

    if options.box not in get_args(Box):
        raise InvalidOptionError.not_one_of("--box", options.box, get_args(Box))
    names = tuple(options.estimators or ())
    if not names:
        rivals = _QUICK if options.quick else _ESTIMATORS
        names = (option_default("estimator"), *rivals)
    names = (*(name for name in options.estimator or () if name not in names), *names)
    for name in (*names, options.subject or names[0], options.reference):
        find_estimator(name, registry=TUNED, option="--estimators")
        if name in COMPETITORS and COMPETITORS[name].package:
            require_packages(
                COMPETITORS[name].package, extra="baselines", option=f"--estimators {name}"
            )
    for needed in (options.subject or names[0], options.reference):
        if needed not in names:
            raise InvalidOptionError(
                f"the tables compare with '{needed}': add it to --estimators",
                option="--estimators",
                value=names,
            )
    if set(names) == {options.reference}:
        raise InvalidOptionError(
            f"--estimators must name one to compare with '{options.reference}'; it names no other",
            option="--estimators",
            value=names,
        )
    return names


def _shapes(options: argparse.Namespace) -> list[str]:
    from lis_grasp_studies.test_objects.shape_sets import (
        DEVELOPMENT,
        EVALUATION,
        scans_in,
    )

    groups = dict(EVALUATION if options.shapes == "evaluation" else DEVELOPMENT)
    if options.meshes is not None:
        groups["scans"] = scans_in(options.meshes)
    for family in options.families or ():
        if family not in groups:
            raise InvalidOptionError.not_one_of("--families", family, tuple(groups))
    return [name for family in options.families or groups for name in groups[family]]


def _command(options: argparse.Namespace) -> str:
    """Return the command with its options that are not their defaults."""
    defaults = {"shapes": _SETS[0], "reference": _REFERENCE, "box": "contacts", "seeds": 1}
    names = ("shapes", "families", "estimators", "meshes", "subject", "part")
    words = ["lis-grasp", "surfaces", *(["--quick"] if options.quick else [])]
    for name in (*names, "reference", "box", "seeds"):
        value = getattr(options, name)
        if value is not None and value != defaults.get(name):
            words += [f"--{name}", *map(str, value if isinstance(value, list) else [value])]
    for value in options.estimator or ():
        words += ["--estimator", value]
    return shlex.join(words)
