"""Layers of an exploration: the region, the motions that found the object, and its own motion."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise, product
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from lis_grasp.exploration.probe import since_loss
from lis_grasp.geometry import apply_pose, inverse_pose
from lis_grasp.typing import FloatArray
from lis_grasp.visualization import _drawing as drawing
from lis_grasp.visualization._drawing import ROOT, Canvas, Layer

if TYPE_CHECKING:
    from lis_grasp.exploration import ProbeOutcome, Region


SEARCH_COLOUR = "#7a5ea8"

# Radii of the region's edges and of the fingertip's paths [m].
_EDGE_RADIUS, _PATH_RADIUS = 0.0005, 0.001
_END_RADIUS = 0.0035


TRACKED_COLOUR, TRUE_COLOUR = "#c2571a", "#4a4a4a"
_TRACKED_RADIUS, _TRUE_RADIUS = 0.0009, 0.0006  # [m]
# Motions below this are not drawn [m].
_LEAST = 1e-5


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


def motion_paths(
    outcomes: Sequence[ProbeOutcome], center: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the tracked and the true path of a point of the object, each (K, 3) [m].

    They are in the frame of the contacts after the last outcome, where the object's frame is at its
    final pose; so is the point, `center` (3,). Outcomes before a loss of the object are left out.
    """
    recorded = [
        o for o in since_loss(outcomes) if o.tracked is not None and o.simulated_pose is not None
    ]
    if not recorded:
        return np.empty((0, 3)), np.empty((0, 3))
    frames = np.array(
        [outcome.tracked.X_WE for outcome in recorded if outcome.tracked]
    )  # (K, 4, 4)
    poses = np.array([outcome.simulated_pose for outcome in recorded])  # (K, 4, 4)
    to_last = inverse_pose(frames[-1]) @ frames
    in_object = apply_pose(inverse_pose(poses[-1]), center)
    return apply_pose(to_last, center), apply_pose(to_last @ poses, in_object)


def draw_pose_track(canvas: Canvas, outcomes: Sequence[ProbeOutcome], center: FloatArray) -> None:
    """Draw the tracked and the true path of a point (3,) that touches moved, if they did."""
    tracked, true = motion_paths(outcomes, center)
    reach = max(
        (float(np.ptp(path, axis=0).max()) for path in (tracked, true) if len(path)), default=0.0
    )
    if reach < _LEAST:
        return
    for name, path, radius, colour in (
        ("tracked", tracked, _TRACKED_RADIUS, TRACKED_COLOUR),
        ("true", true, _TRUE_RADIUS, TRUE_COLOUR),
    ):
        mesh = _line(path, radius)
        material = drawing.material(colour, roughness=0.7)
        canvas.commands.append(drawing.draw_mesh(f"{ROOT}/motion/{name}", mesh, material))
    moved = 1e3 * float(np.linalg.norm(true - true[0], axis=1).max())
    off = 1e3 * float(np.linalg.norm(tracked - true, axis=1).max())
    note = (
        f"of the object's middle under touch, by up to {moved:.1f} mm (grey); tracked to within"
        f" {off:.1f} mm"
    )
    canvas.layers.append(Layer("motion", "Motion", True, TRACKED_COLOUR, note))


def _line(path: FloatArray, radius: float) -> trimesh.Trimesh:
    """Return a tube along a path (K, 3), with a ball at its end."""
    ball = trimesh.creation.icosphere(2, 3.0 * radius).apply_translation(path[-1])
    steps = [(a, b) for a, b in pairwise(path) if np.linalg.norm(b - a) > _LEAST]
    tubes = [trimesh.creation.cylinder(radius, segment=step, sections=8) for step in steps]
    return trimesh.util.concatenate([ball, *tubes])
