"""Figs. 8 and 11: error lines while an object is explored, and on all fully explored objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.experiments.figures.error_lines import (
    draw_errors,
    error_bar,
    error_lines,
    rmsd_note,
)
from lis_grasp.experiments.figures.experiment import (
    COLUMNS,
    estimated_mesh,
    explored_object,
    view_of,
    view_on,
)
from lis_grasp.experiments.figures.painter import View
from lis_grasp.experiments.figures.style import (
    add_panel,
    foot_note,
    head_estimator,
    new_figure,
    side_note,
)
from lis_grasp.shapes import Shape

_TOP, _BOTTOM = 0.35, 0.62  # heights [in] above and below all rows


@dataclass(frozen=True, slots=True)
class _Case:
    """What a group of panels, one for each estimator, shows."""

    title: str
    shape: Shape
    contacts: Contacts
    view: View


def figure_8(
    *, name: str = "half_cylinder", names: Sequence[str] = COLUMNS, seed: int = 0
) -> Figure:
    """Draw estimates of one object after 5 contacts, half explored and fully explored.

    Parameters
    ----------
    name
        Of the object.
    names
        Of the estimators, one a column.
    seed
        Of the walk that made the contacts.
    """
    explored = explored_object(name, seed)
    walk, shape = explored.walk, explored.shape
    half = walk.until(0.5)
    view = view_on(half)
    cases = [
        _Case("5 contacts", shape, walk.first(5), view),
        _Case(f"half explored, {len(half)} contacts", shape, half, view),
        _Case(f"fully explored, {len(walk.contacts)} contacts", shape, walk.contacts, view),
    ]
    return _draw_cases(cases, names, height=2.95, groups=1)


def figure_11(
    *, objects: Sequence[str] | None = None, names: Sequence[str] = COLUMNS, seed: int = 0
) -> Figure:
    """Draw estimates of fully explored objects.

    Parameters
    ----------
    objects
        Names, one a row; None takes every built-in object that has edges.
    names
        Of the estimators, one a column.
    seed
        Of the walks that made the contacts.
    """
    if objects is None:
        objects = [name for name in shapes.NAMES if len(shapes.build(name).edges)]
    cases = []
    for name in objects:
        explored = explored_object(name, seed)
        title, contacts = name.replace("_", " "), explored.walk.contacts
        cases.append(_Case(title, explored.shape, contacts, view_of(name)))
    return _draw_cases(cases, names, height=2.3, groups=2)


def _draw_cases(
    cases: Sequence[_Case], names: Sequence[str], *, height: float, groups: int
) -> Figure:
    """Draw each case by each estimator, `groups` cases beside each other, rows `height` [in]."""
    rows = -(-len(cases) // groups)
    total = _TOP + _BOTTOM + height * rows
    figure = new_figure(total)
    for k, case in enumerate(cases):
        row, group = divmod(k, groups)
        left, width = (group + 0.05) / groups, 0.95 / groups / len(names)
        bottom = (total - _TOP - (row + 1) * height) / total
        panels = [
            add_panel(
                figure,
                left + column * width,
                bottom + 0.22 / total,
                0.97 * width,
                (height - 0.26) / total,
            )
            for column in range(len(names))
        ]
        _draw_case(panels, case, names)
        side_note(figure, left, bottom + 0.5 * height / total, case.title)
        if row == 0:
            for axes, name in zip(panels, names, strict=True):
                head_estimator(figure, axes, name)
    error_bar(figure, 0.4 / total, 0.1 / total)
    return figure


def _draw_case(panels: Sequence[Axes], case: _Case, names: Sequence[str]) -> None:
    meshes = [estimated_mesh(name, case.contacts) for name in names]
    vertices = np.concatenate([case.shape.mesh.vertices, *(mesh.vertices for mesh in meshes)])
    places = case.view.project(vertices)[0]
    frame = np.array([places.min(axis=0), places.max(axis=0)])
    for axes, mesh in zip(panels, meshes, strict=True):
        lines = error_lines(mesh, case.shape, case.contacts)
        draw_errors(axes, case.view, mesh, case.shape, case.contacts, lines, frame=frame)
        foot_note(axes, rmsd_note(lines))
