"""Tables of contacts that lie: what is found, put right and refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.contact_study.lies import HARD, LIES
from lis_grasp_studies.harness.tables import (
    NONE,
    Column,
    Table,
    columns_by,
    grouped_table,
    mean_cell,
    split,
    values_of,
    where,
)

CLOSE = 1.15
"""Largest ratio of errors of an estimate that is as good as from true contacts."""


def lie_tables(rows: Sequence[Row], order: Sequence[str]) -> list[Table]:
    """Return what is found by family, by kind of lie, on hard sets, and of clean sets by draw.

    Families are columns in their order.
    """
    hard = {(draw[1], draw[2]) for draw in HARD}
    is_hard = [(row["count"], row["millimetres"]) in hard for row in rows]
    hard_rows = [row for row, flag in zip(rows, is_hard, strict=True) if flag]
    main = [row for row, flag in zip(rows, is_hard, strict=True) if not flag]
    families = {kind: where(main, lie=kind) for kind in LIES}
    in_order = sorted(rows, key=lambda row: order.index(row["family"]))
    by_family = columns_by("family", in_order, _percent("right"))
    groups = {"main": main, "few or noisy": hard_rows}
    kinds = {(kind, name): where(of, lie=kind) for kind in LIES for name, of in groups.items()}
    clean = split(where(rows, lie="clean"), "draw", "count", "millimetres")
    verdicts = _COLUMNS[:6]
    columns = _COLUMNS if any("blend" in row for row in rows) else verdicts
    first = "draw | number | noise [mm]"
    return [
        grouped_table("lies_by_family", "Wholly right by family [%]", "lie", families, by_family),
        grouped_table("lies", "By kind of lie", "lie | sets", kinds, columns),
        grouped_table("clean", "Clean sets by draw", first, clean, verdicts),
    ]


def _percent(*columns: str) -> Callable[[Sequence[Row]], str]:
    """Return a cell with the percentage of rows in which one of some columns is true."""

    def cell(rows: Sequence[Row]) -> str:
        true = [any(row.get(name) for name in columns) for row in rows]
        return f"{100.0 * np.mean(true):.1f}" if true else NONE

    return cell


def _per_contact(part: str, whole: str) -> Callable[[Sequence[Row]], str]:
    def cell(rows: Sequence[Row]) -> str:
        total = values_of(rows, whole).sum()
        return f"{100.0 * values_of(rows, part).sum() / total:.2f}" if total else NONE

    return cell


def _ratios(name: str) -> Callable[[Sequence[Row]], str]:
    """Return a cell with the rate of ratios up to `CLOSE`, and their geometric mean."""

    def cell(rows: Sequence[Row]) -> str:
        values = values_of(rows, name)
        if not len(values):
            return NONE
        return f"{100 * np.mean(values <= CLOSE):.0f} % / {np.exp(np.log(values).mean()):.2f}"

    return cell


_COLUMNS: Sequence[Column] = (
    ("sets", lambda rows: str(len(rows))),
    ("wholly right %", _percent("right")),
    ("right or said %", _percent("right", "said", "refused")),
    ("refused %", _percent("refused")),
    ("bad found %", _per_contact("found", "bad")),
    ("sound doubted %", _per_contact("false", "contacts")),
    *((f"{name}, judged", _ratios(name)) for name in ("blend", "gpis")),
    *((f"{name}, believed", _ratios(f"{name}_raw")) for name in ("blend", "gpis")),
    ("within 1.96 sd %", mean_cell("blend_within", 100.0, 0)),
)
