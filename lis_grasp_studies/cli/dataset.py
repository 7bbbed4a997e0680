"""`lis-grasp dataset`: runs as one Parquet file, for learning and for statistics."""

from __future__ import annotations

import argparse
from pathlib import Path

from lis_grasp.cli.progress import Stage, complain, say
from lis_grasp.exceptions import LisGraspError

HELP = "collect runs in one Parquet file: touches, estimate, grasps, outcome"
EXAMPLES = (("results --output runs.parquet", "every run in the folder and below it"),)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    parser.add_argument("folder", type=Path, metavar="RUNS", help="folder of folders of runs")
    parser.add_argument(
        "--output",
        type=Path,
        metavar="FILE",
        help="the file (default: runs.parquet in RUNS)",
    )
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Write the file; 1 if no run could be read."""
    from lis_grasp_studies.dataset import run_folders, write_dataset

    folders = run_folders(options.folder)
    path = options.output or options.folder / "runs.parquet"

    def skip(folder: Path, error: LisGraspError) -> None:
        complain(f"{folder} is left out: {error}")

    with Stage("Collecting runs") as stage:
        count = write_dataset(
            path, folders, report=lambda done: stage.count(done, len(folders)), skip=skip
        )
        stage.result = f"{count} of {len(folders)}"
    say(f"wrote {path}, {path.stat().st_size / 2**20:.1f} MiB")
    return 0 if count else 1
