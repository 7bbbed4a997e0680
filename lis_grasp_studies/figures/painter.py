"""Painter's algorithm: triangles, lines and points of space drawn on flat matplotlib axes.

Everything becomes flat patches with a depth. One collection shows them sorted by depth, so that
near patches hide far ones. Triangles are sorted by their middles, which is right where they are
small: `mesh_patches` cuts long ones. Lines and points on a surface get a little extra depth, or
they would sink into the triangles around them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from lis_grasp.shapes import SHARP_ANGLE
from lis_grasp.typing import FloatArray, IndexArray
from lis_grasp.visualization.camera import LIGHT, View
from lis_grasp_studies.figures.palette import rgba

# Width [pt] of a patch's outline in its own colour: it closes the hairline gaps between patches.
_SEAM = 0.8
_DISC = 2.0 * np.pi * np.arange(16) / 16


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """Flat polygons of one kind, with the depths that they are sorted by."""

    outlines: FloatArray  # (P, K, 2) [m], on the picture
    depths: FloatArray  # (P,) [m], larger is nearer to the eye
    colours: FloatArray  # (P, 4), RGBA
    seam: float = 0.0  # width of the outline that each gets in its own colour [pt]


def mesh_patches(
    view: View, mesh: trimesh.Trimesh, colours: npt.ArrayLike | str, *, piece: float | None = None
) -> Patches:
    """Return the shaded triangles of a closed mesh in O [m] that face the eye.

    `colours` is one colour, or RGBA of each triangle, shape (F, 4). Triangles are cut until no side
    is longer than `piece` [m]; None cuts at a 25th of the mesh's extent.
    """
    piece = float(mesh.extents.max()) / 25.0 if piece is None else piece
    facing = np.flatnonzero(view.faces(mesh.face_normals))
    triangles, owners = cut_triangles(np.asarray(mesh.triangles)[facing], piece)
    rows = facing[owners]
    normals = np.asarray(mesh.face_normals)[rows]
    return triangle_patches(view, triangles, normals, _each(colours, len(mesh.faces))[rows])


def triangle_patches(
    view: View,
    triangles: FloatArray,
    normals: FloatArray,
    colours: FloatArray,
    *,
    darkest: float = 0.5,
) -> Patches:
    """Return triangles (F, 3, 3) [m] with colours (F, 4), shaded by unit normals (F, 3) in O.

    `darkest`, from 0 to 1, is what is left of a colour that faces away from the light.
    """
    places, depths = view.project(triangles)
    lit = 0.5 + 0.5 * normals @ (LIGHT @ view.axes)  # no step where the light grazes
    shaded = np.array(colours, dtype=np.float64)
    shaded[:, :3] *= (darkest + (1.0 - darkest) * lit)[:, None]
    return Patches(places, depths.mean(axis=1), shaded, _SEAM)


def edge_patches(
    view: View, mesh: trimesh.Trimesh, colour: str, *, width: float, lift: float
) -> Patches:
    """Return the sharp edges of a closed mesh, except those between two faces that look away.

    Edges are `width` wide [m]; `lift` is added to their depth [m].
    """
    sharp = mesh.face_adjacency_angles > SHARP_ANGLE
    facing = view.faces(np.asarray(mesh.face_normals)[mesh.face_adjacency[sharp]])  # (E, 2)
    edges = np.asarray(mesh.vertices[mesh.face_adjacency_edges[sharp]]).reshape(-1, 2, 3)
    return line_patches(view, edges[facing.any(axis=1)], colour, width=width, lift=lift)


def line_patches(
    view: View,
    segments: FloatArray,
    colours: npt.ArrayLike | str,
    *,
    width: float,
    lift: float = 0.0,
    piece: float = 0.004,
) -> Patches:
    """Return straight lines (S, 2, 3) [m] as ribbons of a width [m] that face the eye.

    `colours` is one colour, or RGBA of each line, shape (S, 4). Lines are cut in pieces of at most
    `piece` [m], each sorted by its own depth; `lift` is added to the depths [m].
    """
    pieces, owners = cut_segments(segments, piece)
    places, depths = view.project(pieces)  # (P, 2, 2), (P, 2)
    along = places[:, 1] - places[:, 0]
    along /= np.maximum(np.linalg.norm(along, axis=1), np.finfo(float).tiny)[:, None]
    end = 0.5 * width * along
    side = end[:, ::-1] * [-1.0, 1.0]
    # A quarter of the width beyond both ends closes the bends of polylines.
    a, b = places[:, 0] - 0.5 * end, places[:, 1] + 0.5 * end
    outlines = np.stack([a - side, b - side, b + side, a + side], axis=1)
    return Patches(outlines, depths.mean(axis=1) + lift, _each(colours, len(segments))[owners])


def point_patches(
    view: View, points: FloatArray, colour: str, *, radius: float, lift: float = 0.0
) -> Patches:
    """Return points (N, 3) [m] as discs of one radius [m]; `lift` is added to their depth [m]."""
    places, depths = view.project(points)
    disc = radius * np.column_stack([np.cos(_DISC), np.sin(_DISC)])  # (16, 2)
    return Patches(places[:, None] + disc, depths + lift, _each(colour, len(places)))


def paint(axes: Axes, patches: Iterable[Patches], *, frame: FloatArray | None = None) -> None:
    """Draw patches on axes, far ones first, at equal scales, without the axes' frame and ticks.

    `frame` is the lowest and highest place to show, shape (2, 2) [m]; None shows all patches.
    """
    kinds = list(patches)
    depths = np.concatenate([kind.depths for kind in kinds])
    order = np.argsort(depths, kind="stable")
    seams = np.repeat([kind.seam for kind in kinds], [len(kind.depths) for kind in kinds])
    outlines = [outline for kind in kinds for outline in kind.outlines]
    colours = np.concatenate([kind.colours for kind in kinds])[order]
    collection = PolyCollection([outlines[k] for k in order], linewidths=seams[order])
    collection.set(facecolor=colours, edgecolor=colours, rasterized=True)
    axes.add_collection(collection, autolim=False)
    low, high = frame_of(kinds) if frame is None else frame
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set_axis_off()


def frame_of(patches: Iterable[Patches], *, margin: float = 0.02) -> FloatArray:
    """Return the lowest and highest place of patches, with a margin of their extent, (2, 2) [m]."""
    places = np.concatenate([kind.outlines.reshape(-1, 2) for kind in patches])
    low, high = places.min(axis=0), places.max(axis=0)
    pad = margin * (high - low).max()
    return np.array([low - pad, high + pad])


def overlay_lines(
    axes: Axes, view: View, segments: FloatArray, colours: npt.ArrayLike, *, points: float
) -> None:
    """Draw lines (S, 2, 3) [m] on top of everything, `points` wide [pt]."""
    lines = LineCollection(list(view.project(segments)[0]), colors=np.asarray(colours), lw=points)
    axes.add_collection(lines, autolim=False)


def _each(colours: npt.ArrayLike | str, count: int) -> FloatArray:
    return np.broadcast_to(rgba(colours) if isinstance(colours, str) else colours, (count, 4))


def cut_segments(segments: FloatArray, piece: float) -> tuple[FloatArray, IndexArray]:
    """Cut each line of (S, 2, 3) in equal parts of at most `piece` [m].

    Returns the parts (P, 2, 3) [m] and the line that each was cut from (P,).
    """
    steps = segments[:, 1] - segments[:, 0]
    lengths = np.linalg.norm(steps, axis=1)
    # A line of a whole number of pieces gets no extra piece from rounding.
    counts = np.maximum(np.ceil(lengths / piece * (1.0 - 1e-9)), 1.0).astype(np.intp)
    owners = np.repeat(np.arange(len(segments)), counts)
    index = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    ends = np.stack([index, index + 1], axis=1) / counts[owners][:, None]  # (P, 2), from 0 to 1
    return segments[owners, None, 0] + ends[..., None] * steps[owners, None], owners


def cut_triangles(triangles: FloatArray, piece: float) -> tuple[FloatArray, IndexArray]:
    """Halve triangles (F, 3, 3) at their longest side until none is longer than `piece` [m].

    Returns the triangles (P, 3, 3) [m] and the triangle that each was cut from (P,).
    """
    owners = np.arange(len(triangles))
    done: list[tuple[FloatArray, IndexArray]] = []
    while len(triangles):
        sides = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)  # k to k + 1
        long = sides.max(axis=1) > piece
        done.append((triangles[~long], owners[~long]))
        first, row = sides[long].argmax(axis=1), np.arange(long.sum())
        a, b, c = (triangles[long][row, (first + k) % 3] for k in range(3))
        middle = 0.5 * (a + b)
        triangles = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
        owners = np.tile(owners[long], 2)
    if not done:
        return triangles, owners
    return np.concatenate([t for t, _ in done]), np.concatenate([o for _, o in done])
