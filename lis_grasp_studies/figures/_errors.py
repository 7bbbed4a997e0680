"""Figs. 8 and 11: distances from the true edges to estimates, as lines coloured by length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.shapes import Shape
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.typing import FloatArray
from lis_grasp.visualization.camera import View
from lis_grasp_studies.figures import palette, style
from lis_grasp_studies.figures._solids import (
    COLUMNS,
    LIFT,
    contact_patches,
    estimated_mesh,
    two_tone_patches,
    view_of,
    view_on,
)
from lis_grasp_studies.figures.painter import (
    cut_segments,
    line_patches,
    overlay_lines,
    paint,
)
from lis_grasp_studies.paper.trials import EXPLORED_RADIUS, explored

_TOP, _BOTTOM = 0.35, 0.62  # heights [in] above and below all rows
_LARGEST = 0.015  # error at which colours end [m]
_PIECE = 0.0025  # longest piece of an edge that gets a line of its own [m]
_EDGE_WIDTH, _LINE_WIDTH = 0.0017, 0.0009
_BEHIND = 0.3  # opacity of what the estimate hides


@dataclass(frozen=True, slots=True)
class _Case:
    """An object and its contacts, shown in one panel for each estimator."""

    title: str
    shape: Shape
    contacts: Contacts
    view: View


@dataclass(frozen=True, slots=True, eq=False)
class ErrorLines:
    """Short pieces of the explored true edges, and their distances from the estimate."""

    pieces: FloatArray  # (S, 2, 3) [m]
    lines: FloatArray  # (S, 2, 3) [m], from the pieces' middles to the nearest points

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

    @property
    def note(self) -> str:
        """The root mean square deviation as text."""
        if self.rmsd is None:
            return "no edge explored"
        millimetres = 1e3 * self.rmsd
        return f"{millimetres:.1f} mm" if millimetres >= 0.95 else f"{millimetres:.2f} mm"


def figure_8(*, names: Sequence[str] = COLUMNS) -> Figure:
    """Draw estimates of one object after 5 contacts, half explored and fully explored."""
    shape, walk = explored("half_cylinder", 0)
    half = walk.until(0.5)
    view = view_on(half)
    cases = [
        _Case("5 contacts", shape, walk.first(5), view),
        _Case(f"half explored, {len(half)} contacts", shape, half, view),
        _Case(f"fully explored, {len(walk.contacts)} contacts", shape, walk.contacts, view),
    ]
    return _draw_cases(cases, names, height=2.95, groups=1)


def figure_11(*, objects: Sequence[str] = shapes.NAMES, names: Sequence[str] = COLUMNS) -> Figure:
    """Draw estimates of the fully explored objects that have edges."""
    cases = []
    for name in objects:
        shape, walk = explored(name, 0)
        if len(shape.edges):
            cases.append(_Case(name.replace("_", " "), shape, walk.contacts, view_of(name)))
    return _draw_cases(cases, names, height=2.3, groups=2)


def error_lines(
    estimate: trimesh.Trimesh, shape: Shape, contacts: Contacts, *, radius: float = EXPLORED_RADIUS
) -> ErrorLines:
    """Return lines from the explored true edges of a shape to the nearest points of an estimate.

    A piece of an edge is explored if its middle is within `radius` [m] of a contact.
    """
    pieces, _ = cut_segments(shape.edges, _PIECE)
    middles = pieces.mean(axis=1)
    near = cKDTree(contacts.points).query(middles)[0] <= radius
    pieces, middles = pieces[near], middles[near]
    _, faces = distances_to_mesh(middles, estimate)
    triangles = np.asarray(estimate.triangles)[faces]
    nearest = trimesh.triangles.closest_point(triangles, middles)
    return ErrorLines(pieces, np.stack([middles, nearest], axis=1))


def _draw_cases(
    cases: Sequence[_Case], names: Sequence[str], *, height: float, groups: int
) -> Figure:
    """Draw each case by each estimator, `groups` cases beside each other, rows `height` [in]."""
    rows = -(-len(cases) // groups)
    total = _TOP + _BOTTOM + height * rows
    figure = style.new_figure(total)
    for k, case in enumerate(cases):
        row, group = divmod(k, groups)
        left, width = (group + 0.05) / groups, 0.95 / groups / len(names)
        bottom = (total - _TOP - (row + 1) * height) / total
        low, high = bottom + 0.22 / total, (height - 0.26) / total
        panels = [
            style.add_panel(figure, left + column * width, low, 0.97 * width, high)
            for column in range(len(names))
        ]
        _draw_case(panels, case, names)
        style.side_note(figure, left, bottom + 0.5 * height / total, case.title)
        if row == 0:
            for axes, name in zip(panels, names, strict=True):
                style.head_estimator(axes, name)
    style.colour_bar(
        figure,
        (0.33, 0.4 / total, 0.34, 0.1 / total),
        palette.SMALL_LARGE,
        "distance from a true edge to the estimate [mm]; numbers: its root mean square",
        {0.0: "0", _LARGEST / 3.0: "5", _LARGEST / 1.5: "10", _LARGEST: "≥ 15"},
    )
    return figure


def _draw_case(panels: Sequence[Axes], case: _Case, names: Sequence[str]) -> None:
    meshes = [estimated_mesh(name, case.contacts) for name in names]
    vertices = np.concatenate([case.shape.mesh.vertices, *(mesh.vertices for mesh in meshes)])
    places = case.view.project(vertices)[0]
    frame = np.array([places.min(axis=0), places.max(axis=0)])
    for axes, mesh in zip(panels, meshes, strict=True):
        _draw_errors(axes, case, mesh, frame)


def _draw_errors(axes: Axes, case: _Case, estimate: trimesh.Trimesh, frame: FloatArray) -> None:
    """Draw an estimate, the contacts, and the true edges with their error lines by colour.

    Hidden edges and lines are drawn faintly on top; unexplored true edges are grey.
    """
    view, contacts = case.view, case.contacts
    lines = error_lines(estimate, case.shape, contacts)
    colours = palette.error_colours(lines.errors, _LARGEST)
    pieces, _ = cut_segments(case.shape.edges, _PIECE)
    far = cKDTree(contacts.points).query(pieces.mean(axis=1))[0] > EXPLORED_RADIUS
    surface = two_tone_patches(
        view, estimate, contacts, EXPLORED_RADIUS, (palette.SURFACE, palette.BEYOND)
    )
    patches = [
        surface,
        line_patches(view, pieces[far], palette.QUIET, width=0.5 * _EDGE_WIDTH, lift=LIFT),
        line_patches(view, lines.lines, colours, width=_LINE_WIDTH, lift=LIFT),
        line_patches(view, lines.pieces, colours, width=_EDGE_WIDTH, lift=LIFT),
        *contact_patches(view, contacts),
    ]
    paint(axes, patches, frame=frame)
    faded = colours * [1.0, 1.0, 1.0, _BEHIND]
    overlay_lines(axes, view, pieces[far], palette.rgba(palette.QUIET, _BEHIND)[None], points=0.6)
    overlay_lines(axes, view, lines.lines, faded, points=0.5)
    overlay_lines(axes, view, lines.pieces, faded, points=1.0)
    hidden = view.project(contacts.points[~view.faces(contacts.normals)])[0]
    axes.plot(
        hidden[:, 0], hidden[:, 1], "o", ms=2.6, mfc=palette.CONTACT, mew=0.0, alpha=0.5 * _BEHIND
    )
    style.foot_note(axes, lines.note)
