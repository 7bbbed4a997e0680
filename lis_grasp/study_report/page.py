"""The report of a study as one page that opens offline: verdicts, figures, tables, losses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

import lis_grasp
from lis_grasp.json_lines import Row
from lis_grasp.paper_report.page import Picture, figure_of, scroll, write_page
from lis_grasp.study.comparison import LEAST_SEEDS, Comparison, losses
from lis_grasp.study.study import OWN, Study
from lis_grasp.study_report.tables import StudyTable, interval, p_value, printed
from lis_grasp.visualization.figures.palette import estimator_label

_TITLE = "Does a better surface give a better grasp?"
_ALPHA = 0.05


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
        "<h2>Who holds more</h2>",
        _verdicts(comparisons),
        *(figure_of(picture) for picture in pictures),
        _how(study),
    ]
    for table in tables:
        content = scroll(table.html()) if table.body else "<p>None.</p>"
        sections += [f"<h2>{escape(table.title)}</h2>", content]
        if table.name == "losses":
            sections.append(_counts(rows, study.reference))
    write_page(path, _TITLE, sections)


def _what(study: Study, rows: Sequence[Row], command: str) -> str:
    setup, trials = study.setup, study.trials()
    wanted = len(trials) * len(study.estimators)
    explorer = (
        "each estimator drives an exploration of its own"
        if setup.explorer == OWN
        else "the same for all estimators"
    )
    whole = "" if len(rows) == wanted else f" <b>Only {len(rows)} of {wanted} rows are done.</b>"
    return (
        f"<p>Made by <code>{escape(command)}</code> with lis_grasp {escape(lis_grasp.__version__)}:"
        f" {len(study.objects)} objects ({escape(', '.join(study.objects))}),"
        f" {escape(', '.join(str(n) for n in sorted(study.touches)))} touches, noise"
        f" {escape(', '.join(study.noise))}, {escape(', '.join(study.hands))},"
        f" {len(study.seeds)} seeds, {len(trials)} trials of {len(study.estimators)} estimators."
        f" Contacts are {setup.prober}, chosen by the policy {setup.policy}, {explorer}. The best"
        f" of {setup.grasps} grasps planned on each estimate is executed in Drake on the true"
        f" object ({setup.mass:g} kg, friction {setup.friction:g}): lifted, shaken, held."
        f"{whole}</p>"
    )


def _verdicts(comparisons: Sequence[Comparison]) -> str:
    """Return a sentence on each comparison of held grasps."""
    items = []
    for c in (c for c in comparisons if c.measure == "held"):
        if c.p_holm > _ALPHA:
            verdict = "no difference is shown"
        else:
            verdict = "more" if c.effect > 0 else "fewer"
        items.append(
            f"<li>{escape(estimator_label(c.estimator))} held {printed('held', c.mean)} % of"
            f" {c.kind} objects, {escape(estimator_label(c.reference))}"
            f" {printed('held', c.mean_reference)} %, noise {escape(c.noise)}:"
            f" <b>{verdict}</b> ({printed('held', c.effect, signed=True)} points"
            f"{f', {interval(c)}' if c.low is not None else ''};"
            f" {c.wins} pairs won, {c.losses} lost of {c.pairs}; adjusted p"
            f" {p_value(c.p_holm)})</li>"
        )
    return f"<ul>{''.join(items)}</ul>" if items else "<p>Nothing to compare yet.</p>"


def _how(study: Study) -> str:
    return (
        "<h2>How it is compared</h2><p>Pairs are trials of the same object, hand, touches, noise"
        " and seed. Failures count: no surface or no grasp is not held, and has an epsilon of 0 on"
        " the truth. Held or not: McNemar's exact test, and the risk difference. The rest:"
        " Wilcoxon's signed ranks, exact with ties and two-sided, and the matched rank-biserial"
        " correlation (+1: better in every pair). Intervals are paired bootstrap intervals that"
        f" draw the {len(study.seeds)} seeds anew, told for {LEAST_SEEDS} seeds and more: they are"
        " about these objects, not about all there are. All p-values of the table are one family,"
        " adjusted by Holm's method. Trials of one object and seed share their first touches, which"
        " these tests do not know: “p by object and seed” is an exact sign test in which all pairs"
        " of one object and seed flip together. Differences are the estimator's mean less the"
        f" {escape(estimator_label(study.reference))} mean; of errors and gaps less is better."
        " Surface errors are taken within a quarter of the object's size of a contact.</p>"
    )


def _counts(rows: Sequence[Row], reference: str) -> str:
    found = losses(rows, reference)
    counts: dict[str, int] = {}
    for mine, _ in found:
        counts[mine["estimator"]] = counts.get(mine["estimator"], 0) + 1
    told = ", ".join(f"{escape(estimator_label(n))} {c}" for n, c in counts.items())
    again = "Any of them runs again alone with <code>lis-grasp compare --rerun KEY</code>."
    return f"<p>{told}. {again}</p>" if found else ""
