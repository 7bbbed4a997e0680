"""Drawings in Drake's Meshcat that are replaced when they change."""

from __future__ import annotations

from collections.abc import Callable
from threading import get_ident

import numpy as np
import trimesh
from pydrake.geometry import Meshcat, Rgba
from pydrake.math import RigidTransform

from lis_grasp.contacts import Contacts
from lis_grasp.geometry import apply_pose
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray
from lis_grasp.visualization.colours import ColourScale, viridis

_CONTACT = (0.85, 0.1, 0.1, 1.0)  # colour
_NORMAL = 0.012  # length of a drawn normal [m]
_LINE = 3.0  # width of a drawn normal [pixels]


class Drawing:
    """A drawing in Meshcat, made again when its content has changed.

    Meshcat ends a thread that is not its own, so calls from other threads than the one that made
    the drawing do nothing. With `replay`, every version stays, visible at its time only, so that
    Meshcat's recording shows how it grew.
    """

    def __init__(
        self, meshcat: Meshcat, path: str, X_WE: RigidTransform, *, replay: bool = False
    ) -> None:
        self._meshcat, self._path, self._replay = meshcat, path, replay
        self._thread, self._version = get_ident(), 0
        self._drawn: object = None
        meshcat.SetTransform(path, X_WE)

    def show(self, content: object, time: float, draw: Callable[[Meshcat, str], None]) -> bool:
        """Draw the content if it is new, at a time of the recording [s]; return whether it is."""
        if content == self._drawn or get_ident() != self._thread:
            return False
        meshcat, before = self._meshcat, f"{self._path}/{self._version}"
        self._drawn, self._version = content, self._version + 1
        now = f"{self._path}/{self._version}"
        draw(meshcat, now)
        if not self._replay:
            meshcat.Delete(before)
            return True
        if self._version > 1:
            meshcat.SetProperty(before, "visible", False, time)
            meshcat.SetProperty(now, "visible", False, 0.0)
        meshcat.SetProperty(now, "visible", True, time)
        return True


def show_contacts(meshcat: Meshcat, path: str, contacts: Contacts) -> None:
    """Draw contacts as their outward normals."""
    ends = contacts.points + _NORMAL * contacts.normals
    meshcat.SetLineSegments(path, contacts.points.T, ends.T, _LINE, Rgba(*_CONTACT))


def show_estimate(meshcat: Meshcat, path: str, mesh: trimesh.Trimesh) -> None:
    """Draw an estimate's mesh, coloured by its uncertainty from 0 (dark) to 2.5 % of its size."""
    uncertainty = np.asarray(mesh.vertex_attributes["uncertainty"])
    scale = ColourScale.of_object(float(mesh.extents.max()), uncertainty)
    colours = viridis(np.where(np.isfinite(uncertainty), uncertainty, scale.high) / scale.high)
    vertices, faces = np.asfortranarray(mesh.vertices.T), np.asfortranarray(mesh.faces.T)
    meshcat.SetTriangleColorMesh(path, vertices, faces, np.asfortranarray(colours.T))


def show_hand(
    meshcat: Meshcat, path: str, hand: Hand, X_EH: FloatArray, q: FloatArray, colour: Rgba
) -> None:
    """Draw the collision bodies of a hand in a posture q (J,), its palm at X_EH (4, 4)."""
    links = hand.forward_kinematics(X_EH, q)
    bodies = [
        trimesh.Trimesh(
            apply_pose(links[body.link] @ body.X_LG, body.mesh.vertices), body.mesh.faces
        )
        for body in hand.link_geometries
    ]
    whole = trimesh.util.concatenate(bodies)
    vertices, faces = np.asfortranarray(whole.vertices.T), np.asfortranarray(whole.faces.T)
    meshcat.SetTriangleMesh(path, vertices, faces, colour)
