"""Command lines of programs such as benchmarks, from the defaults of their options."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from lis_grasp.exceptions import InvalidOptionError, LisGraspError

if TYPE_CHECKING:
    from lis_grasp_studies.harness.runner import Scheduler


def read_options(
    description: str | None, arguments: Sequence[str] | None = None, /, **defaults: Any
) -> argparse.Namespace:
    """Return the options of a program, each with its default.

    A list takes several values of the type of its first, True or False is a flag, and a type stands
    for a value of this type that need not be given. `objects` and `folder` are positional.

    Parameters
    ----------
    description
        The first line is the program's help.
    arguments
        Of the command line; those of this process if None.
    defaults
        Default values by the names of the options.
    """
    parser = argparse.ArgumentParser(description=(description or "").split("\n")[0])
    for name, default in defaults.items():
        flag = name if name in ("objects", "folder") else f"--{name.replace('_', '-')}"
        options: dict[str, Any] = {"default": default, "help": f"(default: {default})"}
        if isinstance(default, type):
            options = {"default": None, "type": default}
            if flag == name:
                del options["default"]
        elif isinstance(default, bool):
            options = {"action": "store_true"}
        elif isinstance(default, list | tuple):
            kind = type(default[0]) if default else str
            shown = " ".join(map(str, default))
            options = {
                "nargs": "*" if flag == name else "+",
                "type": kind,
                "default": list(default),
            }
            options["help"] = f"(default: {shown})"
        else:
            options["type"] = type(default)
        parser.add_argument(flag, **options)
    return parser.parse_args(arguments)


def exit_code(program: str, work: Callable[[], object]) -> int:
    """Do the work of a program; return 0, or 1 after its error was printed."""
    try:
        work()
    except LisGraspError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return 1
    return 0


def add_estimator(parser: argparse.ArgumentParser) -> None:
    """Add an estimator beside those that a study compares; it may be repeated."""
    parser.add_argument(
        "--estimator",
        action="append",
        metavar="NAME",
        help="an estimator to add to those compared, such as your own as my.module:Class; may be"
        " repeated",
    )


def add_scheduler(parser: argparse.ArgumentParser) -> None:
    """Add the number of processes, and the address of a cluster."""
    from lis_grasp.cli import options as opt

    opt.add_jobs(parser)
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="address of a Dask cluster, tcp://host:port"
    )


def require_no_workers(options: argparse.Namespace) -> None:
    """Raise `InvalidOptionError` for workers of a program that is to report only."""
    for name in ("jobs", "scheduler"):
        if options.report_only and getattr(options, name) is not None:
            message = f"--report-only runs nothing: leave out --{name}"
            raise InvalidOptionError(message, option=f"--{name}")


def scheduler_of(options: argparse.Namespace) -> Scheduler:
    """Return the scheduler that the options of `add_scheduler` name."""
    from lis_grasp_studies.harness.runner import DaskCluster, local_scheduler

    if options.scheduler is None:
        return local_scheduler(options.jobs)
    if options.jobs is not None:
        raise InvalidOptionError("--scheduler excludes --jobs", option="--scheduler")
    return DaskCluster(options.scheduler)
