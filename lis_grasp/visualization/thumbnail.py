"""Small picture of an estimate as SVG, without a browser or matplotlib."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.visualization._arm_layer import coarser
from lis_grasp.visualization.camera import ELEVATION, view_axes
from lis_grasp.visualization.colours import ColourScale


def svg_of(mesh: trimesh.Trimesh) -> str:
    """Return a mesh [m], seen obliquely from above, in the colours of its ``uncertainty`` (V,)."""
    small, axes = coarser(mesh, 30), view_axes(np.deg2rad(-55.0), ELEVATION)
    seen = small.triangles @ axes.T  # (F, 3, 3): right, up, towards the eye
    front = np.flatnonzero(small.face_normals @ axes[2] > 0.0)
    front = front[np.argsort(seen[front, :, 2].mean(axis=1))]  # the farthest first
    deviations = mesh.vertex_attributes.get("uncertainty", np.zeros(len(mesh.vertices)))
    _, nearest = mesh.kdtree.query(small.triangles_center[front])
    scale = ColourScale.of_object(float(mesh.extents.max()), deviations)
    light = 0.7 + 0.2 * small.face_normals[front] @ (axes[1] + axes[2])
    colours = (255.0 * scale.colours(deviations[nearest]) * light[:, None]).astype(int)
    flat = seen[..., :2] * [1.0, -1.0] / np.ptp(seen[..., :2], axis=(0, 1)).max()
    places = (400.0 * (flat - flat.min(axis=(0, 1)))).round().astype(int)
    width, height = places.max(axis=(0, 1))
    faces = "".join(
        f'<path d="M{a} {b}L{c} {d}L{e} {f}z" fill="rgb({red},{green},{blue})"/>'
        for ((a, b), (c, d), (e, f)), (red, green, blue) in zip(places[front], colours, strict=True)
    )
    return f'<svg viewBox="0 0 {width} {height}" shape-rendering="crispEdges">{faces}</svg>'
