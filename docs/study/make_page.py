"""Make docs/study.md and its figures from the rows of the published study, and nothing else.

python docs/study/make_page.py          # from docs/study/rows.parquet
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from string import Template

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.experiments.figures.palette import estimator_label
from lis_grasp.experiments.study import Study, StudyResults, compare, load_study
from lis_grasp.experiments.study.answer import answer
from lis_grasp.experiments.study.comparison import compare_held, kinds_of, names, pair_of
from lis_grasp.experiments.study.keys import label
from lis_grasp.experiments.study.study_figures import draw_pictures
from lis_grasp.experiments.study.study_tables import (
    agreements_table,
    difference_text,
    differences_table,
    foretold_table,
    held_table,
    nearer_table,
    p_phrase,
    reasons_table,
    summary_table,
)
from lis_grasp.experiments.study.study_trial import TIMES
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.json_lines import Row

_HERE = Path(__file__).parent
# The first of the seeds that were run after the planner had learnt of edges.
_LATER = 4


def make_page(study_file: Path, rows_folder: Path, docs: Path) -> Path:
    """Write study.md and its figures below `docs`; return its path."""
    study = Study.from_facts(load_study(study_file))
    rows = StudyResults(rows_folder).alike(study)
    if not rows:
        raise InvalidFileError(f"no row of {rows_folder} is of the study {study_file}")
    template = Template((_HERE / "study.md.in").read_text(encoding="utf-8"))
    words = _facts(study, rows)
    pictures = dict(zip(("figure", "noisy", "promise", "edge"), draw_pictures(rows), strict=True))
    for name, picture in pictures.items():
        file = f"images/study_{name}.png"
        (docs / "images").mkdir(parents=True, exist_ok=True)
        (docs / file).write_bytes(picture.png)
        words["figure" if name == "figure" else f"{name}_figure"] = file
        words[f"{name}_title"], words[f"{name}_caption"] = picture.title, picture.caption
    write_text(docs / "study.md", template.substitute(words))
    return docs / "study.md"


def _facts(study: Study, rows: Sequence[Row]) -> dict[str, str]:
    comparisons = compare(rows, study.reference)
    held = [held_table(rows, kind) for kind in kinds_of(rows)]
    seconds = sum(row[name] or 0.0 for row in rows for name in TIMES)
    objects = ", ".join(label(name) for name in study.objects)
    estimators = " / ".join(estimator_label(name) for name in study.estimators)
    count = len(study.trials())
    seeds = len(names(rows, "seed"))
    done = len({pair_of(row) for row in rows})
    so_far = str(done) if done == count else f"{done} of {count}"
    return {
        "summary": summary_table(rows, study.reference).markdown(),
        "answer": "\n\n".join(answer(rows, comparisons, study.reference)),
        "what": (
            f"{len(study.objects)} objects ({objects}); estimators {estimators};"
            f" {', '.join(map(str, study.touches))} touches; noise {', '.join(study.noise)};"
            f" hands {' and '.join(study.hands)}; {seeds} seed{'s' if seeds > 1 else ''}."
        ),
        "trials_text": f"{so_far} trials, {len(rows)} rows.",
        "trials": str(count),
        "grasps": str(study.setup.grasps),
        "mass": f"{study.setup.mass:g}",
        "friction": f"{study.setup.friction:g}",
        "held": "\n".join(f"{table.title}:\n\n{table.markdown()}" for table in held),
        "reference": estimator_label(study.reference),
        "differences": differences_table(rows, study.reference).markdown(),
        "mean_edges": _means(rows, (study.reference, "lis"), "edge_rmsd"),
        "mean_rmsd": _means(rows, (study.reference, "lis"), "rmsd"),
        "nearer": nearer_table(rows, study.reference, without=["lis"]).markdown(),
        "agreements": agreements_table(rows, study.reference).markdown(),
        "foretold": foretold_table(rows).markdown(),
        "by_seed": _by_seed(rows, (study.reference, "blend", "lis")),
        "later_seeds": _of_later_seeds(rows, study.reference),
        "reasons": reasons_table(rows).markdown(),
        "hours": f"{seconds / 3600.0:.1f}",
    }


def _means(rows: Sequence[Row], estimators: Sequence[str], measure: str) -> str:
    """Return the mean error [mm] of each estimator over all rows that have one."""
    of = [[r[measure] for r in rows if r["estimator"] == name] for name in estimators]
    known = [[value for value in values if value is not None] for values in of]
    return " and ".join(f"{1e3 * sum(values) / len(values):.1f}" for values in known)


def _of_later_seeds(rows: Sequence[Row], reference: str) -> str:
    """Return what `blend` came to on the seeds that were run later."""
    later = [row for row in rows if row["seed"] >= _LATER]
    (found,) = [c for c in compare_held(later, reference) if c.estimator == "blend"]
    return f"{difference_text(found)} points, p {p_phrase(found.p)}, not adjusted"


def _by_seed(rows: Sequence[Row], estimators: Sequence[str]) -> str:
    """Return what each estimator held of each seed, in percent."""
    told = []
    for name in estimators:
        of = [r for r in rows if r["estimator"] == name]
        held = [[bool(r["held"]) for r in of if r["seed"] == seed] for seed in names(of, "seed")]
        shares = ", ".join(f"{100.0 * sum(each) / len(each):.0f}" for each in held)
        told.append(f"{estimator_label(name)} held {shares} %")
    return "; ".join(told)


def main() -> None:
    """Make the page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rows", type=Path, default=_HERE, help="folder with rows.parquet")
    parser.add_argument("--docs", type=Path, default=_HERE.parent, help="where study.md goes")
    options = parser.parse_args()
    print(make_page(_HERE / "study.yaml", options.rows, options.docs))


if __name__ == "__main__":
    main()
