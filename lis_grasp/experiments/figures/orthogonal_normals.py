"""Fig. 1: contacts with orthogonal normals, smooth or sharp, in the plane and in space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from lis_grasp.contacts import Contacts
from lis_grasp.experiments.figures.experiment import COLUMNS, estimate, estimated_mesh
from lis_grasp.experiments.figures.painter import View, frame_of, paint
from lis_grasp.experiments.figures.palette import INSIDE_OUTSIDE, SURFACE
from lis_grasp.experiments.figures.potential_fields import (
    draw_field,
    draw_planar_contacts,
    draw_scale,
    planar_contacts,
)
from lis_grasp.experiments.figures.solids import contact_patches, solid_patches
from lis_grasp.experiments.figures.style import (
    add_panel,
    colour_bar,
    head_estimator,
    new_figure,
    side_note,
)

_FRAME = np.array([[-0.085, -0.085], [0.085, 0.085]])
_LARGEST = 0.05
_ARM = 0.05
_VIEW = View(np.deg2rad(-62.0), np.deg2rad(26.0))


def figure_1(*, names: Sequence[str] = COLUMNS) -> Figure:
    """Draw two contacts in the plane and six of a cube, with the surfaces estimated from them.

    Parameters
    ----------
    names
        Of the estimators, one a column.
    """
    corner = planar_contacts([[0.0, _ARM], [_ARM, 0.0]], [[0.0, 1.0], [1.0, 0.0]])
    axes3 = np.vstack([np.eye(3), -np.eye(3)])
    cube = Contacts(_ARM * axes3, axes3)
    figure = new_figure(6.9)
    width = 0.94 / len(names)
    solids = [
        solid_patches(_VIEW, estimated_mesh(name, cube, resolution=0.0023), SURFACE)
        for name in names
    ]
    touches = contact_patches(_VIEW, cube, scale=0.8)
    frame = frame_of([patch for solid in solids for patch in [*solid, *touches]])
    for k, name in enumerate(names):
        left = 0.05 + k * width
        axes = add_panel(figure, left, 0.53, 0.95 * width, 0.42)
        draw_field(axes, estimate(name, corner), _FRAME, largest=_LARGEST)
        draw_planar_contacts(axes, corner)
        head_estimator(figure, axes, name)
        solid = add_panel(figure, left, 0.09, 0.95 * width, 0.42)
        paint(solid, [*solids[k], *touches], frame=frame)
        if k == 0:
            draw_scale(axes, _FRAME, 0.05)
            side_note(figure, left - 0.01, 0.74, "two contacts, z = 0")
            side_note(figure, left - 0.01, 0.3, "cube, six contacts")
    colour_bar(
        figure,
        (0.3, 0.065, 0.4, 0.014),
        INSIDE_OUTSIDE,
        (-_LARGEST, _LARGEST),
        "implicit shape potential f [mm]",
        ticks=(-_LARGEST, 0.0, _LARGEST),
        tick_labels=(f"≤ −{1e3 * _LARGEST:.0f}, inside", "0", f"≥ {1e3 * _LARGEST:.0f}, outside"),
    )
    return figure
