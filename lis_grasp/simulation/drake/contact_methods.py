"""Contact methods: which contacts Drake computes on point pairs or convex hulls, and a warning."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal
from warnings import warn

import numpy as np
from pydrake.geometry import CalcVolume, Convex, GeometryId, Mesh, SceneGraphInspector
from pydrake.multibody.tree import RigidBody

from lis_grasp.exceptions import InexactContactWarning
from lis_grasp.simulation.drake.contact_patches import LinkContact
from lis_grasp.simulation.drake.hand_plant import HandInPlant

_EXACT_MESH = ".vtk"  # a tetrahedral mesh, which Drake does not replace by its hull

_WORDS = {
    "points": "on point pairs: meshes are felt as their convex hulls, and forces begin large."
    " Give both bodies hydroelastic properties, and the plant"
    " contact_model='hydroelastic_with_fallback'",
    "hull": "on the convex hull of a mesh of {of}: Drake has no other of compliant meshes. Make the"
    " mesh rigid (drake:rigid_hydroelastic, or add_object), or give a tetrahedral one (.vtk)",
    "unknown": "on the convex hull of {of} if that is a compliant mesh, which cannot be seen in a"
    " plant that was finalized before add_hand: call it before plant.Finalize()",
}


class ContactMethods:
    """Warns once for each pair of bodies whose contact is not between their true shapes.

    Parameters
    ----------
    hand
        The hand that touches.
    felt
        Geometries that are touched, and their bodies.
    """

    def __init__(self, hand: HandInPlant, felt: Mapping[GeometryId, RigidBody]) -> None:
        self._hand, self._felt = hand, felt
        self._seen: set[tuple[GeometryId, GeometryId, bool]] = set()
        self._warned: set[tuple[str, str, str, str]] = set()

    def check(self, contacts: Iterable[LinkContact]) -> None:
        """Warn of contacts that are not between the true shapes."""
        for contact in contacts:
            key = contact.link_geometry, contact.felt_geometry, contact.surface is None
            if key not in self._seen:
                self._seen.add(key)
                self._check(contact)

    def _check(self, contact: LinkContact) -> None:
        link = self._hand.links.bodies[contact.link].scoped_name().get_full()
        felt = self._felt[contact.felt_geometry].scoped_name().get_full()
        if contact.surface is None:
            self._warn(link, felt, "points", felt)
            return
        # The face normals point out of N, into M.
        surface = contact.surface
        compliant = {surface.id_M(): surface.HasGradE_M(), surface.id_N(): surface.HasGradE_N()}
        scene_graph = self._hand.scene_graph
        inspector = None if scene_graph is None else scene_graph.model_inspector()
        names = {contact.felt_geometry: felt, contact.link_geometry: link}
        for geometry, body in names.items():
            if not compliant[geometry]:
                continue
            if inspector is None:
                self._warn(link, felt, "unknown", body)
            elif is_replaced_by_hull(inspector, geometry):
                self._warn(link, felt, "hull", body)

    def _warn(
        self, link: str, felt: str, method: Literal["points", "hull", "unknown"], of: str
    ) -> None:
        if (link, felt, method, of) not in self._warned:
            self._warned.add((link, felt, method, of))
            message = f"contact of {link} with {felt} is computed {_WORDS[method].format(of=of)}"
            warning = InexactContactWarning(message, link=link, body=felt, method=method)
            warn(warning, stacklevel=2)


def is_replaced_by_hull(inspector: SceneGraphInspector, geometry: GeometryId) -> bool:
    """Return whether a compliant geometry is a mesh that Drake replaces by its convex hull.

    Not so if the mesh is convex: it has the volume of its hull, but for rounding. A mesh whose
    volume Drake cannot compute counts as one that is not convex.
    """
    shape = inspector.GetShape(geometry)
    if not isinstance(shape, Mesh) or shape.extension() == _EXACT_MESH:
        return False
    try:
        hull = CalcVolume(Convex(shape.source(), shape.scale3()))
        return not np.isclose(CalcVolume(shape), hull)
    except RuntimeError:  # a format other than OBJ
        return True
