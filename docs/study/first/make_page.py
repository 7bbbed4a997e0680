"""Make docs/first-study.md and its figures from the rows of the published study, and nothing else.

python docs/study/first/make_page.py          # from docs/study/first/rows.parquet
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from string import Template

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.json_lines import Row
from lis_grasp_studies.figures.palette import estimator_label
from lis_grasp_studies.report_page import TextTable
from lis_grasp_studies.study import Study, StudyResults, load_study
from lis_grasp_studies.study.comparison import compare_held, kind_of, names, pairs_of
from lis_grasp_studies.study.paired_tables import (
    Pairs,
    beside,
    by_object_table,
    cells,
    difference,
    families_table,
    means,
    object_losses_table,
    units_table,
)
from lis_grasp_studies.study.study_figures import draw_pictures
from lis_grasp_studies.study.study_tables import (
    MEASURE_LABELS,
    calibration_table,
    difference_text,
    differences_table,
    held_table,
    nearer_table,
    p_phrase,
    reasons_table,
    summary_table,
)
from lis_grasp_studies.study.study_trial import TIMES
from lis_grasp_studies.study.trial import label

_HERE = Path(__file__).parent
_DOCS = _HERE.parent.parent
_OURS = "blend"
# The first of the seeds that were run after the planner had changed.
_LATER = 4

_CUBOIDS = ("box", "004_sugar_box", "010_potted_meat_can", "061_foam_brick", "077_rubiks_cube")
_CYLINDERS = ("cylinder", "half_cylinder", "005_tomato_soup_can")
_SIMPLE = (*_CUBOIDS, *_CYLINDERS, "pentagon")


def make_page(study_file: Path, rows_folder: Path, docs: Path) -> Path:
    """Write first-study.md and its figures below `docs`; return its path."""
    study = Study.from_facts(load_study(study_file))
    rows = StudyResults(rows_folder).alike(study)
    if not rows:
        raise InvalidFileError(
            f"no row of {rows_folder} is of the study {study_file}", path=rows_folder
        )
    template = Template((_HERE / "first-study.md.in").read_text(encoding="utf-8"))
    words = _facts(study, rows)
    pictures = dict(zip(("figure", "noisy", "epsilon", "edge"), draw_pictures(rows), strict=True))
    for name, picture in pictures.items():
        file = f"images/first_study_{name}.png"
        (docs / "images").mkdir(parents=True, exist_ok=True)
        (docs / file).write_bytes(picture.png)
        words[f"{name}_picture"] = (
            f"![{picture.title}]({file})\n\n*{picture.title}. {picture.caption}*"
        )
    write_text(docs / "first-study.md", template.substitute(words))
    return docs / "first-study.md"


def _facts(study: Study, rows: Sequence[Row]) -> dict[str, str]:
    reference = study.reference
    pairs = pairs_of(rows, [_OURS], reference)
    (found,) = [c for c in compare_held(rows, reference) if c.estimator == _OURS]
    simple = [pair for pair in pairs if _stem(pair[0]) in _SIMPLE]
    others = [pair for pair in pairs if _stem(pair[0]) not in _SIMPLE]
    unions = {
        "prisms and cylinders together": {_family(mine) for mine, _ in simple},
        "all others together": {_family(mine) for mine, _ in others},
    }
    trials, seeds = len(study.trials()), len(names(rows, "seed"))
    done = len({(r["object"], r["hand"], r["touches"], r["noise"], r["seed"]) for r in rows})
    seconds = sum(row.get(name) or 0.0 for row in rows for name in TIMES)
    later = [row for row in rows if row["seed"] >= _LATER]
    (of_later,) = [c for c in compare_held(later, reference) if c.estimator == _OURS]
    return {
        "reference": estimator_label(reference),
        "held_ours": f"{100.0 * found.mean:.0f}",
        "held_reference": f"{100.0 * found.mean_reference:.0f}",
        "effect": difference_text(found),
        "simple": difference(simple),
        "others": difference(others),
        "objects": ", ".join(label(name) for name in study.objects),
        "object_count": str(len(study.objects)),
        "estimators": ", ".join(estimator_label(name) for name in study.estimators),
        "touches": ", ".join(map(str, study.touches)),
        "noise": " and ".join(study.noise),
        "hands": " and ".join(study.hands),
        "seeds": str(seeds),
        "done": str(done) if done == trials else f"{done} of {trials}",
        "rows": str(len(rows)),
        "trials": str(trials),
        "grasps": str(study.grasps),
        "mass": f"{study.mass:g}",
        "friction": f"{study.friction:g}",
        "hours": f"{seconds / 3600.0:.1f}",
        "summary": summary_table(rows, reference).markdown(),
        "held": held_table(rows, "all").markdown(),
        "differences": differences_table(rows, reference).markdown(),
        "families": families_table(pairs, _family, unions).markdown(),
        "units": units_table(pairs, _family).markdown(),
        "losses": object_losses_table(pairs).markdown(),
        "held_by_object": by_object_table(pairs, "held").markdown(),
        "groups": _groups(pairs).markdown(),
        **{
            f"{measure}_by_object": by_object_table(pairs, measure).markdown()
            for measure in ("rmsd", "rmsd_truth_to_estimate", "edge_rmsd")
        },
        "bottle": _ratios(pairs, "006_mustard_bottle"),
        "nearer": nearer_table(rows, reference).markdown(),
        "calibration": calibration_table(rows).markdown(),
        "reasons": reasons_table(rows).markdown(),
        "by_seed": _by_seed(rows, (reference, _OURS)),
        "later_seeds": f"{difference_text(of_later)} points, p {p_phrase(of_later.p)}",
    }


def _stem(row: Row) -> str:
    return Path(row["object"]).stem


def _family(row: Row) -> str:
    if _stem(row) in _CUBOIDS:
        return "cuboids"
    return "cylinders" if _stem(row) in _CYLINDERS else _stem(row)


def _groups(pairs: Pairs) -> TextTable:
    """Return mean surface errors of scans and of built-in shapes, ours / reference."""
    budgets = sorted({mine["touches"] for mine, _ in pairs})
    body = []
    for measure in ("rmsd", "rmsd_truth_to_estimate", "edge_rmsd"):
        for title, scans in (("built-in shapes", False), ("scans", True)):
            for noise in dict.fromkeys(mine["noise"] for mine, _ in pairs):
                of = [
                    pair
                    for pair in pairs
                    if pair[0]["noise"] == noise and (kind_of(pair[0]) == "files") == scans
                ]
                parts = [[pair for pair in of if pair[0]["touches"] == n] for n in budgets]
                texts = [beside(part, measure) for part in parts]
                body.append((MEASURE_LABELS[measure], title, noise, *texts))
    head = ("error", "objects", "noise", *(f"{n} touches" for n in budgets))
    return TextTable("groups", "Mean errors", head, tuple(body))


def _ratios(pairs: Pairs, stem: str) -> str:
    """Return the range of the ratio of an object's estimate-to-truth errors, ours to reference."""
    of = [pair for pair in pairs if _stem(pair[0]) == stem]
    found = [means(part, "rmsd") for part in cells(of, "touches").values()]
    ratios = [mean[0] / mean[1] for mean in found if mean is not None]
    return f"{min(ratios):.1f} to {max(ratios):.1f}" if ratios else "–"


def _by_seed(rows: Sequence[Row], estimators: Sequence[str]) -> str:
    """Return the success rate of each estimator with each seed, in percent."""
    parts = []
    for name in estimators:
        of = [r for r in rows if r["estimator"] == name]
        held = [[bool(r["held"]) for r in of if r["seed"] == seed] for seed in names(of, "seed")]
        rates = ", ".join(f"{100.0 * sum(each) / len(each):.0f}" for each in held)
        parts.append(f"{estimator_label(name)} {rates} %")
    return "; ".join(parts)


def main() -> None:
    """Make the page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rows", type=Path, default=_HERE, help="folder with rows.parquet")
    parser.add_argument("--docs", type=Path, default=_DOCS, help="where first-study.md goes")
    options = parser.parse_args()
    print(make_page(_HERE / "study.yaml", options.rows, options.docs))


if __name__ == "__main__":
    main()
