"""`lis-grasp compare`: study of estimators over many trials, with statistics and one report."""

from __future__ import annotations

import argparse
import json
import logging
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from lis_grasp.cli.progress import Stage, next_step, say
from lis_grasp.exceptions import EstimationError, InvalidOptionError, require_packages
from lis_grasp.io.atomic_writing import sole_writer, write_text

if TYPE_CHECKING:
    from lis_grasp.io.json_lines import Row
    from lis_grasp_studies.study.results import StudyResults
    from lis_grasp_studies.study.study import Study

_LOG = logging.getLogger("lis_grasp")

HELP = "compare estimators by surface and grasp success in many trials, one report.html"
EXAMPLES = (
    ("--quick", "24 trials in a few minutes"),
    ("--study study.yaml --jobs 2", "a study file; run again, it continues"),
)

_OUTPUT = Path("results/compare")

QUICK: dict[str, Any] = {
    "objects": ["box", "pentagon", "cylinder", "mallet", "sphere", "torus"],
    "estimators": ["gpis", "lis", "blend"],
    "touches": [10, 20],
    "noise": ["none"],
    "seeds": 2,
}
"""The study of --quick."""

_FLAGS = {
    "objects": "built-in shapes or mesh files",
    "estimators": "all estimators to compare, in place of the study's; 'truth' plans on the true"
    " mesh; --estimator keeps the study's and adds one",
    "touches": "budgets of touches",
    "noise": "sensor noise, 'none' or like '1mm/3deg'",
    "hands": "hands, by name or YAML file",
}

_SETUP = ("reference", "prober", "explorer", "policy", "mass", "friction")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    from lis_grasp.cli import options as opt
    from lis_grasp_studies.harness.page import add_figures
    from lis_grasp_studies.harness.program import add_estimator, add_scheduler

    parser.description = (
        "Run a study: objects x estimators x touches x noise x hands x seeds. Options"
        " override the study file or --quick. Run again, it continues with the missing trials."
        " Needs the extra study: bash bootstrap.sh study."
    )
    parser.add_argument("--study", type=Path, metavar="YAML", help="study file")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="a small study of 24 trials: about four minutes on two idle cores",
    )
    parser.add_argument(
        "--meshes",
        type=Path,
        metavar="FOLDER",
        help="folder of mesh files (default: that of the study file, or the current one)",
    )
    for name, text in _FLAGS.items():
        kind = int if name == "touches" else str
        parser.add_argument(f"--{name}", nargs="+", type=kind, metavar=name.upper(), help=text)
    add_estimator(parser)
    parser.add_argument("--seeds", type=int, metavar="N", help="seeds 0 to N - 1")
    parser.add_argument("--reference", metavar="NAME", help="estimator to compare the others with")
    parser.add_argument(
        "--explorer",
        metavar="NAME",
        help="estimator used to explore for all, or 'own': each explores with itself",
    )
    opt.add_options(parser, "prober", "policy", "mass", "friction", show_default=False)
    add_figures(parser)
    add_scheduler(parser)
    parser.add_argument(
        "--report-only",
        action="store_true",
        help="run nothing: report on the rows in --output; needs no mesh file",
    )
    parser.add_argument(
        "--rerun", metavar="KEY", help="run one row of --output again and compare; write nothing"
    )
    parser.add_argument(
        "--schema", action="store_true", help="print the JSON schema of a study file, and end"
    )
    opt.add_output(parser, str(_OUTPUT))
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Run the missing trials, and write tables and report; or repeat one row."""
    from lis_grasp_studies.harness.program import require_no_workers, scheduler_of
    from lis_grasp_studies.harness.runner import run_trials
    from lis_grasp_studies.study.results import StudyResults
    from lis_grasp_studies.study.run import run_trial
    from lis_grasp_studies.study.study import Study

    if options.schema:
        say(json.dumps(Study.schema(), indent=2))
        return
    output: Path = options.output or _OUTPUT
    options.until_end.enter_context(sole_writer(output))
    results = StudyResults(output)
    if options.rerun is not None:
        _rerun(results, options)
        return
    require_no_workers(options)
    scheduler = scheduler_of(options)
    study = _study(options)
    if options.report_only:
        rows = results.alike(study)
        if not rows:
            raise InvalidOptionError(
                f"a report needs rows of its study; {output} has none", option="--report-only"
            )
        _describe(study, output, options)
        _report(study, rows, output, options.figures)
        return
    require_packages("pyarrow", "statsmodels", extra="study", option="compare")
    study.require_files()
    _describe(study, output, options)
    total = len(study.trials())
    with Stage(f"Running {total} trials") as stage:
        jobs = results.missing(study)
        for done, of in run_trials(jobs, total, results.lines, scheduler, run_trial):
            stage.count(done, of)
        stage.result = f"{len(study.estimators)} estimators each"
    results.write_merged()
    _report(study, results.of(study), output, options.figures)


def _describe(study: Study, output: Path, options: argparse.Namespace) -> None:
    """Write the study's file into the folder; keep an equal one, with its comments."""
    from lis_grasp_studies.study.study import Study, load_study

    described = output / "study.yaml"
    known = load_study(described, options.meshes) if _study_file(options) == described else None
    if known is not None and Study.from_facts(known) == study:
        return
    write_text(described, yaml.safe_dump(study.facts(), sort_keys=False))


def _report(study: Study, rows: list[Row], output: Path, figures: Path | None) -> None:
    from lis_grasp_studies.harness.page import write_figures
    from lis_grasp_studies.harness.tables import rows_csv, write_tables
    from lis_grasp_studies.study.cases import draw_cases, write_report
    from lis_grasp_studies.study.columns import COLUMNS
    from lis_grasp_studies.study.comparison import compare
    from lis_grasp_studies.study.figures import draw_pictures
    from lis_grasp_studies.study.tables import all_tables

    with Stage("Reporting") as stage:
        _LOG.info("statistics of %d rows", len(rows))
        comparisons = compare(rows, study.reference)
        tables = all_tables(rows, comparisons, study.reference)
        write_tables(output, tables, latex=True)
        write_text(output / "rows.csv", rows_csv(rows, COLUMNS))
        described, folder = (shlex.quote(str(path)) for path in (output / "study.yaml", output))
        command = f"lis-grasp compare --study {described} --output {folder}"
        _LOG.info("drawing figures and cases")
        files = (*study.objects, *study.hands)
        pictures = [*draw_pictures(rows), *draw_cases(output, rows, study.reference, files)]
        write_report(output / "report.html", study, rows, tables, pictures, command=command)
        write_figures(figures, pictures)
        stage.result = f"{len(rows)} rows, {len(comparisons)} comparisons"
    say(f"wrote {output}/report.html, rows.csv, and each table as")
    say(f"      {', '.join(table.name for table in tables)} in .csv and .tex")
    say(next_step("open {} in a browser", output / "report.html"))


def _facts(options: argparse.Namespace) -> dict[str, Any]:
    """Return the facts of a study: those of the file or --quick, overridden by options."""
    from lis_grasp_studies.study.study import Study, load_study, with_absolute_paths

    if options.study is not None and options.quick:
        raise InvalidOptionError("--quick excludes --study", option="--quick")
    facts = dict(QUICK) if options.quick else {}
    described = _study_file(options)
    if described is not None:
        facts = load_study(described, options.meshes)
    given = {
        name: getattr(options, name)
        for name in (*_FLAGS, "seeds", *_SETUP)
        if getattr(options, name) is not None
    }
    facts |= with_absolute_paths(given, Path.cwd(), options.meshes)
    if options.estimator:
        compared = list(facts.get("estimators", Study().estimators))
        added = [name for name in options.estimator if name not in compared]
        facts["estimators"] = [*compared, *added]
    return facts


def _study(options: argparse.Namespace) -> Study:
    """Return the study; an error names the file, unless the value is one of the command line."""
    from lis_grasp_studies.study.study import Study

    facts, described = _facts(options), _study_file(options)
    try:
        return Study.from_facts(facts)
    except InvalidOptionError as error:
        if described is None or getattr(options, str(error.option), None) is not None:
            raise
        raise InvalidOptionError(f"{described}: {error}", option=error.option) from None


def _study_file(options: argparse.Namespace) -> Path | None:
    """Return the file of the study: the one that is named, or that of the rows to report on."""
    own = (options.output or _OUTPUT) / "study.yaml"
    if options.study is not None:
        return own if own.resolve() == options.study.resolve() else options.study
    if options.quick or not (options.report_only or options.rerun) or not own.is_file():
        return None
    return own


def _rerun(results: StudyResults, options: argparse.Namespace) -> None:
    from lis_grasp_studies.study.results import job_of, without_times
    from lis_grasp_studies.study.run import run_trial

    recorded = results.row(options.rerun)
    study = _study(options)
    files = [*study.objects, *study.hands]
    if options.meshes is not None:  # files of a recorded study.yaml have absolute paths
        files.append(str((options.meshes / recorded["object"]).absolute()))
    job = job_of(recorded, files)
    with Stage(f"Repeating {recorded['key']}") as stage:
        (row,) = run_trial(job)
        stage.result = row["reason"]
    for name, value in row.items():
        say(f"{name:24s} {'' if value is None else value}")
    before, now = without_times(recorded), without_times(row)
    changed = [name for name in now if now[name] != before.get(name)]
    if changed:
        raise EstimationError(
            f"the row differs from the recorded one in {', '.join(changed)}: compare the column"
            f" 'versions', recorded {recorded['versions']}"
        )
    print("equal to the recorded row", file=sys.stderr)
