"""Parquet files of rows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from lis_grasp.exceptions import InvalidFileError, needed_package
from lis_grasp.io.atomic_writing import whole_file
from lis_grasp.io.json_lines import Row
from lis_grasp.io.limits import MEBIBYTE

_MOST_BYTES = 2048 * MEBIBYTE  # of a file, unpacked


def read_parquet(path: Path, advice: str = "restore it from a copy") -> list[Row]:
    """Return the rows of a Parquet file; raise `InvalidFileError` if it cannot be read."""
    _, parquet = _pyarrow()
    try:
        # ParquetFile and not read_table: a file alone, no data set around it.
        file = parquet.ParquetFile(path)
        groups = map(file.metadata.row_group, range(file.metadata.num_row_groups))
        if sum(group.total_byte_size for group in groups) > _MOST_BYTES:
            raise ValueError(f"it unpacks to more than {_MOST_BYTES // MEBIBYTE} MiB")
        rows: list[Row] = file.read().to_pylist()
    # Damaged files raise errors of Arrow, of the system and of several built-in types.
    except Exception as error:  # noqa: BLE001
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InvalidFileError(f"cannot read {path}: {reason}; {advice}", path=path) from None
    return rows


def write_parquet(path: Path, rows: Sequence[Row]) -> None:
    """Write rows with all columns that occur."""
    arrow, parquet = _pyarrow()
    names = dict.fromkeys(name for row in rows for name in row)
    table = arrow.table({name: [row.get(name) for row in rows] for name in names})
    with whole_file(path) as temporary:
        parquet.write_table(table, temporary, compression="zstd")


def _pyarrow() -> tuple[ModuleType, ModuleType]:
    """Return pyarrow and its module for Parquet files."""
    with needed_package("pyarrow", "study"):
        import pyarrow
        from pyarrow import parquet
    return pyarrow, parquet
