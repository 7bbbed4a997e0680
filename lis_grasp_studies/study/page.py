"""Report of a study as one page that opens offline: summary, figures, tables, losses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from lis_grasp.io.json_lines import Row
from lis_grasp.version import __version__
from lis_grasp_studies.figures.palette import estimator_label
from lis_grasp_studies.harness.page import Picture, write_page
from lis_grasp_studies.harness.statistics import LEAST_CLUSTERS, LEAST_SEEDS
from lis_grasp_studies.harness.tables import Table
from lis_grasp_studies.study.comparison import losses, names
from lis_grasp_studies.study.study import Study
from lis_grasp_studies.study.trial import OWN, label

_TITLE = "Does a better surface give a better grasp?"


def write_report(
    path: Path,
    study: Study,
    rows: Sequence[Row],
    tables: Sequence[Table],
    pictures: Iterable[Picture],
    *,
    command: str,
) -> None:
    """Write one HTML file with a study's report and its rows.

    The first table is the summary; `command` makes the report again.
    """
    summary, *others = tables
    write_page(
        path,
        _TITLE,
        [
            f"<h1>{_TITLE}</h1>",
            _settings(study, rows, command),
            summary.section(),
            *(picture.html() for picture in pictures),
            _method(study),
            *(table.section() for table in others),
            _counts(rows, study.reference, command),
        ],
    )


def _settings(study: Study, rows: Sequence[Row], command: str) -> str:
    trials = study.trials()
    wanted = len(trials) * len(study.estimators)
    explorer = (
        "each estimator drives an exploration of its own"
        if study.explorer == OWN
        else "the same for all estimators"
    )
    objects, hands = (", ".join(label(n) for n in of) for of in (study.objects, study.hands))
    versions = ", ".join(names(rows, "version")) if rows else __version__
    whole = "" if len(rows) == wanted else f" <b>Only {len(rows)} of {wanted} rows are done.</b>"
    return (
        f"<p>Made by <code>{escape(command)}</code> with lis_grasp {escape(versions)}:"
        f" {len(study.objects)} objects ({escape(objects)}),"
        f" {escape(', '.join(str(n) for n in sorted(study.touches)))} touches, noise"
        f" {escape(', '.join(study.noise))}, {escape(hands)},"
        f" {len(study.seeds)} seeds, {len(trials)} trials of {len(study.estimators)} estimators."
        f" Contacts are {study.prober}, chosen by the policy {study.policy}, {explorer}. The best"
        f" of {study.grasps} grasps planned on each estimate is executed in Drake on the true"
        f" object ({study.mass:g} kg, friction {study.friction:g}): lifted, shaken, held."
        f"{whole}</p>"
    )


def _method(study: Study) -> str:
    reference = escape(estimator_label(study.reference))
    return (
        "<h2>Method</h2><p>Pairs are trials of the same object, hand, touches, noise and seed."
        " A trial without a surface or a grasp is not held, and has an epsilon of 0 on the truth."
        " Trials of one object and seed share their first touches: they are one cluster."
        " 95 % intervals are for other seeds on these objects: Student's over whole seeds from"
        f" {LEAST_SEEDS} seeds of a hand on, else a bootstrap over clusters from {LEAST_CLUSTERS}"
        " clusters on, or Wilson's where all trials ended the same. Tests are exact and two-sided:"
        " McNemar's for held, Wilcoxon's signed ranks for the rest; all pairs of a cluster flip"
        " together (in “objects” and “seeds”, all pairs of one). “p, Holm” is adjusted over all"
        " estimators and noises of one measure and kind of objects. Differences are minus the"
        f" {reference} mean, over the pairs that both have. The rank-biserial correlation is +1"
        " where the estimator is better in every pair. Surface errors are taken within a quarter of"
        " the object's size of a contact. Edges of built-in shapes are known; in mesh files an edge"
        " is where faces meet at more than 30 degrees, which includes noise of a scan.</p>"
    )


def _counts(rows: Sequence[Row], reference: str, command: str) -> str:
    counts = Counter(mine["estimator"] for mine, _ in losses(rows, reference))
    text = ", ".join(f"{escape(estimator_label(name))} {count}" for name, count in counts.items())
    again = f"Repeat one of them with <code>{escape(command)} --rerun KEY</code>."
    return f"<p>{text}. {again}</p>" if counts else ""
