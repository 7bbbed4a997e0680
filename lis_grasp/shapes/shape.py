"""The record of a true object: its mesh, its sharp edges, and its repairs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidMeshError, shown
from lis_grasp.guesses import Answering
from lis_grasp.io.units import require_object_size
from lis_grasp.records import read_only
from lis_grasp.shapes._repair import repair_mesh
from lis_grasp.shapes._topology import signed_volume
from lis_grasp.typing import FloatArray

SHARP_ANGLE = float(np.radians(30.0))
"""Two faces that meet at a larger angle between their normals form a sharp edge [rad]."""


def sharp_edges(mesh: trimesh.Trimesh, *, angle: float = SHARP_ANGLE) -> FloatArray:
    """Return the edges where a mesh bends by more than `angle` [rad], convex and concave alike.

    Shape (E, 2, 3) [m]: the two ends of each straight piece. Curved edges come as polylines as
    fine as the mesh. On scanned meshes noise adds edges.
    """
    sharp = mesh.face_adjacency_angles > angle
    return np.array(mesh.vertices[mesh.face_adjacency_edges[sharp]]).reshape(-1, 2, 3)


def require_mesh(what: str, mesh: object) -> trimesh.Trimesh:
    """Return a mesh; raise `InvalidMeshError` if it is none, or fits no object in metres."""
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise InvalidMeshError(
            f"{what} must be a mesh with faces, such as extract_mesh(surface); it is {shown(mesh)}"
        )
    require_object_size(what, float(mesh.extents.max()), in_memory=True)
    return mesh


@dataclass(frozen=True, slots=True, eq=False)
class Shape(Answering):
    """A true object, in its frame O.

    Parameters
    ----------
    name
        A built-in name, or the stem of the mesh file.
    mesh
        Watertight, faces outward, in metres. Not to be changed in place.
    edges
        Shape (E, 2, 3) [m], its sharp edges as straight pieces.
    repairs
        Repairs of the file's mesh, one sentence each.

    Raises
    ------
    InvalidMeshError
        If the mesh is not closed, is turned inside out, or the edges have another shape.

    Examples
    --------
    >>> import trimesh
    >>> shape = Shape.from_mesh(trimesh.creation.box((0.04, 0.05, 0.06)))
    >>> shape.size, len(shape.edges)
    (0.06, 12)
    """

    name: str
    mesh: trimesh.Trimesh
    edges: FloatArray = field(repr=False)
    repairs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.mesh.is_watertight or not self.mesh.is_winding_consistent:
            raise InvalidMeshError(
                f"the mesh of {self.name} must be closed, with two faces of like orientation at"
                " every edge; it is not: Shape.from_mesh repairs it"
            )
        volume = signed_volume(np.asarray(self.mesh.triangles))
        if not volume > 0.0:
            raise InvalidMeshError(
                f"the mesh of {self.name} must enclose a positive volume; it encloses"
                f" {volume:.3g} m^3: its faces must point outward"
            )
        edges = np.array(self.edges, dtype=np.float64)
        if edges.ndim != 3 or edges.shape[1:] != (2, 3):
            raise InvalidMeshError(f"edges must have shape (E, 2, 3); they have {edges.shape}")
        object.__setattr__(self, "edges", read_only(edges))

    @classmethod
    def from_mesh(cls, mesh: trimesh.Trimesh, name: str = "object") -> Shape:
        """Return the object of any triangle mesh in metres, closed and outward.

        O is the frame of the mesh. It is repaired like a mesh file (`shapes.load`), and `repairs`
        lists what was done; the given mesh stays as it is.

        Raises `InvalidMeshError` if it is no mesh, encloses no volume, or could not be closed.
        """
        require_mesh(name, mesh)
        try:
            closed, repairs = repair_mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))
        except InvalidMeshError as error:
            raise InvalidMeshError(f"the mesh of {name} {error}") from None
        return cls(name, closed, sharp_edges(closed), repairs)

    @property
    def size(self) -> float:
        """Largest extent along the axes of O [m]."""
        return float(self.mesh.extents.max())
