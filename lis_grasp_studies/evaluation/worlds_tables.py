"""Tables and numbers of runs beside other bodies, each compared with the same run alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.evaluation.world_scenes import CLOSED, SCENES, is_tight
from lis_grasp_studies.harness.tables import NONE, Column, Table, grouped_table, split

ALONE = "alone"
"""The scene without another body."""
DOES_NOT_FIT = "does_not_fit"
"""Reason of a run whose object does not fit into its scene."""
ALLOWED = 2.0
"""Force on what must not be touched [N]."""

_FAR = 10.0  # a neighbour that moved farther was moved [mm]
_SAID = 20  # probes after which a missing way must have been said


def losses_table(rows: Sequence[Row]) -> Table:
    """Return the runs beside bodies that were not held gently though held alone, one a line."""
    head = ("scene", "object", "hand", "lift", "force [N]", "pushed")
    lost = (
        (row["scene"], row["object"], row["hand"], row["reason"])
        + (f"{_force(row):.1f}", row.get("pushed") or NONE)
        for row, alone in _pairs(rows)
        if _is_held(alone) and not _is_held(row)
    )
    return Table("losses", "Held alone, lost beside other bodies", head, tuple(lost))


def worlds_table(rows: Sequence[Row]) -> Table:
    """Return what is held, felt, moved and spent alone, in each scene, and in all of a kind."""
    columns: list[Column] = [
        ("runs", lambda rows: str(len(rows))),
        ("held gently, of those held alone", lambda of: _percent(_kept(of, rows))),
        ("maps lost", lambda of: str(sum(_all(of, "lost")))),
        ("falsely", lambda of: str(sum(_all(of, "lost_wrongly")))),
        ("blocked [%]", lambda of: _percent(_blocked(of))),
        ("refused before", lambda of: str(sum(_all(of, "refused")))),
        ("contacts of bodies", lambda of: str(sum(_all(of, "contacts_of_bodies")))),
        ("given wrongly", lambda of: str(sum(_all(of, "given_wrongly")))),
        ("largest force [N]", lambda of: f"{max(map(_force, of), default=0.0):.1f}"),
        ("moved [mm]", lambda of: f"{max(_all(of, 'moved_mm'), default=0.0):.1f}"),
        ("CPU of touch", lambda of: _ratio(of, rows, "cpu_touch")),
        ("CPU", lambda of: _ratio(of, rows, "cpu")),
        ("MuJoCo agrees [%]", lambda of: _percent(_mean(_judged_alike(of)))),
    ]
    fitting = _fitting(rows)
    groups = {_label(name): _in(fitting, name) for name in (ALONE, *SCENES)}
    groups |= {"all wide": _kind(fitting, tight=False), "all tight": _kind(fitting, tight=True)}
    title = "Beside other bodies, compared with the same runs alone"
    return grouped_table("worlds", title, "scene", groups, columns)


def published(rows: Sequence[Row]) -> dict[str, float]:
    """Return the numbers that pages quote, by name: counts, percent and ratios."""
    fitting = _fitting(rows)
    wide, tight = (_kind(fitting, tight=kind) for kind in (False, True))
    beside, closed = wide + tight, [row for row in rows if row["scene"] == CLOSED]
    numbers = {
        "runs": len(beside),
        "lost wrongly": sum(_all(beside, "lost_wrongly")),
        "lost wrongly alone": sum(_all(_in(fitting, ALONE), "lost_wrongly")),
        "pushed": sum(_force(row) > ALLOWED for row in beside),
        "largest force": max(map(_force, beside), default=np.nan),
        "moved": sum(moved > _FAR for moved in _all(beside, "moved_mm")),
        "farthest": max(_all(beside, "moved_mm"), default=np.nan),
        "felt": sum(_all(beside, "felt")),
        "of bodies": sum(_all(beside, "contacts_of_bodies")),
        "given wrongly": sum(_all(beside, "given_wrongly")),
        "judged": len(_judged_alike(beside)),
        "judged alike": sum(_judged_alike(beside)),
        "closed": len(closed),
        "said": sum(map(_is_said, closed)),
        "held alone": 100.0 * _mean(map(_is_held, _in(fitting, ALONE))),
    }
    for name, of in (("wide", wide), ("tight", tight)):
        numbers |= {f"runs {name}": len(of), f"held {name}": 100.0 * _kept(of, rows)}
    for name in (ALONE, *SCENES):
        numbers[f"blocked {name}"] = 100.0 * _blocked(_in(fitting, name))
    for kind in ("fixed", "free"):
        numbers[f"kept {kind}"] = 100.0 * _kept([r for r in beside if kind in r["scene"]], rows)
    for name, of in split(beside, "scene").items():
        numbers[f"cpu {name}"] = _median_ratio(of, rows, "cpu")
    return numbers


def _label(scene: str) -> str:
    return f"{scene}, tight" if is_tight(scene) else scene


def _fitting(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of trials whose object fits into its scene."""
    return [row for row in rows if row["reason"] != DOES_NOT_FIT]


def _in(rows: Sequence[Row], scene: str) -> list[Row]:
    return [row for row in rows if row["scene"] == scene]


def _kind(rows: Sequence[Row], *, tight: bool) -> list[Row]:
    return [row for row in rows if row["scene"] in SCENES and is_tight(row["scene"]) == tight]


def _pairs(rows: Sequence[Row], of: Sequence[Row] | None = None) -> list[tuple[Row, Row]]:
    """Return runs beside bodies, all by default, each with the same run alone."""
    alone = {_key(row): row for row in _in(rows, ALONE)}
    beside = [row for row in _fitting(rows if of is None else of) if row["scene"] in SCENES]
    return [(row, alone[_key(row)]) for row in beside if _key(row) in alone]


def _key(row: Row) -> tuple[Any, ...]:
    return tuple(row[name] for name in ("object", "hand", "seed", "policy"))


def _all(rows: Sequence[Row], name: str) -> list[Any]:
    return [row[name] for row in rows if name in row]


def _force(row: Row) -> float:
    return float(max(row.get("touch_force", 0.0), row.get("lift_force", 0.0)))


def _is_held(row: Row) -> bool:
    """Return whether a run was held with at most 2 N on each other body."""
    return bool(row["held"]) and _force(row) <= ALLOWED


def _is_said(row: Row) -> bool:
    """Return whether a run in the closed box ended early, and named a body that is in the way."""
    ended = row.get("ended", "")
    return row.get("probes", np.inf) <= _SAID and "is in the way" in ended


def _judged_alike(of: Sequence[Row]) -> list[bool]:
    """Return of each executed grasp whether it is held in both simulators or in none."""
    judged = [row for row in of if row.get("held_in_mujoco") is not None]
    return [row["held"] == row["held_in_mujoco"] for row in judged]


def _mean(values: Any) -> float:
    return float(np.mean([*values] or [np.nan]))


def _kept(of: Sequence[Row], rows: Sequence[Row]) -> float:
    """Return the fraction held gently of the runs whose pair was held alone."""
    return _mean(_is_held(row) for row, alone in _pairs(rows, of) if _is_held(alone))


def _blocked(rows: Sequence[Row]) -> float:
    probes = sum(_all(rows, "probes"))
    return sum(_all(rows, "blocked")) / probes if probes else np.nan


def _median_ratio(of: Sequence[Row], rows: Sequence[Row], name: str) -> float:
    """Return the median of the paired ratios beside bodies to alone."""
    pairs = [(row, alone) for row, alone in _pairs(rows, of) if name in row and name in alone]
    return float(np.median([row[name] / alone[name] for row, alone in pairs] or [np.nan]))


def _ratio(of: Sequence[Row], rows: Sequence[Row], name: str) -> str:
    ratio = _median_ratio(of, rows, name)
    return NONE if np.isnan(ratio) else f"{ratio:.2f}"


def _percent(fraction: float) -> str:
    return NONE if np.isnan(fraction) else f"{100.0 * fraction:.0f}"
