"""Implicit shape potentials on the plane z = 0: filled fields with their zero line, figs. 1 and 2.

The estimators work in space. A scene of the plane is contacts with z = 0 and normals in the plane,
and the field is what they make of it at z = 0.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.contour import QuadContourSet

from lis_grasp.contacts import Contacts
from lis_grasp.experiments.figures.palette import CONTACT, INK, INSIDE_OUTSIDE
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import FloatArray

NODES = 301
"""Of the grid along its longer side."""

ARROW = 0.016
"""Length of a drawn normal, in metres for a picture of 160 mm."""


def planar_contacts(points: npt.ArrayLike, normals: npt.ArrayLike) -> Contacts:
    """Return contacts of a scene in the plane z = 0; points (N, 2) [m], normals (N, 2), unit."""
    zeros = np.zeros((len(np.asarray(points)), 1))
    return Contacts(np.hstack([points, zeros]), np.hstack([normals, zeros]))


def sample_plane(
    surface: ImplicitSurface, frame: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x (M,), y (L,) and f at them with z = 0, shape (L, M), over a frame (2, 2) [m]."""
    extent = frame[1] - frame[0]
    counts = np.ceil(NODES * extent / extent.max()).astype(int)
    x, y = (np.linspace(frame[0, k], frame[1, k], counts[k]) for k in (0, 1))
    grid = np.stack([*np.meshgrid(x, y), np.zeros((len(y), len(x)))], axis=-1)
    return x, y, surface.evaluate(grid)


def draw_field(
    axes: Axes, surface: ImplicitSurface, frame: FloatArray, *, largest: float
) -> QuadContourSet:
    """Draw a potential on the plane z = 0: its field, thin level lines, and the zero line thick.

    Parameters
    ----------
    axes
        Show the frame afterwards, at equal scales, without ticks.
    surface
        With a zero line in the frame.
    frame
        Lowest and highest corner, shape (2, 2) [m].
    largest
        |f| at which colours end [m].

    Returns
    -------
    QuadContourSet
        The zero line.
    """
    x, y, values = sample_plane(surface, frame)
    axes.imshow(
        values,
        extent=(frame[0, 0], frame[1, 0], frame[0, 1], frame[1, 1]),
        origin="lower",
        cmap=INSIDE_OUTSIDE,
        vmin=-largest,
        vmax=largest,
        interpolation="bilinear",
    )
    levels = np.linspace(-largest, largest, 11)
    axes.contour(
        x, y, values, levels=levels[np.abs(levels) > 1e-9], colors=INK, linewidths=0.35, alpha=0.3
    )
    zero = axes.contour(x, y, values, levels=[0.0], colors=INK, linewidths=2.2)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)
    return zero


def draw_planar_contacts(axes: Axes, contacts: Contacts, *, length: float = ARROW) -> None:
    """Draw contacts of the plane z = 0 as points with their normals, `length` long [m]."""
    for point, normal in zip(contacts.points, contacts.normals, strict=True):
        tip = point + length * normal
        axes.annotate(
            "",
            xy=(tip[0], tip[1]),
            xytext=(point[0], point[1]),
            arrowprops={
                "arrowstyle": "-|>",
                "color": CONTACT,
                "lw": 1.6,
                "shrinkA": 0,
                "shrinkB": 0,
            },
        )
    axes.plot(
        contacts.points[:, 0],
        contacts.points[:, 1],
        "o",
        ms=6.5,
        mfc=CONTACT,
        mec="white",
        mew=1.0,
        zorder=4,
    )


def draw_scale(axes: Axes, frame: FloatArray, length: float) -> None:
    """Draw a bar of some length [m] in the lower left corner of a frame (2, 2) [m]."""
    start = frame[0] + 0.05 * (frame[1] - frame[0])
    axes.plot([start[0], start[0] + length], [start[1]] * 2, color=INK, lw=1.6)
    axes.annotate(
        f"{1e3 * length:.0f} mm",
        (start[0] + 0.5 * length, start[1]),
        xytext=(0, 3),
        textcoords="offset points",
        ha="center",
        va="bottom",
        fontsize=8,
        color=INK,
    )
