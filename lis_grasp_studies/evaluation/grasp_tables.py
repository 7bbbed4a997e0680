"""Tables, charts and rates of grasps on unknown objects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import itemgetter

import numpy as np

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.evaluation.part import Groups, group_of
from lis_grasp_studies.figures import charts
from lis_grasp_studies.figures.palette import estimator_label
from lis_grasp_studies.harness.page import Picture
from lis_grasp_studies.harness.statistics import interval_over_objects
from lis_grasp_studies.harness.tables import (
    NONE,
    Column,
    Table,
    columns_by,
    grouped_table,
    median_cell,
    split,
    where,
)
from lis_grasp_studies.study.cells import difference, gains, held_text
from lis_grasp_studies.study.comparison import names, pairs_of
from lis_grasp_studies.study.trial import TRIAL_COLUMNS

REFERENCE, SUBJECT = "gpis", "blend"
ALL = "all"
_key = itemgetter(*TRIAL_COLUMNS, "estimator")
_TIMES = ("touch", "estimate", "grasp", "lift")
_MOST_LOST = 12  # objects that are listed
_CAPTION = (
    "Percent of grasps that lift the object and hold it through the shake, as planned. Dots are"
    " seeds, lines one standard deviation between seeds."
)


def held_rate(rows: Sequence[Row]) -> float:
    """Return the rate of trials that are held [%]."""
    return float(100.0 * np.mean([bool(row["held"]) for row in rows]))


def tested(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of grasps that were tested by touch before the lift."""
    return [row for row in rows if row["closings"]]


def families_table(rows: Sequence[Row], objects: Groups) -> Table:
    """Return the rates of each group of objects, where blend loses most to GPIS first."""

    def lead(rows: Sequence[Row]) -> float:
        both = (where(rows, estimator=name) for name in (SUBJECT, REFERENCE))
        rates = [held_rate(of) if of else 0.0 for of in both]
        return rates[0] - rates[1]

    family = group_of(objects)
    named = [row | {"family": family[row["object"]]} for row in rows if row["object"] in family]
    by_family = split(named, "family")
    ordered = {n: by_family[n] for n in sorted(by_family, key=lambda n: lead(by_family[n]))}
    columns: list[Column] = [
        ("objects", lambda rows: str(len(names(rows, "object")))),
        *columns_by("estimator", rows, _percent, lambda name: f"{estimator_label(name)} [%]"),
        (
            f"{estimator_label(SUBJECT)} minus {estimator_label(REFERENCE)}, other objects",
            lambda rows: difference(pairs_of(rows, [SUBJECT], REFERENCE)),
        ),
    ]
    title = "Held by family, in percent, the greatest loss first"
    return grouped_table("families", title, "family", {**ordered, ALL: list(rows)}, columns)


def _percent(rows: Sequence[Row]) -> str:
    return f"{held_rate(rows):.0f}" if rows else NONE


def lost_table(rows: Sequence[Row]) -> Table:
    """Return the objects that blend holds least often."""
    groups = {
        name: of for name, of in split(rows, "object").items() if where(of, estimator=SUBJECT)
    }
    ordered = sorted(groups, key=lambda name: held_rate(where(groups[name], estimator=SUBJECT)))
    columns = columns_by("estimator", rows, _percent, estimator_label)
    columns.append(("how blend ended", _reasons))
    lost = {name: groups[name] for name in ordered[:_MOST_LOST]}
    return grouped_table("lost", "Objects held least often, in percent", "object", lost, columns)


def _reasons(rows: Sequence[Row]) -> str:
    reasons = split(where(rows, estimator=SUBJECT, held=False), "reason")
    counts = sorted(((len(of), reason) for reason, of in reasons.items()), reverse=True)
    return ", ".join(f"{reason} {count}" for count, reason in counts) or "held"


def ways_table(rows: Sequence[Row]) -> Table:
    """Return the grasps held by each estimator, by the grasp's own family and hand."""
    columns = columns_by("estimator", rows, _count_of, estimator_label)
    groups = split([row for row in rows if row.get("family")], "family", "hand")
    ordered = {key: groups[key] for key in sorted(groups)}
    return grouped_table("ways", "Held by family of the grasp", "grasp | hand", ordered, columns)


def _count_of(rows: Sequence[Row]) -> str:
    return f"{len(where(rows, held=True))} of {len(rows)}"


def attempts_table(rows: Sequence[Row]) -> Table:
    """Return the rates of grasps lifted as planned, and of tested ones in some attempts."""
    once = {_key(row): row for row in where(rows, closings=0)}
    pairs = [(row, once[_key(row)]) for row in tested(rows) if _key(row) in once]
    groups = {
        (estimator_label(name), str(most)): [
            pair for pair in pairs if (pair[0]["estimator"], pair[0]["attempts"]) == (name, most)
        ]
        for name, most in split(tested(rows), "estimator", "attempts")
    }
    columns: list[Column] = [
        ("trials", lambda pairs: str(len(pairs))),
        ("as planned", lambda pairs: held_text([other for _, other in pairs])),
        ("tested", lambda pairs: held_text([row for row, _ in pairs])),
        ("difference in points", lambda pairs: difference(pairs)),
        ("grasps", lambda pairs: f"{np.mean([row['executed'] or 0 for row, _ in pairs]):.1f}"),
    ]
    title = "Held as planned, and tested by touch in one or several attempts, in percent"
    return grouped_table("attempts", title, "estimator | attempts", groups, columns)


def stages_table(rows: Sequence[Row]) -> Table:
    """Return the grasps held, and the times of the stages, by hand and number of touches."""
    columns: list[Column] = [
        ("held", _count_of),
        *((f"{name} [s]", median_cell(f"seconds_{name}", digits=2)) for name in _TIMES),
    ]
    groups = split([r for r in rows if r["estimator"] == SUBJECT], "hand", "touches")
    title = f"Held, and median times of the stages, {estimator_label(SUBJECT)}"
    return grouped_table("stages", title, "hand | touches", groups, columns)


def rates_chart(rows: Sequence[Row], group: Callable[[Row], str], title: str) -> Picture:
    """Return a chart of the held rate of each estimator in groups of rows, in their order."""
    values: dict[str, dict[str, list[float]]] = {}
    for name, of in split(rows, "estimator").items():
        for row in of:
            values.setdefault(name, {}).setdefault(group(row), [])
        for text, members in values[name].items():
            chosen = [row for row in of if group(row) == text]
            members += [held_rate(seed) for seed in split(chosen, "seed").values()]
    return Picture.of(title, _CAPTION, charts.bars(values, title="", ylabel="held [%]"))


def beside_table(rows: Sequence[Row], earlier: Sequence[Row], objects: Groups) -> Table:
    """Return the rates of trials that an earlier version made too, where this is worse first."""
    known = {_key(row): row for row in earlier}
    family = group_of(objects)
    groups: dict[tuple[str, str], list[tuple[Row, Row]]] = {}
    for row in where(rows, closings=0):
        if (other := known.get(_key(row))) is not None:
            for group in (family.get(row["object"], NONE), ALL):
                label = estimator_label(row["estimator"])
                groups.setdefault((label, group), []).append((row, other))

    def verdict(pairs: Sequence[tuple[Row, Row]]) -> str:
        _, high = interval_over_objects([row for row, _ in pairs], gains(pairs))
        if gains(pairs).mean() >= 0.0:
            return ""
        return "clearly worse" if high is not None and high < 0.0 else "worse"

    columns: list[Column] = [
        ("trials", lambda pairs: str(len(pairs))),
        ("before [%]", lambda pairs: _percent([other for _, other in pairs])),
        ("now [%]", lambda pairs: _percent([row for row, _ in pairs])),
        ("difference, other objects", lambda pairs: difference(pairs)),
        ("this version is", verdict),
    ]
    ordered = dict(sorted(groups.items(), key=lambda group: gains(group[1]).mean()))
    title = "Beside the earlier version, trial by trial: the greatest loss first"
    return grouped_table("beside", title, "estimator | family", ordered, columns)
