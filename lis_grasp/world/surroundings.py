"""Records of the bodies beside the object, fixed or free, with their poses."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidOptionError, listed
from lis_grasp.geometry import apply_pose, inverse_pose
from lis_grasp.guesses import Answering, with_advice
from lis_grasp.io.option import place
from lis_grasp.records import FrozenArrays, reduce_record
from lis_grasp.robots.robot_model import Inertial, LinkGeometry
from lis_grasp.shapes.loading import FARTHEST_OBSTACLE
from lis_grasp.shapes.mesh_distance import InsideTest, MeshTree
from lis_grasp.shapes.object_mass import USUAL_FRICTION
from lis_grasp.typing import BoolArray, FloatArray

MOST_BODIES, MOST_TRIANGLES = 50, 200_000
"""Largest numbers of bodies, and of their triangles, in a world."""


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class Body(FrozenArrays):
    """A rigid body beside the object.

    Its frame B is that of its description, E the frame of the contacts.

    Examples
    --------
    >>> wall = Body.box("wall", (0.02, 0.4, 0.2), (0.15, 0.0, 0.1))
    >>> wall.is_fixed, wall.distances(np.array([[0.15, 0.0, 0.3]])).round(3).tolist()
    (True, [0.1])
    """

    name: str
    #: shapes with their poses in B; of kind ``mesh`` they may be open and concave
    geometries: tuple[LinkGeometry, ...]
    X_EB: FloatArray  #: (4, 4), its pose
    inertial: Inertial | None = None  #: of a free body, in B; None for a fixed one
    friction: float = USUAL_FRICTION  #: Coulomb's coefficient, with all that touches it

    @classmethod
    @with_advice
    def box(
        cls,
        name: str,
        sides: tuple[float, float, float],
        center: tuple[float, float, float],
        *,
        mass: float | None = None,
    ) -> Body:
        """Return a box of sides along E's axes about a centre [m]; with a mass [kg] it is free."""
        place("sides", sides), place("center", center)
        if min(sides) <= 0.0:
            raise InvalidOptionError.out_of_range("sides", sides, "above 0")
        reach = float(np.max(np.abs(center) + np.divide(sides, 2.0)))
        if reach > FARTHEST_OBSTACLE:
            raise InvalidOptionError(
                f"a body must be in metres, within {FARTHEST_OBSTACLE:g} m of the origin; {name}"
                f" reaches {reach:.3g}: divide sides and center by 1000 if they are in millimetres",
                option="sides",
                value=sides,
            )
        mesh = trimesh.creation.box(extents=sides)
        inertial = None
        if mass is not None:
            squares = np.square(sides)
            inertial = Inertial(mass, np.zeros(3), np.diag(mass / 12.0 * (squares.sum() - squares)))
        X_EB = np.eye(4)
        X_EB[:3, 3] = center
        return cls(name, (LinkGeometry(name, np.eye(4), "box", sides, mesh),), X_EB, inertial)

    @classmethod
    def of_mesh(cls, name: str, mesh: trimesh.Trimesh) -> Body:
        """Return a fixed body of a mesh in E [m], which may be open."""
        return cls(name, (LinkGeometry(name, np.eye(4), "mesh", (), mesh),), np.eye(4))

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return reduce_record(self)

    @property
    def is_fixed(self) -> bool:
        """Whether it cannot move."""
        return self.inertial is None

    @cached_property
    def mesh_B(self) -> trimesh.Trimesh:
        """All its shapes as one mesh in B [m]."""
        parts = [g.mesh.copy().apply_transform(g.X_LG) for g in self.geometries]
        joined: trimesh.Trimesh = trimesh.util.concatenate(parts)
        return joined

    @cached_property
    def mesh(self) -> trimesh.Trimesh:
        """All its shapes as one mesh in E [m]."""
        mesh: trimesh.Trimesh = self.mesh_B.copy()
        return mesh.apply_transform(self.X_EB)

    def displacement(self, X_EB: FloatArray) -> float:
        """Return the largest displacement of a point of it from another pose (4, 4) [m]."""
        vertices = np.asarray(self.mesh_B.vertices)
        apart = apply_pose(self.X_EB, vertices) - apply_pose(X_EB, vertices)
        return float(np.linalg.norm(apart, axis=1).max())

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the signed distances (P,) of points (P, 3) in E [m], below 0 inside.

        An open shape has no inside.
        """
        points_B = apply_pose(inverse_pose(self.X_EB), np.asarray(points, dtype=np.float64))
        distances = np.full(len(points_B), np.inf)
        for geometry, distance in self._queries:
            inside = apply_pose(inverse_pose(geometry.X_LG), points_B)
            distances = np.minimum(distances, distance(inside))
        return distances

    @cached_property
    def _queries(self) -> list[tuple[LinkGeometry, Callable[[FloatArray], FloatArray]]]:
        """The signed distance from each of its shapes, in the shape's frame."""
        return [(geometry, _distance_from(geometry)) for geometry in self.geometries]


def _distance_from(geometry: LinkGeometry) -> Callable[[FloatArray], FloatArray]:
    """Return the signed distance from a shape: of boxes and spheres exact, of others by a mesh."""
    if geometry.kind == "box":
        half = 0.5 * np.array(geometry.dimensions)
        return lambda points: _from_boxes(points, half)
    if geometry.kind == "sphere":
        radius = float(geometry.dimensions[0])
        return lambda points: np.linalg.norm(points, axis=1) - radius
    parts = geometry.mesh.split(only_watertight=True, repair=False)
    tree = MeshTree(geometry.mesh)
    if not len(parts):
        return lambda points: np.sqrt(tree.nearest(points)[0])
    test = InsideTest(trimesh.util.concatenate(parts))

    def distance(points: FloatArray) -> FloatArray:
        apart = np.sqrt(tree.nearest(points)[0])
        return np.where(test.inside(points), -apart, apart)

    return distance


def _from_boxes(points: FloatArray, half: FloatArray) -> FloatArray:
    """Return the signed distances (...) of points (..., 3) in the frames of boxes."""
    beyond = np.abs(points) - half
    outside = np.maximum(beyond, 0.0)
    x, y, z = np.moveaxis(beyond, -1, 0)
    inside = np.minimum(np.maximum(np.maximum(x, y), z), 0.0)
    return np.asarray(np.sqrt(np.einsum("...k,...k->...", outside, outside)) + inside)


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class Surroundings(Answering):
    """The bodies beside the object, with their poses in the frame E of the contacts.

    Raises `InvalidOptionError` if two bodies have the same name, or there are more than
    `MOST_BODIES` or `MOST_TRIANGLES`.

    Examples
    --------
    >>> corner = Surroundings((
    ...     Body.box("left", (0.02, 0.4, 0.2), (-0.15, 0.0, 0.1)),
    ...     Body.box("back", (0.4, 0.02, 0.2), (0.0, 0.15, 0.1)),
    ... ))
    >>> corner.whose(np.array([[-0.141, 0.0, 0.1], [0.0, 0.0, 0.1]]), band=0.003)
    ['left', None]
    """

    bodies: tuple[Body, ...] = ()

    def __post_init__(self) -> None:
        names = [body.name for body in self.bodies]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise InvalidOptionError(
                f"each body of a world must have a name of its own; two are called"
                f" {listed(twice)}: rename one",
                option="world",
            )
        triangles = sum(len(g.mesh.faces) for body in self.bodies for g in body.geometries)
        if len(names) > MOST_BODIES or triangles > MOST_TRIANGLES:
            raise InvalidOptionError(
                f"a world must have at most {MOST_BODIES} bodies and {MOST_TRIANGLES} triangles; it"
                f" has {len(names)} and {triangles}: leave out what is far, or simplify its meshes",
                option="world",
                value=max(len(names), triangles),
            )

    def __repr__(self) -> str:
        return f"Surroundings({listed([_in_words(body) for body in self.bodies]) or 'alone'})"

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return reduce_record(self)

    def __len__(self) -> int:
        return len(self.bodies)

    def __iter__(self) -> Iterator[Body]:
        return iter(self.bodies)

    @property
    def free(self) -> tuple[Body, ...]:
        """The bodies that may be pushed."""
        return tuple(body for body in self.bodies if not body.is_fixed)

    @property
    def digest(self) -> str:
        """A hash of all bodies and their poses; empty without any."""
        if not self.bodies:
            return ""
        hashed = hashlib.sha256()
        for body in self.bodies:
            for part in _content(body):
                hashed.update(part if isinstance(part, bytes) else repr(part).encode())
        return hashed.hexdigest()

    @cached_property
    def mesh(self) -> trimesh.Trimesh | None:
        """All bodies as one mesh in E [m]; None without any."""
        if not self.bodies:
            return None
        joined: trimesh.Trimesh = trimesh.util.concatenate([body.mesh for body in self.bodies])
        return joined

    def in_frame(self, X_EF: FloatArray) -> Surroundings:
        """Return the same in a frame F, whose pose in the present frame E is `X_EF` (4, 4)."""
        if np.array_equal(X_EF, np.eye(4)):
            return self
        X_FE = inverse_pose(X_EF)
        return self.placed({body.name: X_FE @ body.X_EB for body in self.bodies})

    def placed(self, poses: Mapping[str, FloatArray]) -> Surroundings:
        """Return the same with bodies at other poses (4, 4) in E, by their names.

        It is the record itself if none has moved.
        """
        moved = {b.name for b in self if not np.array_equal(poses.get(b.name, b.X_EB), b.X_EB)}
        if not moved:
            return self
        bodies = tuple(
            replace(body, X_EB=np.array(poses[body.name])) if body.name in moved else body
            for body in self.bodies
        )
        return replace(self, bodies=bodies)

    def distances(self, points: FloatArray) -> FloatArray:
        """Return signed distances (P, B) of points (P, 3) from each body [m], below 0 inside."""
        if self._boxes is not None:
            R, places, half = self._boxes
            return _from_boxes(np.matmul(points - places, R), half).T
        columns = [body.distances(points) for body in self.bodies]
        return np.stack(columns, axis=1) if columns else np.empty((len(points), 0))

    @cached_property
    def _boxes(self) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Rotations (B, 3, 3), places (B, 1, 3) and half sides of bodies that all are one box."""
        shapes = [body.geometries for body in self.bodies]
        if not shapes or any(len(of) != 1 or of[0].kind != "box" for of in shapes):
            return None
        X = np.array([body.X_EB @ of[0].X_LG for body, of in zip(self.bodies, shapes, strict=True)])
        half = np.array([0.5 * np.array(of[0].dimensions) for of in shapes])
        return X[:, :3, :3], X[:, None, :3, 3], half[:, None]

    def contain(self, points: FloatArray, *, margin: float = 0.0) -> BoolArray:
        """Return which points (P, 3) are in a body, or within a margin [m] of one, (P,)."""
        return np.asarray((self.distances(points) < margin).any(axis=1))

    def whose(self, points: FloatArray, *, band: float) -> list[str | None]:
        """Return for each point (P, 3) the nearest body within a band [m], None if none is."""
        distances = np.abs(self.distances(points))
        if not len(self.bodies):
            return [None] * len(points)
        nearest = distances.argmin(axis=1)
        return [
            self.bodies[k].name if row[k] <= band else None
            for k, row in zip(nearest, distances, strict=True)
        ]


def _content(body: Body) -> Iterator[bytes | str | float | tuple[Any, ...]]:
    yield from (body.name, body.friction, body.X_EB.tobytes())
    if body.inertial is not None:
        yield body.inertial.mass
        yield from (body.inertial.center_L.tobytes(), body.inertial.inertia_L.tobytes())
    for geometry in body.geometries:
        yield from (geometry.kind, tuple(map(float, geometry.dimensions)), geometry.X_LG.tobytes())
        yield from (geometry.mesh.vertices.tobytes(), geometry.mesh.faces.tobytes())


ALONE = Surroundings()
"""No other body: the object is alone on its table."""


def _in_words(body: Body) -> str:
    """Return a body's name, whether it is fixed, and the kinds of its shapes."""
    kinds = Counter(geometry.kind for geometry in body.geometries)
    shapes = " and ".join(kind if n == 1 else f"{n} x {kind}" for kind, n in kinds.items())
    return f"{body.name}: {'fixed' if body.is_fixed else 'free'} {shapes}"
