"""The `lis-grasp` command: its verbs and exit codes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from threadpoolctl import threadpool_limits

import lis_grasp
from lis_grasp.cli import (
    compare,
    doctor,
    estimate,
    explore,
    export,
    grasp,
    hand_files,
    lift,
    log_contacts,
    next_probe,
    paper,
    run,
    surfaces,
    view,
)
from lis_grasp.exceptions import InvalidInputError, LisGraspError

_VERBS = (
    *(run, explore, next_probe, log_contacts, estimate, grasp, lift, export),
    *(compare, surfaces, paper, view, hand_files, doctor),
)


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    parser = argparse.ArgumentParser(
        prog="lis-grasp",
        description="Learn an unknown object's shape by touch alone, and grasp it.",
    )
    parser.add_argument("--version", action="version", version=f"lis-grasp {lis_grasp.__version__}")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    for verb in _VERBS:
        verb.add_parser(verbs)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return 0 when done, 1 when it failed, 2 on misuse, 130 on Ctrl-C."""
    options = build_parser().parse_args(arguments)
    try:
        # Threads change the order of sums, and so the last digits of results.
        with threadpool_limits(1):
            options.execute(options)
    except LisGraspError as error:
        print(f"lis-grasp: {error}", file=sys.stderr)
        return 2 if isinstance(error, InvalidInputError) else 1
    except KeyboardInterrupt:
        print("lis-grasp: interrupted; the files already written are complete", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
