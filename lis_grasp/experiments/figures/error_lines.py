"""Lines from true edges to the nearest point of an estimate: where it misses, and by how much."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.mesh_distance import distances_to_mesh
from lis_grasp.experiments.figures.cutting import cut_segments
from lis_grasp.experiments.figures.painter import (
    View,
    line_patches,
    overlay_lines,
    paint,
)
from lis_grasp.experiments.figures.palette import (
    BEYOND,
    CONTACT,
    QUIET,
    SMALL_LARGE,
    SURFACE,
    error_colours,
    rgba,
)
from lis_grasp.experiments.figures.solids import LIFT, contact_patches, two_tone_patches
from lis_grasp.experiments.figures.style import colour_bar
from lis_grasp.experiments.paper.paper_trials import EXPLORED_RADIUS
from lis_grasp.shapes import Shape
from lis_grasp.typing import FloatArray

LARGEST = 0.015
"""Error at which colours end [m]."""

_PIECE = 0.0025
_EDGE_WIDTH, _LINE_WIDTH = 0.0017, 0.0009
_BEHIND = 0.3  # opacity of what the estimate hides


@dataclass(frozen=True, slots=True, eq=False)
class ErrorLines:
    """Short pieces of the explored true edges, and how far the estimate is from each.

    Parameters
    ----------
    pieces
        Shape (S, 2, 3) [m], of the true edges.
    lines
        Shape (S, 2, 3) [m], from the middle of each piece to the nearest point of the estimate.
    """

    pieces: FloatArray
    lines: FloatArray

    @property
    def errors(self) -> FloatArray:
        """Lengths of the lines, shape (S,) [m]."""
        return np.linalg.norm(self.lines[:, 1] - self.lines[:, 0], axis=1)

    @property
    def rmsd(self) -> float | None:
        """Root of the mean over the edges' length of the squared errors [m]; None without edges."""
        if not len(self.pieces):
            return None
        lengths = np.linalg.norm(self.pieces[:, 1] - self.pieces[:, 0], axis=1)
        return float(np.sqrt(np.average(self.errors**2, weights=lengths)))


def error_lines(
    estimate: trimesh.Trimesh,
    shape: Shape,
    contacts: Contacts,
    *,
    piece: float = _PIECE,
    radius: float = EXPLORED_RADIUS,
) -> ErrorLines:
    """Measure from the true edges, where explored, to the nearest points of an estimate.

    Parameters
    ----------
    estimate
        In O [m].
    shape
        The true object.
    contacts
        What is nearer than `radius` [m] to one of them is explored.
    piece
        Longest piece of an edge that gets a line of its own [m].
    """
    pieces, _ = cut_segments(shape.edges, piece)
    middles = pieces.mean(axis=1)
    known = cKDTree(contacts.points).query(middles)[0] <= radius
    pieces, middles = pieces[known], middles[known]
    _, faces = distances_to_mesh(middles, estimate)
    triangles = np.asarray(estimate.triangles)[faces]
    feet = trimesh.triangles.closest_point(triangles, middles)
    return ErrorLines(pieces, np.stack([middles, feet], axis=1))


def draw_errors(
    axes: Axes,
    view: View,
    estimate: trimesh.Trimesh,
    shape: Shape,
    contacts: Contacts,
    lines: ErrorLines,
    *,
    frame: FloatArray,
) -> None:
    """Draw an estimate, the contacts, and the true edges with their error lines by colour.

    Edges and lines that the estimate hides shine through; true edges that nobody explored are grey.
    """
    colours = error_colours(lines.errors, LARGEST)
    pieces, _ = cut_segments(shape.edges, _PIECE)
    far = cKDTree(contacts.points).query(pieces.mean(axis=1))[0] > EXPLORED_RADIUS
    surface = two_tone_patches(view, estimate, contacts, EXPLORED_RADIUS, (SURFACE, BEYOND))
    paint(
        axes,
        [
            surface,
            line_patches(view, pieces[far], QUIET, width=0.5 * _EDGE_WIDTH, lift=LIFT),
            line_patches(view, lines.lines, colours, width=_LINE_WIDTH, lift=LIFT),
            line_patches(view, lines.pieces, colours, width=_EDGE_WIDTH, lift=LIFT),
            *contact_patches(view, contacts),
        ],
        frame=frame,
    )
    faded = colours * [1.0, 1.0, 1.0, _BEHIND]
    overlay_lines(axes, view, pieces[far], rgba(QUIET, _BEHIND)[None], points=0.6)
    overlay_lines(axes, view, lines.lines, faded, points=0.5)
    overlay_lines(axes, view, lines.pieces, faded, points=1.0)
    hidden = view.project(contacts.points[contacts.normals @ view.axes[2] <= 0.0])[0]
    axes.plot(hidden[:, 0], hidden[:, 1], "o", ms=2.6, mfc=CONTACT, mew=0.0, alpha=0.5 * _BEHIND)


def error_bar(figure: Figure, bottom: float, height: float) -> None:
    """Draw the scale of the errors' colours, places in shares of the figure."""
    colour_bar(
        figure,
        (0.33, bottom, 0.34, height),
        SMALL_LARGE,
        (0.0, LARGEST),
        "distance from a true edge to the estimate [mm]; numbers: its root mean square",
        ticks=(0.0, LARGEST / 3.0, LARGEST / 1.5, LARGEST),
        tick_labels=("0", "5", "10", "≥ 15"),
    )


def rmsd_note(lines: ErrorLines) -> str:
    """Return the root mean square deviation at edges as a short text."""
    if lines.rmsd is None:
        return "no edge explored"
    millimetres = 1e3 * lines.rmsd
    return f"{millimetres:.1f} mm" if millimetres >= 0.95 else f"{millimetres:.2f} mm"
