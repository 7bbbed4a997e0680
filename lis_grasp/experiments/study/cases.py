"""The clearest pairs won and lost, as scenes of their own and as a picture in the report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import trimesh

import lis_grasp
from lis_grasp import pipeline
from lis_grasp.exceptions import LisGraspError
from lis_grasp.experiments.figures import png_of
from lis_grasp.experiments.figures.palette import estimator_label
from lis_grasp.experiments.figures.still import draw_still
from lis_grasp.experiments.figures.style import add_panel, foot_note, head_estimator, new_figure
from lis_grasp.experiments.paper.paper_page import Picture
from lis_grasp.experiments.study.case import Case, extremes, make_case
from lis_grasp.experiments.study.keys import label
from lis_grasp.experiments.study.study_results import job_of
from lis_grasp.io.json_lines import Row
from lis_grasp.visualization import Scene
from lis_grasp.visualization.hand_layers import link_poses


def draw_cases(
    folder: Path, rows: Sequence[Row], reference: str, files: Sequence[str]
) -> Iterator[Picture]:
    """Draw the clearest pair won, and the clearest lost, and write a scene of each of their rows.

    Scenes are ``cases/<key>.html`` in the folder. Rows whose files are not there, or that another
    version made, are left out.

    Parameters
    ----------
    folder
        Of the study.
    rows
        Its results.
    reference
        The estimator that the others are held against.
    files
        Paths of objects and hands.
    """
    for winner, loser in extremes(rows, reference):
        first, second = (_remade(row, files) for row in (winner, loser))
        if first is None or second is None:
            continue
        for row, case in ((winner, first), (loser, second)):
            _write(folder / "cases" / f"{row['key']}.html", row, case)
        won = winner["estimator"] != reference
        leader = (winner if won else loser)["estimator"]
        yield Picture(
            f"The clearest pair that {estimator_label(leader)} {'won' if won else 'lost'}",
            f"{label(winner['object'])}, {winner['hand']}, {winner['touches']} touches, noise"
            f" {winner['noise']}, seed {winner['seed']}: both estimates and their contacts, the"
            " true edges as lines, and the hand at its best grasp. Scenes to turn, with the lift:"
            f" cases/{winner['key']}.html and cases/{loser['key']}.html.",
            _picture([(winner, first), (loser, second)]),
        )


def _remade(row: Row, files: Sequence[str]) -> Case | None:
    if row["version"] != lis_grasp.__version__:
        return None
    try:
        return make_case(job_of(row, files))
    except LisGraspError:  # no surface, or no file: nothing to look at
        return None


def _write(path: Path, row: Row, case: Case) -> None:
    lines = (
        f"{estimator_label(row['estimator'])}, {row['touches']} touches, noise {row['noise']},"
        f" seed {row['seed']}",
        _ended(row),
    )
    scene = Scene(
        truth=case.shape.mesh,
        estimate=case.mesh,
        contacts=case.contacts,
        grasps=case.grasps,
        hand=case.hand,
        motion=case.motion,
        support_height=pipeline.support_height(case.shape),
        title=f"lis_grasp: {row['object']}",
        summary=lines,
    )
    scene.save(path)


def _picture(shown: Sequence[tuple[Row, Case]]) -> bytes:
    figure = new_figure(4.4)
    # One scale of colours for both would hide the better known surface: no colours.
    for k, (row, case) in enumerate(shown):
        axes = add_panel(figure, 0.02 + 0.49 * k, 0.1, 0.47, 0.8)
        plain = trimesh.Trimesh(case.mesh.vertices, case.mesh.faces, process=False)
        links = None
        if case.grasps:
            poses = link_poses(case.hand, case.grasps[0])
            links = dict(zip(case.hand.links, poses, strict=True))
        draw_still(
            axes,
            truth=case.shape,
            estimate=plain,
            contacts=case.contacts,
            hand=case.hand,
            links=links,
        )
        head_estimator(figure, axes, row["estimator"])
        foot_note(axes, _ended(row))
    return png_of(figure)


def _ended(row: Row) -> str:
    if row["epsilon_truth"] is None:
        return str(row["reason"])
    return (
        f"{row['reason']}; epsilon {row['epsilon_estimate']:.3f} on the estimate,"
        f" {row['epsilon_truth']:.3f} on the truth"
    )
