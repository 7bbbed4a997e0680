"""Tasks at edges, by geometry alone: a slot, walls, a suction cup, standing on a table.

A task is carried out on the estimate, and judged on the truth; both are meshes in one frame [m].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import manifold3d
import numpy as np
import trimesh

from lis_grasp.geometry import cross
from lis_grasp.grasping.seals import press_cups
from lis_grasp.robots.robot_model import Cup
from lis_grasp.shapes import resting_poses
from lis_grasp.shapes.mesh_distance import MeshTree, winding_numbers
from lis_grasp.shapes.resting import rest_from
from lis_grasp.shapes.solids import solid_of
from lis_grasp.typing import BoolArray, FloatArray

FAILED = 0.099
"""Clearance and errors of an estimate that does not exist [m]."""

# A slot: steps of the search [m], sides of a rounded corner, area that counts as none [m^2], and
# how far it may let the object move, in clearances, in how many directions.
_STEP, _ROUND, _NO_AREA = 2e-5, 64, 1e-9
_PLAY, _DIRECTIONS = 2.0, 8
# Poses this near are one [rad], this likely count, and this near are the same [rad].
_MERGED, _LIKELY, _NEAR = float(np.radians(10.0)), 0.05, float(np.radians(5.0))


def slot_clearance(estimate: trimesh.Trimesh, truth: trimesh.Trimesh, axis: int) -> float:
    """Return the least clearance of a slot, cut to an estimate's outline, that holds the truth [m].

    The outline is the shadow along a coordinate axis. The truth goes in where it is; in the slot,
    it can be moved by at most two clearances in any of eight directions.
    """
    said, true = _shadow(estimate, axis), _shadow(truth, axis)
    if said is None or true is None:
        return FAILED

    def fits(clearance: float, moved: FloatArray | None = None) -> bool:
        slot = said.offset(clearance, manifold3d.JoinType.Round, 2.0, _ROUND)
        part = true if moved is None else true.translate(tuple(moved))
        return bool((part - slot).area() < _NO_AREA)

    def holds(clearance: float) -> bool:
        angles = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
        limit = _PLAY * clearance + 1e-4
        ways = limit * np.column_stack([np.cos(angles), np.sin(angles)])
        return not any(fits(clearance, way) for way in ways)

    enough = _least(fits, 0.0, FAILED)
    return enough if enough >= FAILED or holds(enough) else _least(holds, enough, FAILED)


def _least(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Return the least number for which a monotone condition holds, by bisection; else `high`."""
    if holds(low):
        return low
    while high - low > _STEP:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def _shadow(mesh: trimesh.Trimesh, axis: int) -> manifold3d.CrossSection | None:
    """Return the shadow of a mesh along a coordinate axis; None if it is no solid."""
    turned = trimesh.Trimesh(np.roll(mesh.vertices, 2 - axis, axis=1), mesh.faces, process=False)
    solid = solid_of(turned)
    if solid.status() != manifold3d.Error.NoError or solid.is_empty():
        return None
    return solid.project().simplify(_STEP)


def wall_errors(estimate: trimesh.Trimesh, truth: trimesh.Trimesh, yaws: FloatArray) -> FloatArray:
    """Return by how much the estimate is too far out towards two walls at yaws [rad], (Y, 2) [m].

    The walls are upright and at right angles; negative is not far enough.
    """
    both = yaws[:, None] + np.array([0.0, 0.5 * np.pi])  # (Y, 2)
    towards = np.stack([np.cos(both), np.sin(both), 0.0 * both], axis=-1)
    reaches = [(towards @ mesh.vertices.T).max(axis=-1) for mesh in (estimate, truth)]
    return np.asarray(reaches[0] - reaches[1])


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class Surface:
    """A closed mesh, points spread over it by area, and where cups of a kind seal on them."""

    mesh: trimesh.Trimesh
    places: int
    cup: Cup
    seed: int

    @cached_property
    def tree(self) -> MeshTree:
        """The mesh's tree."""
        return MeshTree(self.mesh)

    @cached_property
    def samples(self) -> tuple[FloatArray, FloatArray]:
        """Points (P, 3) [m] and normals (P, 3)."""
        points, faces = trimesh.sample.sample_surface(self.mesh, self.places, seed=self.seed)
        return np.asarray(points), np.asarray(self.mesh.face_normals[faces])

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the nearest points (P, 3) [m] of the mesh, and the normals there (P, 3)."""
        _, faces, nearest = self.tree.nearest(points)
        return nearest, np.asarray(self.mesh.face_normals[faces])

    @cached_property
    def sealed(self) -> BoolArray:
        """Which samples a cup seals on, (P,)."""
        return self.seals(*self.samples)

    def seals(self, points: FloatArray, normals: FloatArray) -> BoolArray:
        """Return at which points (P, 3) [m] a cup, pressed against normals (P, 3), seals.

        See `press_cups`.
        """
        return press_cups(self.tree, points, normals, self.cup).sealed


def suction(estimate: Surface, truth: Surface, edges: FloatArray) -> dict[str, int]:
    """Return at how many places a cup seals: truly, and as the estimate says, and both.

    `edges` (E, 3) [m] are points of the true edges. `true` are places of the truth where a cup
    seals, `accepted` those of them where it seals on the estimate too; `said` are places of the
    estimate where it seals there, `kept` those where it truly does. Names that end in `_near` count
    places whose lip comes within 10 mm of an edge.
    """
    counts: dict[str, int] = {}
    for name, other, of, by in (
        ("true", "accepted", truth, estimate),
        ("said", "kept", estimate, truth),
    ):
        points, _ = of.samples
        points = points[of.sealed]
        both = by.seals(*by.nearest(points)) if len(points) else np.zeros(0, dtype=np.bool_)
        gap = np.full(len(points), np.inf)
        if len(points) and len(edges):
            gap = np.linalg.norm(points[:, None] - edges, axis=2).min(axis=1) - of.cup.radius
        near = gap < 0.01
        counts |= {name: len(points), other: int(both.sum())}
        counts |= {f"{name}_near": int(near.sum()), f"{other}_near": int((both & near).sum())}
    return counts


def standing(estimate: trimesh.Trimesh, truth: trimesh.Trimesh) -> dict[str, float]:
    """Return the share of true resting poses that are found, and how surely the object stands.

    `found` is the share of the truth's likely poses within 5 degrees of one of the estimate's;
    `stands` the probability that the truth, set down as one of the estimate's poses, by their
    probabilities, rests within 5 degrees of it.
    """
    said, true = (
        [pose for pose in resting_poses(mesh, merged=_MERGED) if pose.probability >= _LIKELY]
        for mesh in (estimate, truth)
    )
    downs = [-pose.rotation[2] for pose in said]
    found = [_is_near(-pose.rotation[2], downs) for pose in true]
    stands = [_is_near(rest_from(truth, down), [down]) for down in downs]
    weights = np.array([pose.probability for pose in said])
    return {
        "found": float(np.mean(found)) if found else 1.0,
        "stands": float(weights @ stands / weights.sum()) if said else 0.0,
    }


def _is_near(direction: FloatArray, others: Sequence[FloatArray]) -> bool:
    return any(
        np.linalg.norm(cross(direction, o)) < np.sin(_NEAR) and direction @ o > 0 for o in others
    )


def points_along(edges: FloatArray, step: float = 1e-3) -> FloatArray:
    """Return points along edges (E, 2, 3), about a step apart [m], shape (P, 3)."""
    parts = [np.empty((0, 3))]
    for start, end in edges:
        count = max(2, int(np.linalg.norm(end - start) / step))
        parts.append(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start))
    return np.concatenate(parts)


def surface_excess(estimate: Surface, truth: Surface, edges: FloatArray) -> dict[str, float]:
    """Return how far the estimate is beyond the truth, and how far the truth is from it [m].

    `beyond` is the 99 % quantile of the estimate's height above the truth, `beyond_3mm` the share
    of its surface more than 3 mm above; `rmsd` and `rmsd_truth_to_estimate` as everywhere, by
    samples; `edge_rmsd` from true edges to the estimate.
    """
    points, _ = estimate.samples
    squares, _, _ = truth.tree.nearest(points)
    inside = winding_numbers(points, truth.mesh.vertices, truth.mesh.faces) > 0.5
    heights = np.where(inside, -1.0, 1.0) * np.sqrt(squares)
    back, _, _ = estimate.tree.nearest(truth.samples[0])
    at_edges = estimate.tree.nearest(edges)[0] if len(edges) else np.zeros(1)
    return {
        "beyond": float(np.quantile(heights, 0.99)),
        "beyond_3mm": float((heights > 3e-3).mean()),
        "rmsd": float(np.sqrt(squares.mean())),
        "rmsd_truth_to_estimate": float(np.sqrt(back.mean())),
        "edge_rmsd": float(np.sqrt(at_edges.mean())),
    }


def extent_bands(estimate: trimesh.Trimesh, truth: trimesh.Trimesh) -> dict[str, float]:
    """Return the share of the six true extents inside the estimate's two standard deviations.

    `inside`, and the mean width of the bands, `band` [m]. A mesh without uncertainty has neither.
    """
    deviations = estimate.vertex_attributes.get("uncertainty")
    if deviations is None:
        return {}
    inside, widths = [], []
    for way in np.vstack([np.eye(3), -np.eye(3)]):
        heights = estimate.vertices @ way
        farthest = int(np.argmax(heights))
        deviation = float(deviations[farthest])
        error = float(heights[farthest] - (truth.vertices @ way).max())
        inside.append(abs(error) <= 2.0 * deviation)
        widths.append(4.0 * deviation)
    return {"inside": float(np.mean(inside)), "band": float(np.mean(widths))}
