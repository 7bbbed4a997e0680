"""Make docs/study.md from the rows of the study of unknown objects, and nothing else.

python docs/study/make_page.py          # from the rows beside this file
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from string import Template

import numpy as np
from parts import GROUPS, parts_table
from simulators import KINDS, difference_table, disagreements, disagreements_table, held_table
from write_studies import SEEDS, facts_of, objects

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline.run_config import SIMULATORS
from lis_grasp.shapes import NAMES
from lis_grasp_studies.report_page import TextTable
from lis_grasp_studies.statistics import (
    cluster_sums,
    clusters_of,
    holm,
    numbered,
    objects_of,
    sign_flip_p_value,
)
from lis_grasp_studies.study import StudyResults
from lis_grasp_studies.study.comparison import compare_one, names, pairs_of
from lis_grasp_studies.study.mixed_model import MixedModel, fit_mixed_model
from lis_grasp_studies.study.paired_tables import (
    Pairs,
    beside,
    by_object_table,
    cells,
    difference,
    families_table,
    gains,
    means,
    units_table,
)
from lis_grasp_studies.study.study_figures import draw_pictures
from lis_grasp_studies.study.study_tables import (
    MEASURE_LABELS,
    calibration_table,
    p_value,
    reasons_table,
    summary_table,
)
from lis_grasp_studies.study.trial import TRUTH
from lis_grasp_studies.test_objects.shape_sets import EVALUATION, TOOLS
from lis_grasp_studies.trial_results import TrialResults

_HERE = Path(__file__).parent
_DOCS = _HERE.parent
_OURS, _REFERENCE = "blend", "gpis"

_SMALL_SLIP = 5e-3  # slips above it are reported [m]


def make_page(rows_folder: Path, docs: Path) -> Path:
    """Write study.md and its figure below `docs`; return its path."""
    rows = _rows(rows_folder)
    if not rows:
        raise InvalidFileError(
            f"no row of {rows_folder} is of the study of unknown objects", path=rows_folder
        )
    template = Template((_HERE / "study.md.in").read_text(encoding="utf-8"))
    picture = next(iter(draw_pictures(rows)))
    file = "images/study.png"
    (docs / "images").mkdir(parents=True, exist_ok=True)
    (docs / file).write_bytes(picture.png)
    words = _facts(rows) | _further_tables(rows_folder)
    words |= {"picture": f"![{picture.title}]({file})"}
    write_text(docs / "study.md", template.substitute(words))
    return docs / "study.md"


def _rows(folder: Path) -> list[Row]:
    """Return the rows of the study in its order; no model of a hand is needed."""
    orders = [objects(), *(facts_of("allegro")[name] for name in ("estimators", "touches"))]
    found = [
        row
        for row in StudyResults(folder).read(any_version=True)
        if row["object"] in orders[0]
        and row["seed"] in SEEDS.get(row["hand"], ())
        and row.get("conditions") == "unknown"
    ]

    def place(row: Row) -> tuple[int, ...]:
        values = (row["object"], row["estimator"], row["touches"])
        indices = [order.index(value) for order, value in zip(orders, values, strict=True)]
        return (indices[1], row["seed"], indices[0], indices[2])

    return sorted(found, key=place)


def _facts(rows: Sequence[Row]) -> dict[str, str]:
    pairs = pairs_of(rows, [_OURS], _REFERENCE)
    found = compare_one(rows, _OURS, _REFERENCE, "held", "all", None)
    assert found is not None
    families = list(dict.fromkeys(map(_family, (mine for mine, _ in pairs))))
    unions = {
        "evaluation shapes together": EVALUATION,
        "all but built-in shapes and scans": (*EVALUATION, _TOOLS),
    }
    rates = {
        name: f"{100.0 * np.mean([row['held'] for row in rows if row['estimator'] == name]):.0f}"
        for name in names(rows, "estimator")
    }
    first = {(r["object"], r["hand"], r["seed"]) for r in rows}
    tools = means([pair for pair in pairs if _family(pair[0]) == _TOOLS], "held")
    model = fit_mixed_model(rows, _OURS, _REFERENCE)
    calibration = calibration_table(rows)
    mine = [row for row, _ in pairs]
    of_objects, of_seeds = objects_of(mine), numbered([row["seed"] for row in mine])
    return {
        "held_ours": rates[_OURS],
        "held_reference": rates[_REFERENCE],
        "held_truth": rates[TRUTH],
        "effect": difference(pairs, over_objects=True),
        "effect_seeds": difference(pairs).partition(" ")[2].strip("()"),
        "evaluation": difference(
            [pair for pair in pairs if _family(pair[0]) in EVALUATION], over_objects=True
        ),
        "tools": "{:.0f} and {:.0f} %".format(*(100.0 * rate for rate in tools or ())),
        "differ": str(found.wins + found.losses),
        "wins": str(found.wins),
        "losses_count": str(found.losses),
        "pairs": str(found.pairs),
        "same": str(sum(mine["rmsd"] == its["rmsd"] is not None for mine, its in pairs)),
        "seeds": ", ".join(
            f"`{hand}` {len({key[2] for key in first if key[1] == hand})} of {len(seeds)}"
            for hand, seeds in SEEDS.items()
        ),
        "seed_count": str(len({key[1:] for key in first})),
        "explorations": str(len(first)),
        "objects": str(len({key[0] for key in first})),
        "rows": str(len(rows)),
        "summary": summary_table(rows, _REFERENCE).markdown(),
        "by_touches": _by_touches(pairs).markdown(),
        "families": families_table(pairs, _family, unions).markdown(),
        "families_p": _families_p(pairs, families),
        "units": units_table(pairs, _family).markdown(),
        "p_objects": p_value(sign_flip_p_value(cluster_sums(gains(pairs), of_objects))),
        "p_seeds": p_value(sign_flip_p_value(cluster_sums(gains(pairs), of_seeds))),
        "held_by_object": by_object_table(pairs, "held").markdown(),
        "errors": _errors(pairs).markdown(),
        "model": _model_table(model).markdown(),
        "deviations": ", ".join(f"{name} {sd:.1f}" for name, sd in model.deviations.items()),
        "calibration": calibration.markdown(),
        "predicted_minus_observed": _predicted_minus_observed(calibration),
        "reasons": reasons_table(rows).markdown(),
        "slips": _slips(rows),
    }


def _further_tables(folder: Path) -> dict[str, str]:
    """Return the tables of both simulators and of the parts, from files of rows of their own."""
    simulators, limits, parts = (
        TrialResults(folder / f"{kind}.jsonl", kind).read(any_version=True)
        for kind in (*KINDS, "parts")
    )
    tables = {
        "simulators": [held_table(simulators), difference_table(simulators, _OURS, _REFERENCE)],
        "disagreements": [disagreements_table(simulators, limits)],
        "parts": [parts_table(parts, group) for group in GROUPS],
    }
    pages = {
        name: "\n".join(table.markdown() for table in some if table.body) or "Not measured yet.\n"
        for name, some in tables.items()
    }
    seeds = f"{len(names(parts, 'seed'))} of the ten planned seeds"
    return pages | _both_simulators(simulators) | {"parts_seeds": seeds}


def _both_simulators(rows: Sequence[Row]) -> dict[str, str]:
    """Return what the page's first paragraph says of the rows of both simulators."""
    hands = [f"`{name}`" for name in names(rows, "hand")]
    listed = [*filter(None, [", ".join(hands[:-1])]), *hands[-1:]]
    words = {"simulator_hands": " and ".join(listed)}
    for simulator in SIMULATORS:
        own = [row for row in rows if row["simulator"] == simulator]
        held = {
            name: [r["held"] for r in own if r["estimator"] == name] for name in (_OURS, _REFERENCE)
        }
        words["simulator_trials"] = str(len(held[_OURS]))
        words[f"{simulator}_held"] = "{} and {}".format(*map(sum, held.values()))
        words[f"{simulator}_effect"] = difference(
            pairs_of(own, [_OURS], _REFERENCE), over_objects=True
        )
    return words | {"disagreements_count": str(len(disagreements(rows)))}


_BUILT_IN, _SCANS, _TOOLS = "built-in", "scans", "tools and flat things"


def _family(row: Row) -> str:
    name = row["object"]
    if name in NAMES:
        return _BUILT_IN
    if name in TOOLS:
        return _TOOLS
    return next((family for family, known in EVALUATION.items() if name in known), _SCANS)


def _by_touches(pairs: Pairs) -> TextTable:
    """Return the difference at each number of touches, with each hand and with all."""
    budgets = sorted({mine["touches"] for mine, _ in pairs})
    of_hands = {name: of for (name,), of in cells(pairs, "hand").items()}
    body = []
    for name, of in (of_hands | {"all": list(pairs)}).items():
        parts = [[pair for pair in of if pair[0]["touches"] == n] for n in budgets]
        body.append((name, *(difference(part, over_objects=True) for part in (*parts, of))))
    head = ("hand", *(f"{n} touches" for n in budgets), "all")
    return TextTable("by_touches", "Difference in points", head, tuple(body))


def _families_p(pairs: Pairs, families: Sequence[str]) -> str:
    """Return the adjusted p-value of each family, objects with their seeds as units."""
    values = []
    for name in families:
        of = [pair for pair in pairs if _family(pair[0]) == name]
        clusters = clusters_of([mine for mine, _ in of])
        values.append(sign_flip_p_value(cluster_sums(gains(of), clusters)))
    adjusted = holm(values)
    return ", ".join(f"{n} {p_value(float(p))}" for n, p in zip(families, adjusted, strict=True))


def _errors(pairs: Pairs) -> TextTable:
    """Return mean surface errors by number of touches, ours / reference."""
    budgets = sorted({mine["touches"] for mine, _ in pairs})
    parts = [[pair for pair in pairs if pair[0]["touches"] == n] for n in budgets]
    measures = ("rmsd", "rmsd_truth_to_estimate", "edge_rmsd")
    body = [(MEASURE_LABELS[m], *(beside(part, m) for part in parts)) for m in measures]
    head = ("error", *(f"{n} touches" for n in budgets))
    return TextTable("errors", "Mean errors", head, tuple(body))


def _model_table(model: MixedModel) -> TextTable:
    body = [
        (ratio.name, f"{ratio.value:.2f} ({ratio.low:.2f} to {ratio.high:.2f})")
        for ratio in model.odds_ratios
    ]
    return TextTable("model", "Mixed model", ("effect", "odds ratio (95 %)"), tuple(body))


def _predicted_minus_observed(calibration: TextTable) -> str:
    """Return the difference of both rates over all hands, for each estimator [points]."""
    body = [row for row in calibration.body if row[1] == "all"] or calibration.body
    return ", ".join(f"{row[0]} {float(row[3]) - float(row[4]):+.1f}" for row in body)


def _slips(rows: Sequence[Row]) -> str:
    """Return the fraction of held trials that slipped more than 5 mm, per estimator."""
    parts = []
    for name in names(rows, "estimator"):
        slips = [row["slip"] for row in rows if row["estimator"] == name and row["held"]]
        many = sum(slip > _SMALL_SLIP for slip in slips)
        parts.append(f"{name} {many} of {len(slips)}")
    return ", ".join(parts)


def main() -> None:
    """Make the page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rows", type=Path, default=_HERE, help="folder of the rows")
    parser.add_argument("--docs", type=Path, default=_DOCS, help="where study.md goes")
    options = parser.parse_args()
    print(make_page(options.rows, options.docs))


if __name__ == "__main__":
    main()
