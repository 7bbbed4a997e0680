"""Rows of the baselines of a protocol, stored in the package, and how they are collected."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.json_lines import Row, append_lines, read_lines
from lis_grasp_studies.benchmark.objects import FOLDER
from lis_grasp_studies.benchmark.protocol import Protocol
from lis_grasp_studies.evaluation.results import EvaluationResults
from lis_grasp_studies.harness.tables import split

_DIGITS = 5
# Columns that say nothing of what was measured.
_LEFT_OUT = ("protocol", "job_seconds", "commit", "source")


def baseline_rows(version: int) -> list[Row]:
    """Return the stored rows of a protocol's baselines; none if there is no file."""
    path = _path(version)
    return read_lines(path)[1] if path.is_file() else []


def by_variant(protocol: Protocol, part: str, rows: Iterable[Row]) -> dict[str, list[Row]]:
    """Return the rows of one part by the name of what they measure."""
    column = protocol.tracks[part].experiment.variant
    return split((row for row in rows if row["part"] == part), column)


def store_baselines(protocol: Protocol, folders: Iterable[Path]) -> int:
    """Add the rows in folders of results to the baselines of a protocol; return their number.

    They replace all rows of the same track and name.
    """
    rows = [
        {name: _short(value) for name, value in row.items() if name not in _LEFT_OUT}
        for folder in folders
        for row in EvaluationResults(folder).read()
        if row["part"] in protocol.tracks
    ]

    def measured(row: Row) -> tuple[str, str]:
        return row["part"], row[protocol.tracks[row["part"]].experiment.variant]

    new, path = {measured(row) for row in rows}, _path(protocol.version)
    kept = [row for row in baseline_rows(protocol.version) if measured(row) not in new]
    write_text(path, "")
    path.unlink()
    append_lines(path, {"results": "baselines", "protocol": protocol.version}, [*kept, *rows])
    return len(rows)


def _short(value: object) -> object:
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value


def _path(version: int) -> Path:
    return FOLDER / f"baselines_{version}.jsonl"
