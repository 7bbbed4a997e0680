"""The report of a study as one page that opens offline: verdicts, figures, tables, losses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

import lis_grasp
from lis_grasp.experiments.figures.palette import estimator_label
from lis_grasp.experiments.paper.paper_page import Picture, figure_of, scroll, write_page
from lis_grasp.experiments.study.answer import answer
from lis_grasp.experiments.study.clusters import LEAST_CLUSTERS, LEAST_SEEDS
from lis_grasp.experiments.study.comparison import Comparison, losses, names
from lis_grasp.experiments.study.keys import label
from lis_grasp.experiments.study.study import OWN, Study
from lis_grasp.experiments.study.study_table import StudyTable
from lis_grasp.io.json_lines import Row

_TITLE = "Does a better surface give a better grasp?"


def write_report(
    path: Path,
    study: Study,
    rows: Sequence[Row],
    comparisons: Sequence[Comparison],
    tables: Iterable[StudyTable],
    pictures: Iterable[Picture],
    *,
    command: str,
) -> None:
    """Write the report.

    Parameters
    ----------
    path
        Of the HTML file.
    study
        What was compared.
    rows
        Its results.
    comparisons, tables, pictures
        What they say, in the order of the page.
    command
        That makes the report again.
    """
    sections = [
        f"<h1>{_TITLE}</h1>",
        _what(study, rows, command),
        "<h2>The answer</h2>",
        *(f"<p>{escape(text)}</p>" for text in answer(rows, comparisons, study.reference)),
        *(figure_of(picture) for picture in pictures),
        _how(study),
    ]
    for table in tables:
        content = scroll(table.html()) if table.body else "<p>None.</p>"
        sections += [f"<h2>{escape(table.title)}</h2>", content]
        if table.name == "losses":
            sections.append(_counts(rows, study.reference, command))
    write_page(path, _TITLE, sections)


def _what(study: Study, rows: Sequence[Row], command: str) -> str:
    setup, trials = study.setup, study.trials()
    wanted = len(trials) * len(study.estimators)
    explorer = (
        "each estimator drives an exploration of its own"
        if setup.explorer == OWN
        else "the same for all estimators"
    )
    objects, hands = (", ".join(label(n) for n in of) for of in (study.objects, study.hands))
    whole = "" if len(rows) == wanted else f" <b>Only {len(rows)} of {wanted} rows are done.</b>"
    return (
        f"<p>Made by <code>{escape(command)}</code> with lis_grasp {escape(_version(rows))}:"
        f" {len(study.objects)} objects ({escape(objects)}),"
        f" {escape(', '.join(str(n) for n in sorted(study.touches)))} touches, noise"
        f" {escape(', '.join(study.noise))}, {escape(hands)},"
        f" {len(study.seeds)} seeds, {len(trials)} trials of {len(study.estimators)} estimators."
        f" Contacts are {setup.prober}, chosen by the policy {setup.policy}, {explorer}. The best"
        f" of {setup.grasps} grasps planned on each estimate is executed in Drake on the true"
        f" object ({setup.mass:g} kg, friction {setup.friction:g}): lifted, shaken, held."
        f"{whole}</p>"
    )


def _version(rows: Sequence[Row]) -> str:
    return ", ".join(names(rows, "version")) if rows else lis_grasp.__version__


def _how(study: Study) -> str:
    who = escape(estimator_label(study.reference))
    return (
        "<h2>How it is compared</h2><p>Pairs are trials of the same object, hand, touches, noise"
        " and seed. Failures count: no surface or no grasp is not held, and has an epsilon of 0 on"
        " the truth. Trials of one object and seed are not independent, as they share their first"
        " touches: they are a cluster, whose signs flip together. Intervals are of 95 %. They tell"
        f" what other seeds would give on these objects: from {LEAST_SEEDS} seeds on, Student's"
        " over whole seeds, as all objects of one share its random numbers; of fewer, a bootstrap"
        f" over clusters, if there are {LEAST_CLUSTERS}; where all trials came out the same,"
        " Wilson's for as many trials as clusters. “Objects” draws and flips whole objects"
        " instead: what other objects like these would give. Tests are exact and"
        " two-sided: McNemar's for held or not, Wilcoxon's signed ranks for the rest, in which all"
        " pairs of a cluster flip together. p-values are adjusted by Holm's"
        " method over all estimators and noises of one measure and kind of objects. Differences are"
        f" the estimator's mean less the {who} mean, over the pairs that both have; of errors and"
        " gaps less is better. The rank-biserial correlation is +1 where the estimator is better in"
        " every pair. Surface errors are taken within a quarter of the object's size of a contact."
        " Edged and curved are built-in shapes, whose edges are known; in mesh files an edge is"
        " where faces meet at more than 30 degrees, which a scan's noise does too.</p>"
    )


def _counts(rows: Sequence[Row], reference: str, command: str) -> str:
    found = losses(rows, reference)
    counts: dict[str, int] = {}
    for mine, _ in found:
        counts[mine["estimator"]] = counts.get(mine["estimator"], 0) + 1
    told = ", ".join(f"{escape(estimator_label(n))} {c}" for n, c in counts.items())
    again = f"Any of them runs again alone with <code>{escape(command)} --rerun KEY</code>."
    return f"<p>{told}. {again}</p>" if found else ""
