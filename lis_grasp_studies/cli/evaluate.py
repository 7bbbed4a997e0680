"""`lis-grasp evaluate`: every published number, measured from one configuration file."""

from __future__ import annotations

import argparse
import logging
import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from lis_grasp.cli.progress import Stage, next_step, say
from lis_grasp.exceptions import (
    EstimationError,
    InvalidFileError,
    InvalidOptionError,
    require_packages,
)
from lis_grasp.io.atomic_writing import sole_writer, write_text
from lis_grasp.version import __version__
from lis_grasp_studies.harness.program import add_scheduler, require_no_workers, scheduler_of

if TYPE_CHECKING:
    from lis_grasp.io.json_lines import Row
    from lis_grasp_studies.evaluation.configuration import Configuration
    from lis_grasp_studies.evaluation.results import EvaluationResults

HELP = "measure every published number from one file; one page of results"
EXAMPLES = (
    ("--quick", "every table, from few objects: twenty minutes on two cores"),
    ("--hours 3", "the most important numbers first; run again, it continues"),
)

_OUTPUT = Path("results/evaluate")
_LONG = 1e6  # [s] of no use to show
_LOG = logging.getLogger("lis_grasp")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    from lis_grasp.cli import options as opt

    parser.description = (
        "Measure what the results page says: the paper's experiments, surfaces, lies, views,"
        " grasps in three simulators, and arms. Seeds come in rounds, in a round the parts in"
        " the order of the file. Run again, it continues with what is missing. Needs the extra"
        " study."
    )
    parser.add_argument(
        "config",
        nargs="?",
        type=Path,
        metavar="CONFIG.yaml",
        help="what to measure (default: the published numbers, three hours on two cores)",
    )
    parser.add_argument(
        "--quick", action="store_true", help="every table, from few objects and seeds"
    )
    parser.add_argument(
        "--hours", type=float, metavar="H", help="end before a trial that would take longer"
    )
    parser.add_argument("--parts", nargs="+", metavar="NAME", help="parts (default: all)")
    parser.add_argument(
        "--meshes", type=Path, metavar="FOLDER", help="folder of the scans (default: none of them)"
    )
    parser.add_argument(
        "--earlier",
        type=Path,
        metavar="ROWS.parquet",
        help="rows of the study by an earlier version, to compare with trial by trial",
    )
    parser.add_argument(
        "--beside",
        type=Path,
        metavar="FOLDER",
        help="source of another version, whose commands are timed in turns with this one's",
    )
    parser.add_argument(
        "--fill",
        nargs=2,
        type=Path,
        metavar=("TEMPLATE", "PAGE"),
        help="also write a page from a text whose numbers and tables are fields, such as"
        " docs/study/results.md.in",
    )
    parser.add_argument(
        "--report-only",
        action="store_true",
        help="measure nothing: report on the rows there are, as made with the --hours, --meshes and"
        " --beside that are given",
    )
    add_scheduler(parser)
    opt.add_output(parser, str(_OUTPUT))
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Measure what is missing, store the rows and write the page."""
    from lis_grasp_studies.evaluation.configuration import SHIPPED, Configuration
    from lis_grasp_studies.evaluation.page import fill_template, state_of, write_results
    from lis_grasp_studies.evaluation.results import EvaluationResults
    from lis_grasp_studies.harness.parquet import read_parquet
    from lis_grasp_studies.harness.tables import split

    require_packages("pyarrow", "statsmodels", extra="study", option="evaluate")
    if options.quick and options.config is not None:
        raise InvalidOptionError("--quick excludes a configuration", option="--quick")
    require_no_workers(options)
    if options.fill and not options.fill[0].is_file():
        raise InvalidOptionError.out_of_range(
            "--fill", str(options.fill[0]), "a text that exists, then a page"
        )
    output: Path = options.output or _OUTPUT
    stored = output / "configuration.yaml"
    path = options.config or SHIPPED / ("quick.yaml" if options.quick else "published.yaml")
    if options.report_only and stored.is_file() and not (options.config or options.quick):
        path = stored
    configuration, text = Configuration.load(path, options.parts), path.read_text(encoding="utf-8")
    earlier = read_parquet(options.earlier) if options.earlier else []
    options.until_end.enter_context(sole_writer(output))
    results = EvaluationResults(output)
    failure = None if options.report_only else _measure(configuration, results, options)
    rows = results.read(any_version=options.report_only)
    if not rows:
        raise failure or InvalidOptionError(
            f"a report needs rows; {output} has none", option="--report-only"
        )
    if path != stored:
        write_text(stored, text)
    with _known_columns(rows, output):
        parts = configuration.ordered(rows)
        if path == stored and not results.lines.path.is_file():
            # Parquet files beside their configuration have all its rows in order, and no others.
            found = split(rows, "part")
            parts = {name: found[name] for name in configuration.parts if name in found}
        with Stage("Reporting") as stage:
            if results.lines.path.is_file():  # else the Parquet files have the rows, maybe more
                results.write_parquet(parts)
            write_results(output, configuration, parts, command=_command(options), earlier=earlier)
            if options.fill:
                template, page = options.fill
                write_text(page, fill_template(template, configuration, parts, earlier))
            stage.result = f"{len(rows)} rows of {state_of(parts)}"
    say(f"wrote {output}/results.md, report.html, numbers.json, configuration.yaml")
    say("      and folders rows, tables, charts")
    say(next_step("open {} in a browser", output / "report.html"))
    if failure is not None:
        raise failure


@contextmanager
def _known_columns(rows: Sequence[Row], folder: Path) -> Iterator[None]:
    """Say of rows of another version that they lack what is reported."""
    try:
        yield
    except (LookupError, TypeError, ValueError) as error:
        versions = {row["version"] for row in rows} - {__version__}
        if not versions:
            raise
        raise InvalidFileError(
            f"rows of lis_grasp {', '.join(sorted(versions))} in {folder} lack what {__version__}"
            f" reports ({type(error).__name__}: {error}): report on them with their version",
            path=folder,
        ) from None


def _measure(
    configuration: Configuration, results: EvaluationResults, options: argparse.Namespace
) -> EstimationError | None:
    """Measure what is missing; return the error of trials that failed, after all others."""
    from lis_grasp_studies.evaluation.part import Places
    from lis_grasp_studies.evaluation.results import Evaluation

    hours, scheduler = options.hours, scheduler_of(options)
    if hours is not None and not hours > 0.0:
        raise InvalidOptionError.out_of_range("--hours", hours, "above 0")
    for name, needed in (("meshes", "."), ("beside", "lis_grasp")):
        folder = getattr(options, name)
        if folder is not None and not (folder / needed).is_dir():
            what = "a folder" if needed == "." else f"a folder that has {needed}/"
            raise InvalidOptionError.out_of_range(f"--{name}", str(folder), what)
    places = Places(*(p and p.absolute() for p in (options.meshes, options.beside)))
    left_out = sum(1 for _ in configuration.jobs(None)) - sum(1 for _ in configuration.jobs(places))
    if left_out:
        say(
            f"{left_out} trials are left out: they need scans (--meshes) or hands that are not here"
        )
    evaluation = Evaluation(configuration, places, results, scheduler, hours)
    with Stage("Measuring") as stage:
        try:
            for done, total, seconds in evaluation.run():
                minutes = f"{seconds / 60.0:.0f} minutes left" if seconds < _LONG else ""
                _LOG.info("%d of %d trials %s", done, total, minutes)
                stage.result = f"{done} of {total} trials"
        except EstimationError as error:
            return error
    return None


def _command(options: argparse.Namespace) -> str:
    """Return the command with the options that decide on its rows."""
    words = ["lis-grasp", "evaluate", *([str(options.config)] if options.config else [])]
    words += ["--quick"] if options.quick else []
    words += ["--hours", f"{options.hours:g}"] if options.hours else []
    words += ["--parts", *options.parts] if options.parts else []
    for name in ("meshes", "beside", "earlier"):
        value = getattr(options, name)
        words += [f"--{name}", value.name] if value else []
    return shlex.join(words)
