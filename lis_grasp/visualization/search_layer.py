"""Layer of the search: the region that contains the object, and the motions that found it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from lis_grasp.typing import FloatArray
from lis_grasp.visualization import drawing
from lis_grasp.visualization.drawing import ROOT, Canvas, Layer

if TYPE_CHECKING:
    from lis_grasp.exploration import ProbeOutcome, Region

SEARCH_COLOUR = "#7a5ea8"

# Radii of the region's edges and of the fingertip's paths [m].
_EDGE_RADIUS, _PATH_RADIUS = 0.0005, 0.001
_END_RADIUS = 0.0035


def search_of(outcomes: Sequence[ProbeOutcome]) -> tuple[ProbeOutcome, ...]:
    """Return the outcomes up to the first with a contact; all of them if there is none."""
    found = [len(outcome.contacts) > 0 for outcome in outcomes]
    return tuple(outcomes[: found.index(True) + 1 if any(found) else len(found)])


def draw_search(canvas: Canvas, region: Region, search: Sequence[ProbeOutcome]) -> None:
    """Draw the region's edges and the path of the leading fingertip in every motion."""
    edges = [_tube(a, b, _EDGE_RADIUS) for a, b in _edges(region.bounds)]
    paths = [part for outcome in search for part in _path(outcome)]
    colour = drawing.material(SEARCH_COLOUR, roughness=0.7)
    mesh = trimesh.util.concatenate([*edges, *paths])
    canvas.commands.append(drawing.draw_mesh(f"{ROOT}/search/all", mesh, colour))
    lengths = " x ".join(f"{100.0 * length:.0f}" for length in region.lengths)
    seconds = sum(outcome.duration for outcome in search)
    many = f"{len(search)} motion{'' if len(search) == 1 else 's'}"
    note = f"{many}, {seconds:.0f} s, in a region of {lengths} cm"
    canvas.layers.append(Layer("search", "Search", True, SEARCH_COLOUR, note))


def _path(outcome: ProbeOutcome) -> list[trimesh.Trimesh]:
    """Return the path of the leading tip up to its end or the contact, with a ball there."""
    probe = outcome.probe
    if outcome.status == "blocked":
        return []
    end = probe.end
    if len(outcome.contacts):
        along = float(np.min((outcome.contacts.points - probe.start) @ probe.direction))
        end = probe.start + max(along, 0.0) * probe.direction
    ball = trimesh.creation.icosphere(2, _END_RADIUS)
    ball.apply_translation(end)
    if np.allclose(probe.start, end):
        return [ball]
    return [_tube(probe.start, end, _PATH_RADIUS), ball]


def _tube(start: FloatArray, end: FloatArray, radius: float) -> trimesh.Trimesh:
    return trimesh.creation.cylinder(radius, segment=[start, end], sections=8)


def _edges(bounds: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Return the 12 edges of a box, from its lowest and highest corner (2, 3)."""
    corners = list(product((0, 1), repeat=3))
    pairs = [pair for pair in combinations(corners, 2) if np.abs(np.subtract(*pair)).sum() == 1]
    axes = np.arange(3)
    return [(bounds[list(a), axes], bounds[list(b), axes]) for a, b in pairs]
