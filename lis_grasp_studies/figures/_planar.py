"""Figs. 1 and 2: implicit shape potentials on the plane z = 0 and their zero lines.

The estimators work in space. A planar scene is contacts with z = 0 and normals in the plane; the
field is shown at z = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces import ImplicitSurface, LocalImplicitSurface
from lis_grasp.surfaces.local_implicit_surface import Beta
from lis_grasp.typing import FloatArray
from lis_grasp.visualization.camera import View
from lis_grasp_studies.figures import palette, style
from lis_grasp_studies.figures._solids import (
    COLUMNS,
    KERNEL_WIDTH,
    contact_patches,
    estimate,
    estimated_mesh,
    solid_patches,
)
from lis_grasp_studies.figures.painter import frame_of, paint

_NODES = 301  # of the grid along its longer side

_CUBE_FRAME = np.array([[-0.085, -0.085], [0.085, 0.085]])
_CUBE_VIEW = View(np.deg2rad(-62.0), np.deg2rad(26.0))
_ARM = 0.05

# A step: ground, wall, top. The concave corner is at the origin, the convex one a wall's height up.
_WALL = 0.05
_STEP_FRAME = np.array([[-0.075, -0.035], [0.075, 0.09]])
OUTLINE = np.array([[_STEP_FRAME[0, 0], 0.0], [0.0, 0.0], [0.0, _WALL], [_STEP_FRAME[1, 0], _WALL]])
"""The true outline of the step, shape (4, 2) [m]."""

_RADIUS, _WEDGES = 0.013, 72
_PANELS: tuple[tuple[Beta, str], ...] = (
    ("none", "without: β = 1"),
    ("corrected", "1 − sgn(y) β*, corrected"),
    ("as_published", "1 + sgn(y) β*, as published"),
)


def figure_1(*, names: Sequence[str] = COLUMNS) -> Figure:
    """Draw two contacts in the plane and six of a cube, with the surface of each estimator."""
    corner = planar_contacts([[0.0, _ARM], [_ARM, 0.0]], [[0.0, 1.0], [1.0, 0.0]])
    axes3 = np.vstack([np.eye(3), -np.eye(3)])
    cube = Contacts(_ARM * axes3, axes3)
    figure = style.new_figure(6.9)
    width = 0.94 / len(names)
    solids = [
        solid_patches(_CUBE_VIEW, estimated_mesh(name, cube, resolution=0.0023), palette.SURFACE)
        for name in names
    ]
    touches = contact_patches(_CUBE_VIEW, cube, scale=0.8)
    frame = frame_of([patch for solid in solids for patch in [*solid, *touches]])
    for k, name in enumerate(names):
        left = 0.05 + k * width
        axes = style.add_panel(figure, left, 0.53, 0.95 * width, 0.42)
        draw_field(axes, estimate(name, corner), _CUBE_FRAME, largest=0.05)
        _draw_contacts(axes, corner, length=0.016)
        style.head_estimator(axes, name)
        below = style.add_panel(figure, left, 0.09, 0.95 * width, 0.42)
        paint(below, [*solids[k], *touches], frame=frame)
        if k == 0:
            _draw_scale(axes, _CUBE_FRAME, 0.05)
            style.side_note(figure, left - 0.01, 0.74, "two contacts, z = 0")
            style.side_note(figure, left - 0.01, 0.3, "cube, six contacts")
    ticks = {-0.05: "≤ −50, inside", 0.0: "0", 0.05: "≥ 50, outside"}
    _potential_bar(figure, (0.3, 0.075, 0.4, 0.014), ticks)
    return figure


def figure_2() -> Figure:
    """Draw three contacts of a step and the LIS surface without beta and with either sign."""
    contacts = step_contacts()
    figure = style.new_figure(3.45)
    width = 0.98 / len(_PANELS)
    for k, (beta, title) in enumerate(_PANELS):
        surface = LocalImplicitSurface.from_contacts(
            contacts, beta=beta, sigma=KERNEL_WIDTH * contacts.spacing
        )
        axes = style.add_panel(figure, 0.01 + k * width, 0.2, 0.97 * width, 0.7)
        draw_field(axes, surface, _STEP_FRAME, largest=0.04)
        axes.plot(*OUTLINE.T, "--", color="white", lw=2.4, dashes=(3, 2))
        axes.plot(*OUTLINE.T, "--", color=palette.INK, lw=1.0, dashes=(7.2, 4.8))
        if surface.convexity is not None:
            _draw_convexity(axes, surface)
        _draw_contacts(axes, contacts, length=0.021)
        axes.set(xlim=_STEP_FRAME[:, 0], ylim=_STEP_FRAME[:, 1])
        style.head(axes, title)
        if k == 0:
            _draw_scale(axes, _STEP_FRAME, 0.03)
    ticks = {-0.04: "−40, inside", 0.0: "0", 0.04: "40, outside"}
    _potential_bar(figure, (0.12, 0.135, 0.3, 0.026), ticks)
    ticks = {-1.0: "−1, convex", 0.0: "0", 1.0: "1, concave"}
    place = (0.58, 0.135, 0.3, 0.026)
    style.colour_bar(figure, place, palette.CONVEX_CONCAVE, "β* in circles round contacts", ticks)
    return figure


def planar_contacts(points: npt.ArrayLike, normals: npt.ArrayLike) -> Contacts:
    """Return contacts in the plane z = 0; points (N, 2) [m], normals (N, 2), unit."""
    zeros = np.zeros((len(np.asarray(points)), 1))
    return Contacts(np.hstack([points, zeros]), np.hstack([normals, zeros]))


def step_contacts() -> Contacts:
    """Return one contact on each side of a step, in the plane z = 0."""
    return planar_contacts(
        [[-0.035, 0.0], [0.0, 0.5 * _WALL], [0.035, _WALL]], [[0.0, 1.0], [-1.0, 0.0], [0.0, 1.0]]
    )


def convexity_towards(
    surface: LocalImplicitSurface, contact: int, offsets: FloatArray
) -> FloatArray:
    """Return beta* of a contact towards offsets from it (R, 3), as `evaluate` uses it, (R,)."""
    assert surface.convexity is not None
    normal = surface.normals[contact]
    projected = offsets - np.outer(offsets @ normal, normal)
    directions = projected / np.linalg.norm(projected, axis=1)[:, None]
    return surface.convexity.evaluate(contact, directions)[0]


def draw_field(
    axes: Axes, surface: ImplicitSurface, frame: FloatArray, *, largest: float
) -> QuadContourSet:
    """Draw a potential on the plane z = 0 with thin level lines; return its thick zero line.

    `frame` has the lowest and highest corner, shape (2, 2) [m]; colours end at |f| = `largest` [m].
    """
    extent = frame[1] - frame[0]
    counts = np.ceil(_NODES * extent / extent.max()).astype(int)
    x, y = (np.linspace(frame[0, k], frame[1, k], counts[k]) for k in (0, 1))
    grid = np.stack([*np.meshgrid(x, y), np.zeros((len(y), len(x)))], axis=-1)  # (L, M, 3)
    values = surface.evaluate(grid)
    axes.imshow(
        values,
        extent=(frame[0, 0], frame[1, 0], frame[0, 1], frame[1, 1]),
        origin="lower",
        cmap=palette.INSIDE_OUTSIDE,
        vmin=-largest,
        vmax=largest,
        interpolation="bilinear",
    )
    levels = np.linspace(-largest, largest, 11)
    others = levels[np.abs(levels) > 1e-9]
    axes.contour(x, y, values, others, colors=palette.INK, linewidths=0.35, alpha=0.3)
    zero = axes.contour(x, y, values, levels=[0.0], colors=palette.INK, linewidths=2.2)
    axes.set(aspect="equal", xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    return zero


def _draw_convexity(axes: Axes, surface: LocalImplicitSurface) -> None:
    """Draw a circle round each contact, coloured by beta* towards each direction."""
    edges = np.linspace(0.0, 2.0 * np.pi, _WEDGES + 1)
    rim = _RADIUS * np.column_stack([np.cos(edges), np.sin(edges)])  # (W + 1, 2)
    towards = np.column_stack([0.5 * (rim[1:] + rim[:-1]), np.zeros(_WEDGES)])
    for i, point in enumerate(surface.points[:, :2]):
        colours = palette.convexity_colours(convexity_towards(surface, i, towards))
        corners = [np.array([point, point + a, point + b]) for a, b in pairwise(rim)]
        wedges = PolyCollection(corners, facecolors=colours, edgecolors=colours, linewidths=0.6)
        wedges.set_zorder(3)
        axes.add_collection(wedges)
        axes.plot(*(point + rim).T, color=palette.INK, lw=0.9, zorder=3)


def _draw_contacts(axes: Axes, contacts: Contacts, *, length: float) -> None:
    arrow = {"arrowstyle": "-|>", "color": palette.CONTACT, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
    for point, normal in zip(contacts.points[:, :2], contacts.normals[:, :2], strict=True):
        axes.annotate("", xy=tuple(point + length * normal), xytext=tuple(point), arrowprops=arrow)
    points = contacts.points[:, :2].T
    axes.plot(*points, "o", ms=6.5, mfc=palette.CONTACT, mec="white", mew=1.0, zorder=4)


def _draw_scale(axes: Axes, frame: FloatArray, length: float) -> None:
    """Draw a bar of a length [m] in the lower left corner of a frame (2, 2) [m]."""
    x, y = frame[0] + 0.05 * (frame[1] - frame[0])
    axes.plot([x, x + length], [y, y], color=palette.INK, lw=1.6)
    middle, text = (x + 0.5 * length, y), f"{1e3 * length:.0f} mm"
    font: dict[str, Any] = {"fontsize": 8, "color": palette.INK, "ha": "center", "va": "bottom"}
    axes.annotate(text, middle, xytext=(0, 3), textcoords="offset points", **font)


def _potential_bar(
    figure: Figure, place: tuple[float, float, float, float], ticks: dict[float, str]
) -> None:
    label = "implicit shape potential f [mm]"
    style.colour_bar(figure, place, palette.INSIDE_OUTSIDE, label, ticks)
