"""Fig. 5: local convexity at every contact, as discs coloured by direction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from lis_grasp.experiments.figures.experiment import KERNEL_WIDTH, explored_object, view_of
from lis_grasp.experiments.figures.painter import (
    Patches,
    View,
    line_patches,
    paint,
    point_patches,
    triangle_patches,
)
from lis_grasp.experiments.figures.palette import CONVEX_CONCAVE, INK, convexity_colours
from lis_grasp.experiments.figures.solids import LIFT, solid_patches
from lis_grasp.experiments.figures.style import add_panel, colour_bar, foot_note, new_figure
from lis_grasp.surfaces import LocalImplicitSurface
from lis_grasp.typing import FloatArray

_WEDGES = 48
_RADIUS = 0.013
_ABOVE = 0.001  # height of a disc above the surface [m]


def figure_5(*, names: Sequence[str] = ("mallet", "hollow_cylinder"), seed: int = 0) -> Figure:
    """Draw fully explored objects with the local convexity that LIS estimates at each contact.

    `seed` is that of the walks that made the contacts.
    """
    figure = new_figure(4.9)
    width = 1.0 / len(names)
    for k, name in enumerate(names):
        (shape, walk), view = explored_object(name, seed), view_of(name)
        surface = LocalImplicitSurface.from_contacts(
            walk.contacts, sigma=KERNEL_WIDTH * walk.contacts.spacing
        )
        axes = add_panel(figure, (k + 0.03) * width, 0.17, 0.94 * width, 0.81)
        paint(axes, [*solid_patches(view, shape.mesh), *_disc_patches(view, surface)])
        foot_note(axes, f"{name.replace('_', ' ')}, {len(surface.points)} contacts")
    colour_bar(
        figure,
        (0.34, 0.085, 0.32, 0.018),
        CONVEX_CONCAVE,
        "β* towards each direction in the contact’s plane",
        {-1.0: "−1, convex", 0.0: "0, flat", 1.0: "1, concave"},
    )
    return figure


def _disc_patches(view: View, surface: LocalImplicitSurface) -> list[Patches]:
    """Return the disc of every contact that faces the eye, its rim and its middle."""
    assert surface.convexity is not None
    angles = np.linspace(0.0, 2.0 * np.pi, _WEDGES + 1)
    middles = 0.5 * (angles[1:] + angles[:-1])
    patches: list[Patches] = []
    for i in np.flatnonzero(view.faces(surface.normals)):
        normal, center = surface.normals[i], surface.points[i] + _ABOVE * surface.normals[i]
        plane = tangent_axes(normal)
        rim = center + _RADIUS * around(angles, plane)  # (W + 1, 3)
        beta, _ = surface.convexity.evaluate(int(i), around(middles, plane))
        wedges = np.stack([np.broadcast_to(center, rim[1:].shape), rim[:-1], rim[1:]], axis=1)
        facing = np.broadcast_to(view.axes[2], wedges[:, 0].shape)  # full light: colours are data
        # All parts at the depth of the disc's nearest point: drawn in this order.
        depth = float(view.project(rim)[1].max()) + LIFT
        parts = [
            triangle_patches(view, wedges, facing, convexity_colours(beta)),
            line_patches(view, np.stack([rim[:-1], rim[1:]], axis=1), INK, width=0.0008),
            point_patches(view, center[None], INK, radius=0.0014),
        ]
        patches += [replace(part, depths=np.full(len(part.depths), depth)) for part in parts]
    return patches


def tangent_axes(normal: FloatArray) -> FloatArray:
    """Return two unit vectors, rows of (2, 3), that are a right-handed frame with a unit normal."""
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)])


def around(angles: FloatArray, plane: FloatArray) -> FloatArray:
    """Return unit vectors (R, 3) at angles (R,) [rad] in a plane given by two axes (2, 3)."""
    return np.column_stack([np.cos(angles), np.sin(angles)]) @ plane
