"""Runs another planner in an interpreter of its own, for comparisons; no part of it is imported."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path


def run_peer(job: dict, folder: Path, *, name: str, source: Path, python: Path) -> dict:
    """Return the result of a job of the planner's worker, such as frogger_worker.py.

    The worker beside this file gets the planner's `source` and files of the job and the result in
    `folder`. Exits with one sentence if the interpreter or the worker does not run.
    """
    job_file, result_file = folder / "job.json", folder / "result.json"
    job_file.write_text(json.dumps(job))
    worker = Path(__file__).with_name(f"{name.lower()}_worker.py")
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    command = [str(part) for part in (python, worker, source, job_file, result_file)]
    try:
        process = subprocess.run(command, env=environment, capture_output=True, text=True)
    except OSError as error:
        sys.exit(f"--{name.lower()}-python must be an interpreter that runs: {error}")
    if process.returncode:
        last = (process.stderr.strip().splitlines() or ["no message"])[-1]
        sys.exit(f"{name} of {source} must run with {python}; it ended with: {last}")
    return json.loads(result_file.read_text())
