"""Draw triangles, lines and points of space on flat axes, far ones first (painter's algorithm).

Everything becomes flat patches with a depth; sorted by it they go into one collection, so that near
ones hide far ones, lines and points included. Triangles are sorted by their middles, which is right
where they are small: `mesh_patches` cuts long ones. What lies on a surface is lifted a little
towards the eye in depth (not in place), or else it would sink into the triangles around it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import trimesh
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from lis_grasp.experiments.figures.cutting import cut_segments, cut_triangles
from lis_grasp.experiments.figures.palette import rgba
from lis_grasp.shapes import SHARP_ANGLE
from lis_grasp.typing import FloatArray

# Where light comes from, in the view's axes right, up, towards the eye; and what is left without.
_LIGHT = np.array([-0.35, 0.6, 0.72]) / np.linalg.norm([-0.35, 0.6, 0.72])
_DARKEST = 0.5

# Width [pt] of a patch's outline in its own colour: it closes the hairline gaps between patches,
# which would show what they hide.
_SEAM = 0.8
_DISC = 2.0 * np.pi * np.arange(16) / 16


@dataclass(frozen=True, slots=True)
class View:
    """An orthographic view of O, with z upwards on the picture.

    Parameters
    ----------
    azimuth
        Direction from which the eye looks, about z from +x towards +y [rad].
    elevation
        Of the eye above the plane z = 0 [rad], below a right angle.
    """

    azimuth: float
    elevation: float

    @property
    def axes(self) -> FloatArray:
        """Rows: the picture's right, its up, and towards the eye, unit, in O; shape (3, 3)."""
        ca, sa = np.cos(self.azimuth), np.sin(self.azimuth)
        ce, se = np.cos(self.elevation), np.sin(self.elevation)
        return np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])

    def project(self, points: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return places on the picture (..., 2) [m] of points (..., 3), and their depths (...).

        Depth grows towards the eye [m].
        """
        seen = np.asarray(points, dtype=np.float64) @ self.axes.T
        return seen[..., :2], seen[..., 2]


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """Flat polygons of one kind, with the depths that they are sorted by.

    Parameters
    ----------
    outlines
        Shape (P, K, 2) [m], on the picture.
    depths
        Shape (P,) [m], larger is nearer to the eye.
    colours
        Shape (P, 4), RGBA.
    seam
        Width of the outline that each gets in its own colour [pt].
    """

    outlines: FloatArray
    depths: FloatArray
    colours: FloatArray
    seam: float = 0.0

    def at_depth(self, depth: float) -> Patches:
        """Return the same patches, all at one depth [m]: drawn in their order."""
        return replace(self, depths=np.full(len(self.depths), depth))


def mesh_patches(
    view: View,
    mesh: trimesh.Trimesh,
    colours: npt.ArrayLike | str,
    *,
    piece: float | None = None,
) -> Patches:
    """Return the triangles of a closed mesh that face the eye, shaded.

    Parameters
    ----------
    view
        Where it is seen from.
    mesh
        Outward oriented [m].
    colours
        A colour, or RGBA of each triangle, shape (F, 4).
    piece
        Longest side of a triangle [m]; longer ones are cut. None cuts at a 25th of the extent.
    """
    piece = float(mesh.extents.max()) / 25.0 if piece is None else piece
    facing = np.flatnonzero(np.asarray(mesh.face_normals) @ view.axes[2] > 0.0)
    triangles, owners = cut_triangles(np.asarray(mesh.triangles)[facing], piece)
    each = np.broadcast_to(
        rgba(colours) if isinstance(colours, str) else colours, (len(mesh.faces), 4)
    )
    normals = np.asarray(mesh.face_normals)[facing][owners]
    return triangle_patches(view, triangles, normals, each[facing][owners])


def triangle_patches(
    view: View,
    triangles: FloatArray,
    normals: FloatArray,
    colours: FloatArray,
    *,
    darkest: float = _DARKEST,
) -> Patches:
    """Return triangles (F, 3, 3) [m] as they are, shaded by normals (F, 3), see `shade`."""
    places, depths = view.project(triangles)
    shaded = shade(view, normals, colours, darkest=darkest)
    return Patches(places, depths.mean(axis=1), shaded, _SEAM)


def shade(
    view: View, normals: FloatArray, colours: FloatArray, *, darkest: float = _DARKEST
) -> FloatArray:
    """Return colours (F, 4) under the light, for surfaces with unit normals (F, 3) in O.

    `darkest`, from 0 to 1, is what is left of a colour that faces away from the light.
    """
    lit = 0.5 + 0.5 * normals @ (_LIGHT @ view.axes)  # round the terminator without a step
    shaded = np.array(colours, dtype=np.float64)
    shaded[:, :3] *= (darkest + (1.0 - darkest) * lit)[:, None]
    return shaded


def edge_patches(
    view: View, mesh: trimesh.Trimesh, colour: str, *, width: float, lift: float
) -> Patches:
    """Return the sharp edges of a closed mesh, but for those between two faces that look away.

    Parameters
    ----------
    view
        Where they are seen from.
    mesh
        Outward oriented [m].
    colour
        Of all edges.
    width
        Of an edge [m].
    lift
        Added to the depth [m].
    """
    sharp = mesh.face_adjacency_angles > SHARP_ANGLE
    away = np.asarray(mesh.face_normals)[mesh.face_adjacency[sharp]] @ view.axes[2] <= 0.0  # (E, 2)
    edges = np.asarray(mesh.vertices[mesh.face_adjacency_edges[sharp]]).reshape(-1, 2, 3)
    return line_patches(view, edges[~away.all(axis=1)], colour, width=width, lift=lift)


def line_patches(
    view: View,
    segments: FloatArray,
    colours: npt.ArrayLike | str,
    *,
    width: float,
    lift: float = 0.0,
    piece: float = 0.004,
) -> Patches:
    """Return straight lines as ribbons that face the eye.

    Parameters
    ----------
    view
        Where they are seen from.
    segments
        Shape (S, 2, 3) [m].
    colours
        A colour, or RGBA of each line, shape (S, 4).
    width
        Of a ribbon [m].
    lift
        Added to the depth [m].
    piece
        Lines are cut in pieces of at most this length [m], each sorted on its own.
    """
    each = np.broadcast_to(
        rgba(colours) if isinstance(colours, str) else colours, (len(segments), 4)
    )
    pieces, owners = cut_segments(segments, piece)
    places, depths = view.project(pieces)  # (P, 2, 2), (P, 2)
    along = places[:, 1] - places[:, 0]
    along /= np.maximum(np.linalg.norm(along, axis=1), np.finfo(float).tiny)[:, None]
    reach = 0.5 * width * along  # half a width beyond both ends: bends of polylines stay closed
    aside = reach[:, ::-1] * [-1.0, 1.0]
    a, b = places[:, 0] - 0.5 * reach, places[:, 1] + 0.5 * reach
    outlines = np.stack([a - aside, b - aside, b + aside, a + aside], axis=1)
    return Patches(outlines, depths.mean(axis=1) + lift, each[owners])


def point_patches(
    view: View, points: FloatArray, colour: str, *, radius: float, lift: float = 0.0
) -> Patches:
    """Return points (N, 3) [m] as discs of one radius [m] on the picture."""
    places, depths = view.project(points)
    disc = radius * np.column_stack([np.cos(_DISC), np.sin(_DISC)])  # (16, 2)
    colours = np.broadcast_to(rgba(colour), (len(places), 4))
    return Patches(places[:, None] + disc, depths + lift, colours)


def paint(axes: Axes, patches: Iterable[Patches], *, frame: FloatArray | None = None) -> None:
    """Draw patches on axes, far ones first, at equal scales.

    Parameters
    ----------
    axes
        Become what is shown; their frame and ticks go.
    patches
        At least one.
    frame
        Lowest and highest place to show, shape (2, 2) [m]; None shows what there is.
    """
    kinds = list(patches)
    depths = np.concatenate([kind.depths for kind in kinds])
    order = np.argsort(depths, kind="stable")
    seams = np.repeat([kind.seam for kind in kinds], [len(kind.depths) for kind in kinds])
    outlines = [outline for kind in kinds for outline in kind.outlines]
    colours = np.concatenate([kind.colours for kind in kinds])[order]
    collection = PolyCollection(
        [outlines[k] for k in order],
        facecolors=colours,
        edgecolors=colours,
        linewidths=seams[order],
        rasterized=True,
    )
    axes.add_collection(collection, autolim=False)
    if frame is None:
        frame = frame_of(kinds)
    axes.set_xlim(frame[0, 0], frame[1, 0])
    axes.set_ylim(frame[0, 1], frame[1, 1])
    axes.set_aspect("equal")
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
    """Draw lines (S, 2, 3) on top of everything, `points` wide [pt], as through glass."""
    axes.add_collection(
        LineCollection(list(view.project(segments)[0]), colors=np.asarray(colours), lw=points),
        autolim=False,
    )


def _each(colours: npt.ArrayLike | str, count: int) -> FloatArray:
    """Return RGBA of each of `count` things, shape (count, 4), from one colour or all of them."""
    table = rgba(colours) if isinstance(colours, str) else np.asarray(colours, dtype=np.float64)
    return np.broadcast_to(table, (count, 4))
