"""Static pictures of an object, an estimate, contacts and a hand on matplotlib axes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import trimesh
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape
from lis_grasp.typing import FloatArray
from lis_grasp.visualization.camera import View
from lis_grasp.visualization.colours import ColourScale, viridis
from lis_grasp.visualization.hand_layers import link_looks
from lis_grasp_studies.figures._solids import VIEW, contact_patches, solid_patches
from lis_grasp_studies.figures.painter import (
    Patches,
    frame_of,
    mesh_patches,
    overlay_lines,
    paint,
)
from lis_grasp_studies.figures.palette import EDGE, SURFACE, TRUTH, rgba

_PAINTED = 0.2  # extent of objects that the painter's lines and points are made for [m]
_PALM, _LINK, _PAD = "#5c6470", "#8a929e", "#efede7"


def _tinted(colours: FloatArray) -> FloatArray:
    # Lighter than in the scene page, so that contacts and their normals are easy to see.
    return 0.25 + 0.75 * colours


COLOURS = ListedColormap(_tinted(viridis(np.linspace(0.0, 1.0, 256))))


def draw_still(
    axes: Axes,
    *,
    truth: Shape | None = None,
    estimate: trimesh.Trimesh | None = None,
    contacts: Contacts | None = None,
    hand: Hand | None = None,
    links: Mapping[str, FloatArray] | None = None,
    scale: ColourScale | None = None,
    view: View = VIEW,
) -> ScalarMappable | None:
    """Draw an object, an estimate, contacts and a hand as a picture on matplotlib's axes.

    Parameters
    ----------
    axes
        Matplotlib's axes; their frame and ticks are removed.
    truth
        The true object, in O: as a solid, or as its sharp edges if there is an estimate too.
    estimate
        The estimated surface, in O [m], in the colours of its ``"uncertainty"`` if it has one.
    contacts
        Points with their normals, in O.
    hand, links
        A hand and the poses of its links in O, as `Hand.forward_kinematics` returns them.
    scale
        Colours of the uncertainty; None for a scale that fits this estimate.
    view
        Direction from which the eye looks.

    Returns
    -------
    ScalarMappable or None
        For ``figure.colorbar``, in millimetres; None without an uncertainty.

    Raises
    ------
    InvalidOptionError
        If there is neither a true object nor an estimate.
    """
    solid = estimate if estimate is not None else None if truth is None else truth.mesh
    if solid is None:
        raise InvalidOptionError(
            "a picture needs a true object or an estimate; it has neither", option="truth"
        )
    sized = solid if truth is None else truth.mesh
    factor = _PAINTED / float(sized.extents.max())
    uncertainty = None if estimate is None else estimate.vertex_attributes.get("uncertainty")
    patches: list[Patches] = []
    colours: npt.ArrayLike | str = TRUTH if estimate is None else SURFACE
    if uncertainty is not None:
        scale = scale or ColourScale.of(uncertainty)
        of_faces = np.asarray(uncertainty)[solid.faces].mean(axis=1)
        colours = np.column_stack([_tinted(scale.colours(of_faces)), np.ones(len(of_faces))])
    patches += solid_patches(view, solid.copy().apply_scale(factor), colours)
    if contacts is not None and len(contacts):
        scaled = Contacts(factor * contacts.points, contacts.normals)
        patches += contact_patches(view, scaled)
    if hand is not None and links is not None:
        patches += _hand_patches(view, hand, links, factor)
    frame = frame_of(patches)
    if truth is not None:
        places, _ = view.project(factor * np.asarray(truth.mesh.vertices))
        frame = np.array([np.minimum(frame[0], places.min(0)), np.maximum(frame[1], places.max(0))])
    paint(axes, patches, frame=frame)
    if truth is not None and estimate is not None:
        overlay_lines(axes, view, factor * truth.edges, rgba(EDGE, 0.45)[None], points=0.8)
    if uncertainty is None or scale is None:
        return None
    return ScalarMappable(Normalize(1e3 * scale.low, 1e3 * scale.high), COLOURS)


def _hand_patches(
    view: View, hand: Hand, links: Mapping[str, FloatArray], factor: float
) -> list[Patches]:
    """Return the links of a hand at their poses, scaled by `factor` about O."""
    tips = {pad.link for pad in hand.pads}
    patches = []
    for link in hand.links:
        colour = _PAD if link in tips else _PALM if link == hand.base_link else _LINK
        for mesh in link_looks(hand, link):
            placed = mesh.copy().apply_transform(links[link]).apply_scale(factor)
            patches.append(mesh_patches(view, placed, colour, piece=0.006))
    return patches
