"""Fig. 2: what local convexity does at corners, with both signs of eq. 10."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from lis_grasp.contacts import Contacts
from lis_grasp.experiments.figures.palette import (
    CONVEX_CONCAVE,
    INK,
    INSIDE_OUTSIDE,
    convexity_colours,
)
from lis_grasp.experiments.figures.potential_fields import (
    draw_field,
    draw_planar_contacts,
    draw_scale,
    planar_contacts,
)
from lis_grasp.experiments.figures.style import add_panel, colour_bar, head, new_figure
from lis_grasp.surfaces import LocalImplicitSurface
from lis_grasp.surfaces.local_implicit_surface import Beta
from lis_grasp.typing import FloatArray

# A step: ground, wall, top. The concave corner is at the origin, the convex one a wall's height up.
_WALL = 0.05
_FRAME = np.array([[-0.075, -0.035], [0.075, 0.09]])
OUTLINE = np.array([[_FRAME[0, 0], 0.0], [0.0, 0.0], [0.0, _WALL], [_FRAME[1, 0], _WALL]])
"""The true outline, shape (4, 2) [m]."""

_LARGEST = 0.04
_RADIUS = 0.013
_WEDGES = 72

_PANELS: tuple[tuple[Beta, str], ...] = (
    ("none", "without: β = 1"),
    ("corrected", "1 − sgn(y) β*, mended"),
    ("as_published", "1 + sgn(y) β*, as printed"),
)


def step_contacts() -> Contacts:
    """Return one contact on each side of a step, in the plane z = 0."""
    return planar_contacts(
        [[-0.035, 0.0], [0.0, 0.5 * _WALL], [0.035, _WALL]], [[0.0, 1.0], [-1.0, 0.0], [0.0, 1.0]]
    )


def figure_2(*, sigma: float = 0.3) -> Figure:
    """Draw three contacts of a step and the surface by LIS: without beta, and with either sign.

    Parameters
    ----------
    sigma
        Width of the kernel, in units of the contacts' spacing.
    """
    contacts = step_contacts()
    figure = new_figure(3.45)
    width = 0.98 / len(_PANELS)
    for k, (beta, title) in enumerate(_PANELS):
        surface = LocalImplicitSurface.from_contacts(
            contacts, beta=beta, sigma=sigma * contacts.spacing
        )
        axes = add_panel(figure, 0.01 + k * width, 0.2, 0.97 * width, 0.7)
        draw_field(axes, surface, _FRAME, largest=_LARGEST)
        axes.plot(*OUTLINE.T, "--", color="white", lw=2.4, dashes=(3, 2))
        axes.plot(*OUTLINE.T, "--", color=INK, lw=1.0, dashes=(7.2, 4.8))
        if surface.convexity is not None:
            draw_convexity(axes, surface)
        draw_planar_contacts(axes, contacts, length=0.021)
        axes.set_xlim(*_FRAME[:, 0])
        axes.set_ylim(*_FRAME[:, 1])
        head(axes, title)
        if k == 0:
            draw_scale(axes, _FRAME, 0.03)
    _bars(figure)
    return figure


def draw_convexity(axes: Axes, surface: LocalImplicitSurface) -> None:
    """Draw round each contact of the plane z = 0 a circle of beta* towards each direction."""
    assert surface.convexity is not None
    edges = np.linspace(0.0, 2.0 * np.pi, _WEDGES + 1)
    rim = _RADIUS * np.column_stack([np.cos(edges), np.sin(edges)])  # (W + 1, 2)
    towards = np.column_stack([0.5 * (rim[1:] + rim[:-1]), np.zeros(_WEDGES)])
    for i, point in enumerate(surface.points):
        colours = convexity_colours(convexity_towards(surface, i, towards))
        corners = [np.array([point[:2], point[:2] + a, point[:2] + b]) for a, b in pairwise(rim)]
        axes.add_collection(
            PolyCollection(
                corners, facecolors=colours, edgecolors=colours, linewidths=0.6, zorder=3
            )
        )
        axes.plot(*(point[:2] + rim).T, color=INK, lw=0.9, zorder=3)


def convexity_towards(
    surface: LocalImplicitSurface, contact: int, offsets: FloatArray
) -> FloatArray:
    """Return beta* of a contact towards offsets from it (R, 3), as `evaluate` uses it, (R,)."""
    assert surface.convexity is not None
    normal = surface.normals[contact]
    projected = offsets - np.outer(offsets @ normal, normal)
    directions = projected / np.linalg.norm(projected, axis=1)[:, None]
    return surface.convexity.evaluate(contact, directions)[0]


def _bars(figure: Figure) -> None:
    colour_bar(
        figure,
        (0.12, 0.135, 0.3, 0.026),
        INSIDE_OUTSIDE,
        (-_LARGEST, _LARGEST),
        "implicit shape potential f [mm]",
        ticks=(-_LARGEST, 0.0, _LARGEST),
        tick_labels=(f"−{1e3 * _LARGEST:.0f}, inside", "0", f"{1e3 * _LARGEST:.0f}, outside"),
    )
    colour_bar(
        figure,
        (0.58, 0.135, 0.3, 0.026),
        CONVEX_CONCAVE,
        (-1.0, 1.0),
        "β* in circles round contacts",
        ticks=(-1.0, 0.0, 1.0),
        tick_labels=("−1, convex", "0", "1, concave"),
    )
