"""Layers of a view: what was seen, guessed and is unknown, and the depth image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import counted
from lis_grasp.geometry import make_pose
from lis_grasp.records import Record, short_repr
from lis_grasp.typing import FloatArray
from lis_grasp.views import DepthView
from lis_grasp.visualization import _drawing as drawing
from lis_grasp.visualization._drawing import OBJECT_NODE, Canvas, Layer
from lis_grasp.visualization.colours import srgb, viridis
from lis_grasp.visualization.raster import encode_png

SEEN_COLOUR, GUESSED_COLOUR, UNKNOWN_COLOUR = "#1f9d55", "#c49a00", "#5c5c66"

# Radius of a speck, and the distance from all that is known of surface that is unknown, in sizes.
_SPECK, _UNKNOWN = 0.008, 0.12
_MOST_UNKNOWN = 400
# Pixels about the object on its image.
_MARGIN = 40


@dataclass(frozen=True, slots=True, eq=False)
class SeenSurface(Record):
    """What a camera saw of an object, and what follows from it."""

    view: DepthView  #: with the object's pixels
    seen: Contacts  #: in O
    guesses: Contacts  #: in O

    __repr__ = short_repr


def draw_seen(
    canvas: Canvas,
    surface: SeenSurface,
    contacts: Contacts,
    estimate: trimesh.Trimesh | None,
    size: float,
) -> None:
    """Draw seen and guessed contacts, and parts of the estimate that are neither near these.

    `contacts` were touched; specks are scaled for an object of `size` [m].
    """
    seen, guessed = surface.seen.points, surface.guesses.points
    unknown = np.empty((0, 3))
    known = np.vstack([seen, guessed, contacts.points])
    if estimate is not None and len(known):
        away, _ = cKDTree(known).query(estimate.vertices)
        unknown = np.asarray(estimate.vertices)[away > _UNKNOWN * size]
        unknown = unknown[:: -(-len(unknown) // _MOST_UNKNOWN) or 1]
    speck = trimesh.creation.icosphere(1, _SPECK * size)
    for layer, title, points, colour, on, note in (
        ("seen", counted(len(seen), "seen place"), seen, SEEN_COLOUR, True, "by the camera"),
        ("guessed", "Guessed", guessed, GUESSED_COLOUR, False, "behind the contour, not measured"),
        ("unknown", "Unknown", unknown, UNKNOWN_COLOUR, False, "estimate far from all others"),
    ):
        if not len(points):
            continue
        material = drawing.material(colour, roughness=0.6)
        at = make_pose(np.eye(3), points)
        canvas.commands.append(drawing.draw_copies(f"{OBJECT_NODE}/{layer}", speck, material, at))
        canvas.layers.append(Layer(layer, title, on, colour, note))


def depth_picture(view: DepthView, guesses: Contacts) -> bytes:
    """Return the part of the depth image about the object as PNG; near is bright.

    The object is in colours, what was guessed is marked, and holes have the colour of the unknown.
    """
    rows, columns = np.nonzero(view.object_mask)
    low = np.maximum([rows.min() - _MARGIN, columns.min() - _MARGIN], 0)
    part = (slice(low[0], rows.max() + _MARGIN + 1), slice(low[1], columns.max() + _MARGIN + 1))
    depth, mask = view.depth[part], view.object_mask[part]
    known = np.isfinite(depth)
    colours = np.repeat(0.35 + 0.5 * _nearness(depth, known)[..., None], 3, axis=2)
    shown = mask & known
    colours[shown] = viridis(_nearness(depth, shown)[shown])
    colours[view.unknown[part]] = srgb(UNKNOWN_COLOUR)
    u, v, _ = np.round(view.project(guesses.points)).astype(np.intp).T
    v, u = v - low[0], u - low[1]
    inside = (v >= 0) & (v < len(colours)) & (u >= 0) & (u < colours.shape[1])
    colours[v[inside], u[inside]] = srgb(GUESSED_COLOUR)
    return encode_png(np.round(255.0 * np.clip(colours, 0.0, 1.0)).astype(np.uint8))


def _nearness(
    depth: FloatArray, among: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
) -> FloatArray:
    """Return 1 for the nearest to 0 for the farthest of some pixels (H, W)."""
    if not among.any():
        return np.zeros(depth.shape)
    low, high = np.quantile(depth[among], (0.02, 0.98))
    near = np.clip((high - depth) / max(high - low, 1e-6), 0.0, 1.0)
    return np.where(np.isfinite(depth), near, 0.0)
