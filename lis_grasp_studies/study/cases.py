"""Report page of a study; scenes and pictures of its clearest win and its clearest loss."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Any

import trimesh
from matplotlib.figure import Figure

from lis_grasp.exceptions import LisGraspError
from lis_grasp.io.json_lines import Row
from lis_grasp.robots.hand import Hand
from lis_grasp.version import __version__
from lis_grasp.visualization import Scene
from lis_grasp.visualization.hand_layers import link_poses
from lis_grasp_studies.figures.palette import estimator_label
from lis_grasp_studies.figures.static_scene import draw_still
from lis_grasp_studies.figures.style import add_panel, foot_note, head_estimator, new_figure
from lis_grasp_studies.harness.page import Picture, write_page
from lis_grasp_studies.harness.runner import single_thread
from lis_grasp_studies.harness.statistics import LEAST_CLUSTERS, LEAST_SEEDS
from lis_grasp_studies.harness.tables import Table
from lis_grasp_studies.study.comparison import clearest_pairs, losses, names
from lis_grasp_studies.study.results import job_of
from lis_grasp_studies.study.run import (
    DRAKE,
    estimate,
    lift,
    plan,
    scenario_at,
    shape_at,
    touch,
)
from lis_grasp_studies.study.study import Study
from lis_grasp_studies.study.trial import OWN, label


def draw_cases(
    folder: Path, rows: Sequence[Row], reference: str, files: Sequence[str]
) -> Iterator[Picture]:
    """Draw the clearest win and the clearest loss of a study, and write a scene of each row.

    Scenes are ``cases/<key>.html`` in the study's folder. The files are paths of objects and hands.
    Rows whose files are missing, or that another version made, are left out.
    """
    for winner, loser in clearest_pairs(rows, reference):
        first, second = (_repeat(row, files) for row in (winner, loser))
        if first is None or second is None:
            continue
        for row, case in ((winner, first), (loser, second)):
            _write(folder / "cases" / f"{row['key']}.html", row, case)
        won = winner["estimator"] != reference
        best = (winner if won else loser)["estimator"]
        yield Picture.of(
            f"The clearest {'win' if won else 'loss'} of {estimator_label(best)}",
            f"{label(winner['object'])}, {winner['hand']}, {winner['touches']} touches, noise"
            f" {winner['noise']}, seed {winner['seed']}: both estimates and their contacts, the"
            " true edges as lines, and the hand at its best grasp. Interactive scenes with the"
            f" lift: cases/{winner['key']}.html and cases/{loser['key']}.html.",
            _picture([(winner, first), (loser, second)]),
        )


def _repeat(row: Row, files: Sequence[str]) -> dict[str, Any] | None:
    """Repeat a row, and return its scene by argument of `Scene`; None if that fails."""
    if row["version"] != __version__:
        return None
    try:
        trial = job_of(row, files).trial
        with single_thread(DRAKE):
            shape, hand = trial.find_object(), Hand.load(trial.hand)
            touched = touch(trial, trial.explorer(row["estimator"]))
            mesh = estimate(trial, row["estimator"], touched.contacts)
            grasps = plan(trial, mesh, shape, hand).grasps
            outcome = lift(trial, grasps[0], shape, hand, touched.X_EO) if grasps else None
    except LisGraspError:  # no surface, or no file: nothing to draw
        return None
    return {
        "truth": shape_at(shape, touched.X_EO),
        "estimate": mesh,
        "contacts": touched.contacts,
        "grasps": grasps,
        "hand": hand,
        "motion": None if outcome is None else outcome.motion,
        "support_height": scenario_at(trial.run_config(), shape, hand).agent.support_height,
    }


def _write(path: Path, row: Row, scene: dict[str, Any]) -> None:
    lines = (
        f"{estimator_label(row['estimator'])}, {row['touches']} touches, noise {row['noise']},"
        f" seed {row['seed']}",
        _result(row),
    )
    content = scene | {"truth": scene["truth"].mesh}
    Scene(**content, title=f"lis_grasp: {row['object']}", summary=lines).save(path)


def _picture(shown: Sequence[tuple[Row, dict[str, Any]]]) -> Figure:
    figure = new_figure(4.4)
    for k, (row, scene) in enumerate(shown):
        axes = add_panel(figure, 0.02 + 0.49 * k, 0.1, 0.47, 0.8)
        mesh, hand, grasps = scene["estimate"], scene["hand"], scene["grasps"]
        # One colour scale for both would hide the more certain surface: no colours.
        plain = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        poses = dict(zip(hand.links, link_poses(hand, grasps[0]), strict=True)) if grasps else None
        as_in_scene = {name: scene[name] for name in ("truth", "contacts", "hand")}
        draw_still(axes, estimate=plain, links=poses, **as_in_scene)
        head_estimator(axes, row["estimator"])
        foot_note(axes, _result(row))
    return figure


def _result(row: Row) -> str:
    if row["epsilon_truth"] is None:
        return str(row["reason"])
    return (
        f"{row['reason']}; epsilon {row['epsilon_estimate']:.3f} on the estimate,"
        f" {row['epsilon_truth']:.3f} on the truth"
    )


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
