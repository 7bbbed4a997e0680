"""Meshes that a hand's links are drawn with: their visual meshes, else their collision bodies."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import trimesh

from lis_grasp.robots.link_bodies import load_visual

if TYPE_CHECKING:
    from lis_grasp.robots.robot_model import RobotModel

_MOST_FACES = 4000  # of a link: a page holds all links, and a copy of each for every grasp
_CELLS = 48  # along the largest extent of a mesh that is made coarser


def link_looks(hand: RobotModel, link: str) -> list[trimesh.Trimesh]:
    """Return the meshes of a link in its frame [m], made coarser where they have many triangles."""
    loaded = [(v, load_visual(v)) for v in hand.visuals if v.link == link]
    drawn = [m.copy().apply_transform(v.X_LG) for v, m in loaded if m is not None]
    if not drawn:
        bodies = (body for body in hand.link_geometries if body.link == link)
        drawn = [body.mesh.copy().apply_transform(body.X_LG) for body in bodies]
    return [mesh if len(mesh.faces) <= _MOST_FACES else coarser(mesh) for mesh in drawn]


def coarser(mesh: trimesh.Trimesh, cells: int = _CELLS) -> trimesh.Trimesh:
    """Return a mesh with the vertices of each cell of a grid joined at their mean.

    Vertex clustering (Rossignac and Borrel, 1993); `cells` is the number of cells along the largest
    extent.
    """
    cell = float(mesh.extents.max()) / cells or 1.0
    keys = np.floor((mesh.vertices - mesh.bounds[0]) / cell).astype(np.int64)
    _, cluster, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    cluster = cluster.ravel()
    vertices = np.zeros((len(counts), 3))
    np.add.at(vertices, cluster, mesh.vertices)
    faces = cluster[mesh.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return trimesh.Trimesh(vertices / counts[:, None], faces[np.sort(first)], process=False)
