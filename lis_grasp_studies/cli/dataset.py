"""`lis-grasp dataset`: runs as a Parquet file or as a LeRobot data set."""

from __future__ import annotations

import argparse
from pathlib import Path

from lis_grasp.cli.progress import Stage, complain, say
from lis_grasp.exceptions import LisGraspError

HELP = "collect runs in a Parquet file or LeRobot data set: touches, grasps, outcome"
EXAMPLES = (
    ("results --output runs.parquet", "every run in the folder and below it"),
    ("results --lerobot touches", "the touches and outcomes as a LeRobot data set"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    parser.add_argument("folder", type=Path, metavar="RUNS", help="folder of folders of runs")
    parser.add_argument(
        "--output",
        type=Path,
        metavar="FILE",
        help="the file (default: runs.parquet in RUNS)",
    )
    parser.add_argument(
        "--lerobot",
        type=Path,
        metavar="FOLDER",
        help="write a LeRobot data set in a new folder instead",
    )
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Write the file or the folder; 1 if no run could be read."""
    from lis_grasp_studies.dataset import run_folders, write_dataset
    from lis_grasp_studies.lerobot_dataset import write_lerobot

    folders = run_folders(options.folder)
    path = options.lerobot or options.output or options.folder / "runs.parquet"
    write = write_lerobot if options.lerobot else write_dataset

    def skip(folder: Path, error: LisGraspError) -> None:
        complain(f"{folder} is left out: {error}")

    with Stage("Collecting runs") as stage:
        count = write(path, folders, report=lambda done: stage.count(done, len(folders)), skip=skip)
        stage.result = f"{count} of {len(folders)}"
    files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
    say(f"wrote {path}, {sum(file.stat().st_size for file in files) / 2**20:.1f} MiB")
    return 0 if count else 1
