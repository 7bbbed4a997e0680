"""Outline of an estimated object: its silhouette, bounds of it, and the clearance of a cut-out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import manifold3d
import numpy as np
import numpy.typing as npt
import shapely
import trimesh
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from lis_grasp.exceptions import InvalidMeshError, InvalidOptionError
from lis_grasp.geometry import tangent_frame, unit
from lis_grasp.guesses import with_advice
from lis_grasp.records import Record
from lis_grasp.shapes import resting_poses
from lis_grasp.shapes.solids import solid_of
from lis_grasp.typing import FloatArray

Axis = Literal["x", "y", "z"]

AXES: tuple[Axis, ...] = ("x", "y", "z")
"""Coordinate axes by name."""

USUAL_PROBABILITY = 0.9
"""Of bounds, if none is wanted."""

# Detail that a silhouette loses, the spacing of its points, and how near to it a vertex of the
# mesh is part of it [m].
_SIMPLER, _SPACING, _NEAR = 2e-5, 1e-3, 1.5e-3

# Quantiles over development objects of what the outline must grow, and shrink, to contain the true
# one, and to be inside of it, in mean deviations along the silhouette.
PROBABILITIES = (0.5, 0.8, 0.9, 0.95)
_GROW = (1.72, 3.35, 4.35, 5.66)
_SHRINK = (2.61, 4.33, 5.56, 8.88)

_SIDES = 16  # of a quarter of a round corner


@dataclass(frozen=True, slots=True, eq=False)
class Outline(Record):
    """The silhouette of an object along a direction, in the plane x, y of a frame P [m].

    Each is a polygon of Shapely, or several, with holes. The true outline is inside of `outer` with
    a probability, and contains `inner` with the same.
    """

    polygon: BaseGeometry  #: of the estimate
    inner: BaseGeometry  #: part of the true outline
    outer: BaseGeometry  #: contains the true outline: the cut-out to make
    clearance: float  #: by which `outer` is larger [m]
    probability: float  #: of each bound
    rotation: FloatArray  #: (3, 3), R_PO: its last row is the direction, towards the viewer


@with_advice
def outline(
    mesh: trimesh.Trimesh,
    axis: Axis | npt.ArrayLike = "z",
    *,
    pose: int | None = None,
    clearance_for: float = USUAL_PROBABILITY,
) -> Outline:
    """Return the outline of an estimate, with the clearance of a cut-out that lets the object in.

    It grows by the mean standard deviation along the silhouette, times the quantile of what this
    took on development objects with `blend` (conformal prediction, Vovk et al. 2005).
    `polygon`, `inner` and `outer` of the result are polygons of Shapely.

    Parameters
    ----------
    mesh
        Closed, in O [m]; without the vertex attribute ``"uncertainty"`` [m] it is exact.
    axis
        Direction of view: a coordinate axis, from its end, or a vector (3,). Along z the plane is
        x, y; along x it is y, z; along y it is z, x.
    pose
        In place of an axis: number of a resting pose, from 0, the likeliest (`resting_poses`);
        the view is from above.
    clearance_for
        Probability that the object goes in, from 0.5 to 0.95.

    Raises
    ------
    InvalidOptionError
        If a value is out of range.
    InvalidMeshError
        If the mesh is not closed.

    Examples
    --------
    >>> box = shapes.find("box").mesh
    >>> found = outline(box)
    >>> bool(np.isclose(found.polygon.area, np.prod(box.extents[:2])))
    True
    >>> found.clearance
    0.0
    """
    if not PROBABILITIES[0] <= clearance_for <= PROBABILITIES[-1]:
        required = f"from {PROBABILITIES[0]} to {PROBABILITIES[-1]}"
        raise InvalidOptionError.out_of_range("clearance_for", clearance_for, required)
    R_PO = _rotation(mesh, axis, pose)
    polygon = silhouette(mesh, R_PO)
    deviation = silhouette_deviation(mesh, polygon, R_PO)
    grow, shrink = scales(clearance_for)
    clearance = grow * deviation
    return Outline(
        polygon,
        polygon.buffer(-shrink * deviation, quad_segs=_SIDES),
        polygon.buffer(clearance, quad_segs=_SIDES),
        clearance,
        clearance_for,
        R_PO,
    )


def scales(probability: float) -> tuple[float, float]:
    """Return by how many mean deviations an outline grows, and shrinks, to its bounds."""
    grow, shrink = (np.interp(probability, PROBABILITIES, q) for q in (_GROW, _SHRINK))
    return float(grow), float(shrink)


def silhouette(mesh: trimesh.Trimesh, R_PO: FloatArray) -> BaseGeometry:
    """Return the shadow of a closed mesh on the plane x, y of a frame P, given R_PO (3, 3) [m].

    Raises `InvalidMeshError` if the mesh is not that of a solid.
    """
    solid = solid_of(trimesh.Trimesh(mesh.vertices @ R_PO.T, mesh.faces, process=False))
    if solid.status() != manifold3d.Error.NoError or solid.is_empty():
        raise InvalidMeshError("an outline needs a closed mesh; this one has holes: repair it")
    found: BaseGeometry = shapely.Polygon()
    for loop in solid.project().simplify(_SIMPLER).to_polygons():
        if len(loop) > 2:  # a hole is inside of an even number of loops
            found = found.symmetric_difference(shapely.Polygon(loop).buffer(0.0))
    return found


def silhouette_deviation(mesh: trimesh.Trimesh, polygon: BaseGeometry, R_PO: FloatArray) -> float:
    """Return the mean standard deviation of an estimate along its silhouette [m].

    At each point it is the least of the vertices above and below: where a wall was touched anywhere
    along the direction of view, its place in the outline is known.
    """
    deviations = mesh.vertex_attributes.get("uncertainty")
    if deviations is None:
        return 0.0
    flat = (mesh.vertices @ R_PO.T)[:, :2]
    points = shapely.get_coordinates(shapely.segmentize(polygon.boundary, _SPACING))
    tree = cKDTree(flat)
    _, nearest = tree.query(points)
    near = tree.query_ball_point(points, _NEAR)
    least = [np.min(deviations[[n, *of]]) for n, of in zip(nearest, near, strict=True)]
    return float(np.mean(least))


def needed(outline_: BaseGeometry, truth: BaseGeometry) -> tuple[float, float]:
    """Return by how much an outline must grow to contain another, and shrink to be in it [m]."""
    found = []
    for inside, around in ((truth, outline_), (outline_, truth)):
        points = shapely.points(shapely.get_coordinates(inside.segmentize(_SPACING)))
        found.append(float(shapely.distance(points, around).max()))
    return found[0], found[1]


def _rotation(mesh: trimesh.Trimesh, axis: Axis | npt.ArrayLike, pose: int | None) -> FloatArray:
    """Return R_PO of the view along an axis, or of the view from above in a resting pose."""
    if pose is not None:
        poses = resting_poses(mesh)
        if not 0 <= pose < len(poses):
            required = f"the number of a resting pose, 0 to {len(poses) - 1}"
            raise InvalidOptionError.out_of_range("pose", pose, required)
        return poses[pose].rotation
    if isinstance(axis, str):
        if axis not in AXES:
            raise InvalidOptionError.not_one_of("axis", axis, AXES)
        return np.roll(np.eye(3), -(AXES.index(axis) + 1), axis=0)
    vector = np.asarray(axis, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        required = f"one of {', '.join(AXES)}, or three finite numbers that are not all 0"
        raise InvalidOptionError.out_of_range("axis", axis, required)
    one, two = tangent_frame(unit(vector))
    return np.stack([one, two, unit(vector)])


def rings_of(polygon: BaseGeometry) -> Sequence[FloatArray]:
    """Return the corners (N, 2) of each closed ring, outer ones and holes; none is repeated [m]."""
    lines = shapely.get_parts(polygon.boundary)
    return [np.asarray(line.coords)[:-1] for line in lines if len(line.coords) > 3]
