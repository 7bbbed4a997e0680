"""Bodies beside the object, from the plant that has them."""

from __future__ import annotations

import tempfile
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    HalfSpace,
    Mesh,
    SceneGraph,
    SceneGraphInspector,
    Sphere,
)
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex, RigidBody
from pydrake.systems.framework import Context

from lis_grasp.exceptions import InvalidFileError, listed, note
from lis_grasp.geometry import inverse_pose
from lis_grasp.robots.link_bodies import load_link_mesh, primitive
from lis_grasp.robots.robot_model import Inertial, LinkGeometry
from lis_grasp.shapes.object_mass import USUAL_FRICTION
from lis_grasp.typing import FloatArray
from lis_grasp.world import Body, Surroundings

_TABLE = 1e-3  # a shape that is no higher above the table is a part of the table [m]


def surroundings_of(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    context: Context,
    *,
    without: Collection[str | ModelInstanceIndex] = (),
    table: float | None = 0.0,
) -> Surroundings:
    """Return the bodies of a finalized plant, at their present poses in its world frame.

    A floating body is free, with all that is welded to it. Bodies on joints are fixed where they
    are, with a warning. Bodies without collision geometry are left out.

    Parameters
    ----------
    plant, scene_graph, context
        The plant, its geometry, and the plant's own context.
    without
        Model instances that are left out, such as those of hand, arm and object: indices or names.
    table
        Height of the table [m]: shapes that are wholly at or below it are left out. None for none.

    Raises
    ------
    InvalidFileError
        If a body is deformable, a shape is of an unknown kind, or a free body has no mass.
    InvalidOptionError
        If there are more than 50 bodies or 200,000 triangles.

    Examples
    --------
    >>> builder = DiagramBuilder()
    >>> plant, graph = AddMultibodyPlantSceneGraph(builder, 0.002)
    >>> plant.Finalize()
    >>> len(surroundings_of(plant, graph, plant.CreateDefaultContext()))  # before Build()
    0
    """
    left_out = {n if isinstance(n, str) else plant.GetModelInstanceName(n) for n in without}
    reader = PlantBodies(plant, scene_graph, context)
    return reader.surroundings(left_out, np.eye(4), table)


@dataclass(frozen=True, slots=True)
class PlantBodies:
    """The bodies of a finalized plant in a context."""

    plant: MultibodyPlant
    scene_graph: SceneGraph
    context: Context

    def surroundings(
        self, without: Collection[str], X_WE: FloatArray, table: float | None
    ) -> Surroundings:
        """Return the bodies in a frame E of pose (4, 4) in the plant's world; see above."""
        jointed = self._jointed(without)
        if jointed:
            note(f"bodies on joints stay where they are, as fixed ones: {listed(jointed)}")
        X_EW, bodies, done = inverse_pose(X_WE), [], set[int]()
        floating = self.plant.GetFloatingBaseBodies()
        for body in map(self.plant.get_body, map(BodyIndex, range(self.plant.num_bodies()))):
            name, parts = self._name(body), [body]
            if int(body.index()) in done or self._instance(body) in without:
                continue
            is_free = body.index() in floating and name not in jointed
            if is_free:
                parts = self.plant.GetBodiesWeldedTo(body)
                done |= {int(part.index()) for part in parts}
            X_EB = X_EW @ body.EvalPoseInWorld(self.context).GetAsMatrix4()
            shapes = [pair for part in parts for pair in self._shapes(part, body, name)]
            shapes = [(g, mu) for g, mu in shapes if table is None or _rises(g, X_EB, table)]
            if shapes:
                friction = float(np.mean([mu for _, mu in shapes]))
                inertial = self._inertial(body, parts) if is_free else None
                bodies.append(Body(name, tuple(g for g, _ in shapes), X_EB, inertial, friction))
        return Surroundings(tuple(bodies))

    def count(self) -> int:
        """Return the number of bodies with collision geometry."""
        bodies = map(self.plant.get_body, map(BodyIndex, range(self.plant.num_bodies())))
        return sum(bool(self.plant.GetCollisionGeometriesForBody(body)) for body in bodies)

    def _instance(self, body: RigidBody) -> str:
        return str(self.plant.GetModelInstanceName(body.model_instance()))

    def _name(self, body: RigidBody) -> str:
        """Return the name of a body's model, with its own if the model has several bodies."""
        if body.index() == self.plant.world_body().index():
            return "world"
        is_alone = len(self.plant.GetBodyIndices(body.model_instance())) == 1
        return self._instance(body) if is_alone else f"{self._instance(body)}::{body.name()}"

    def _jointed(self, without: Collection[str]) -> list[str]:
        """Return the names of the bodies with shapes that joints other than floating ones move."""
        joints = [self.plant.get_joint(k) for k in self.plant.GetJointIndices()]
        moving = [j for j in joints if j.num_velocities() and not _is_floating(self.plant, j)]
        names = []
        for joint in moving:
            affected = self.plant.GetBodiesKinematicallyAffectedBy([joint.index()])
            parents = self.plant.GetBodiesWeldedTo(joint.parent_body())
            floating = self.plant.GetFloatingBaseBodies()
            bases = [body for body in parents if body.index() in floating]
            names += [self.plant.get_body(k) for k in affected] + bases
        return list(
            dict.fromkeys(
                self._name(body)
                for body in names
                if self.plant.GetCollisionGeometriesForBody(body)
                and self._instance(body) not in without
            )
        )

    def _shapes(
        self, part: RigidBody, body: RigidBody, name: str
    ) -> list[tuple[LinkGeometry, float]]:
        """Return the shapes of a part in a body's frame B, each with its friction."""
        inspector = self.scene_graph.model_inspector()
        X_BP = part.body_frame().CalcPose(self.context, body.body_frame()).GetAsMatrix4()
        shapes = []
        for geometry in self.plant.GetCollisionGeometriesForBody(part):
            shape = _shape(inspector, geometry, X_BP, name)
            if shape is not None:
                shapes.append((shape, _friction(inspector, geometry)))
        return shapes

    def _inertial(self, body: RigidBody, parts: list[RigidBody]) -> Inertial:
        """Return mass and inertia of a body with all that is welded to it, in its frame B."""
        indices = [part.index() for part in parts]
        inertia = self.plant.CalcSpatialInertia(self.context, body.body_frame(), indices)
        mass, center = float(inertia.get_mass()), np.array(inertia.get_com())
        if not mass > 0.0:
            name = self._name(body)
            raise InvalidFileError(
                f"a free body must have a mass above 0; {name} has {mass:g} kg: give its inertia,"
                " or weld it to the world"
            )
        matrix = inertia.Shift(center).CalcRotationalInertia().CopyToFullMatrix3()
        return Inertial(mass, center, np.asarray(matrix))


def _is_floating(plant: MultibodyPlant, joint: object) -> bool:
    """Return whether a joint is the six degrees of freedom of a floating body."""
    body = joint.child_body()  # type: ignore[attr-defined]
    return body.index() in plant.GetFloatingBaseBodies() and joint.num_velocities() == 6  # type: ignore[attr-defined]


def _shape(
    inspector: SceneGraphInspector, geometry: GeometryId, X_BP: FloatArray, name: str
) -> LinkGeometry | None:
    """Return a shape in B of a body's part P; None for a half space, which is a table or floor."""
    X_BG = X_BP @ inspector.GetPoseInFrame(geometry).GetAsMatrix4()
    shape = inspector.GetShape(geometry)
    if inspector.IsDeformableGeometry(geometry):
        raise InvalidFileError(f"the bodies of a world must be rigid; {name} is deformable")
    match shape:
        case Box():
            return primitive(name, X_BG, "box", shape.size())
        case Sphere():
            return primitive(name, X_BG, "sphere", [shape.radius()])
        case Cylinder():
            return primitive(name, X_BG, "cylinder", [shape.radius(), shape.length()])
        case Capsule():
            return primitive(name, X_BG, "capsule", [shape.radius(), shape.length()])
        case Ellipsoid():
            mesh = trimesh.creation.icosphere(subdivisions=3)
            mesh.apply_scale([shape.a(), shape.b(), shape.c()])
        case Mesh() | Convex():
            mesh = _mesh(shape)
            mesh = mesh.convex_hull if isinstance(shape, Convex) else mesh
        case HalfSpace():
            return None
        case _:
            raise InvalidFileError(
                f"the shapes of a world must be boxes, spheres, cylinders, capsules, ellipsoids or"
                f" meshes; body {name} has a {type(shape).__name__}: replace it"
            )
    return LinkGeometry(name, X_BG, "mesh", (), mesh)


def _mesh(shape: Mesh | Convex) -> trimesh.Trimesh:
    """Return the mesh of a shape, whose file is on disk or in memory."""
    source = shape.source()
    if source.is_path():
        return load_link_mesh(Path(source.path()), shape.scale3())
    file = source.in_memory().mesh_file
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"mesh{file.extension()}"
        path.write_bytes(file.contents())
        return load_link_mesh(path, shape.scale3())


def _rises(geometry: LinkGeometry, X_EB: FloatArray, table: float) -> bool:
    """Return whether a shape is higher than the table."""
    mesh = geometry.mesh.copy().apply_transform(X_EB @ geometry.X_LG)
    return bool(mesh.bounds[1, 2] > table + _TABLE)


def _friction(inspector: SceneGraphInspector, geometry: GeometryId) -> float:
    properties = inspector.GetProximityProperties(geometry)
    usual = CoulombFriction(USUAL_FRICTION, USUAL_FRICTION)
    return float(
        properties.GetPropertyOrDefault("material", "coulomb_friction", usual).static_friction()
    )
