"""Fast rejection of colliding hand poses: balls in the links against a grid of distances."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh
from scipy import ndimage
from scipy.spatial import cKDTree

from lis_grasp.geometry import apply_pose
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.robot_model import LinkGeometry
from lis_grasp.typing import FloatArray

# Grid nodes along the object's largest extent, or the hand's largest ball radius if longer.
_NODES = 32
_SURFACE_STEP = 0.8  # between sampled points of the surface, in cells of the grid
_SPACING = 1.0  # between balls of a long link, in radii


class HandPoseFilter:
    """Finds hand poses that surely collide with an object, many at once.

    Balls inside the links approximate the hand, and the distance of the nearest node of a grid
    approximates the object, a closed mesh in O [m]. Both err on the side of no collision: what is
    rejected collides, and the rest has to be checked (`HandCollisionChecker`).
    """

    def __init__(self, hand: Hand, mesh: trimesh.Trimesh) -> None:
        self._hand = hand
        balls = [(g, *balls_inside(g)) for g in hand.link_geometries]
        self._links = [(g.link, g.X_LG, centers) for g, centers, _ in balls]
        self._radii = np.concatenate([radii for _, _, radii in balls])  # (S,)
        self._of_pads = np.concatenate(
            [np.full(len(radii), g.link in hand.pad_links) for g, _, radii in balls]
        )
        largest = float(self._radii.max(initial=0.0))
        self._cell = max(float(mesh.extents.max()), largest) / _NODES
        margin = largest + 2.0 * self._cell
        self._lowest = np.asarray(mesh.bounds[0]) - margin
        shape = np.ceil((mesh.extents + 2.0 * margin) / self._cell).astype(int) + 1
        # Farther nodes collide with any ball if they are inside, and else with none.
        farthest = max(largest, 2.0 * self._cell)
        self._distances = _distances_to_solid(mesh, self._lowest, shape, self._cell, farthest)

    def collides(
        self, X_OH: FloatArray, q: FloatArray, *, pads_may_touch: bool = False
    ) -> npt.NDArray[np.bool_]:
        """Return which poses surely collide with the object, shape (N,).

        `X_OH` (N, 4, 4) are poses of the palm in O; `q` are joint positions of all poses, (J,), or
        of each, (N, J). With `pads_may_touch` the links that carry pads are left out.
        """
        centers_H = self._centers_in_hand(q)  # (S, 3) or (N, S, 3)
        kept = ~self._of_pads if pads_may_touch else np.ones(len(self._radii), dtype=bool)
        # One product of matrices takes all balls of all poses from O to the grid.
        rotation = X_OH[:, :3, :3] / self._cell
        offset = (X_OH[:, :3, 3] - self._lowest) / self._cell + 0.5
        nodes = centers_H[..., kept, :] @ np.swapaxes(rotation, -1, -2) + offset[:, None]
        shape = np.array(self._distances.shape)
        np.clip(nodes, 0.0, shape - 1.0, out=nodes)  # the border of the grid is far from all
        i, j, k = np.moveaxis(nodes.astype(np.int32), -1, 0)
        near = self._distances.ravel()[(i * shape[1] + j) * shape[2] + k]  # (N, S)
        inside = self._radii[kept] - 0.5 * np.sqrt(3.0) * self._cell
        return np.asarray((near < inside).any(axis=1))

    def _centers_in_hand(self, q: FloatArray) -> FloatArray:
        poses = self._hand.forward_kinematics(np.eye(4), q)
        return np.concatenate(
            [
                apply_pose(poses[link], apply_pose(X_LG, centers))
                for link, X_LG, centers in self._links
            ],
            axis=-2,
        )


def balls_inside(geometry: LinkGeometry) -> tuple[FloatArray, FloatArray]:
    """Return centres (S, 3) in G and radii (S,) of balls inside a body; none for a shell."""
    match geometry.kind:
        case "sphere":
            return np.zeros((1, 3)), np.array(geometry.dimensions)
        case "capsule" | "cylinder":
            radius, length = geometry.dimensions
            if geometry.kind == "cylinder":
                radius = min(radius, length / 2.0)
                length -= 2.0 * radius
            half = np.array([0.0, 0.0, length / 2.0])
        case "box":
            radius = min(geometry.dimensions) / 2.0
            half = np.array(geometry.dimensions) / 2.0 - radius
        case "mesh":
            return _ball_in_mesh(geometry.mesh)
    counts = np.ceil(2.0 * half / (_SPACING * radius)).astype(int) + 1
    axes = (np.linspace(-h, h, n) * (n > 1) for h, n in zip(half, counts, strict=True))
    centers = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return centers, np.full(len(centers), radius)


def _ball_in_mesh(mesh: trimesh.Trimesh) -> tuple[FloatArray, FloatArray]:
    """Return the largest ball about the centre of mass of a convex mesh."""
    center = np.asarray(mesh.center_mass)
    heights = ((mesh.triangles[:, 0] - center) * mesh.face_normals).sum(axis=1)
    if not len(heights) or heights.min() <= 0.0:  # an open or concave mesh, perhaps not inside
        return np.zeros((0, 3)), np.zeros(0)
    return center[None], np.array([heights.min()])


def _distances_to_solid(
    mesh: trimesh.Trimesh,
    lowest: FloatArray,
    shape: npt.NDArray[np.int_],
    cell: float,
    farthest: float,
) -> npt.NDArray[np.float32]:
    """Return upper bounds of the signed distances of nodes from a solid [m], negative inside.

    Infinite for nodes that are farther from the surface than `farthest`.
    """
    fine = mesh.subdivide_to_size(_SURFACE_STEP * cell, max_iter=20)
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1)
    near, _ = cKDTree(fine.vertices).query(
        lowest + cell * nodes.reshape(-1, 3), distance_upper_bound=farthest
    )
    distances = near.reshape(shape)
    # Of neighbours across the surface one is within a cell of a vertex: this separates the inside.
    regions, _ = ndimage.label(distances > cell)
    outside = (regions == 0) | (regions == regions[0, 0, 0])
    signed = np.where(outside, distances, _SURFACE_STEP * cell - distances)
    return signed.astype(np.float32)
