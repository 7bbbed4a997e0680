"""Fig. 7: what counts as explored."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from lis_grasp.experiments.figures.experiment import explored_object, view_on
from lis_grasp.experiments.figures.painter import View, paint
from lis_grasp.experiments.figures.palette import EXPLORED, INK, UNEXPLORED
from lis_grasp.experiments.figures.solids import contact_patches, sharp_patches, two_tone_patches
from lis_grasp.experiments.figures.style import NORMAL, add_panel, foot_note, new_figure
from lis_grasp.experiments.paper.paper_trials import EXPLORED_RADIUS


def figure_7(*, name: str = "pentagon", seed: int = 0, coverage: float = 0.5) -> Figure:
    """Draw a partially explored object from two sides: yellow within 50 mm of a contact, else red.

    Parameters
    ----------
    name
        Of the object.
    seed
        Of the walk that made the contacts.
    coverage
        Share of the object's area at which the walk stops.
    """
    explored = explored_object(name, seed)
    contacts = explored.walk.until(coverage)
    figure = new_figure(4.6)
    front = view_on(contacts)
    back = View(front.azimuth + np.pi, front.elevation)
    for k, (view, side) in enumerate([(front, "front"), (back, "back")]):
        axes = add_panel(figure, 0.08 + 0.44 * k, 0.14, 0.4, 0.85)
        paint(
            axes,
            [
                two_tone_patches(
                    view,
                    explored.shape.mesh,
                    contacts,
                    EXPLORED_RADIUS,
                    (EXPLORED, UNEXPLORED),
                    piece=0.0007,
                ),
                sharp_patches(view, explored.shape.mesh),
                *contact_patches(view, contacts),
            ],
        )
        foot_note(axes, side)
    labels = ("explored: within 50 mm of a contact", "not explored")
    figure.legend(
        [Patch(color=EXPLORED), Patch(color=UNEXPLORED)],
        labels,
        loc="lower center",
        ncols=2,
        frameon=False,
        fontsize=NORMAL,
        labelcolor=INK,
    )
    return figure
