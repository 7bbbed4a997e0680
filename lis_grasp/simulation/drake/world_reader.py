"""Reader of the bodies beside the object: model directives, models, meshes, and Drake plants."""

from __future__ import annotations

from collections.abc import Collection
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
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody
from pydrake.systems.framework import Context, DiagramBuilder

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.robots.link_bodies import load_link_mesh, primitive
from lis_grasp.robots.robot_model import Inertial, LinkGeometry
from lis_grasp.shapes.loading import load_obstacles
from lis_grasp.shapes.object_mass import USUAL_FRICTION
from lis_grasp.world import Body, Surroundings

_MODELS = (".yaml", ".yml", ".sdf", ".urdf", ".xml")
_TABLE = 1e-3  # a shape that is no higher above the table is a part of the table [m]


def load_surroundings(path: str | Path) -> Surroundings:
    """Return the bodies of a file in its world frame, whose plane z = 0 is the table.

    The file has model directives, a model (SDF, URDF, MJCF), or a mesh [m], which is one fixed body
    and may be open. Shapes that are wholly at or below the table are left out.

    Raises `InvalidFileError` and `InvalidMeshError` if the file cannot be used.
    """
    path = Path(path)
    if path.suffix.lower() not in _MODELS:
        return Surroundings((Body.of_mesh(path.stem, load_obstacles(path)),))
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
    try:
        Parser(plant).AddModels(str(path))
    except RuntimeError as error:
        reason = str(error).splitlines()[0]
        message = f"{path} must have models that Drake reads: {reason}"
        raise InvalidFileError(message, path=path) from None
    plant.Finalize()
    diagram = builder.Build()
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    return surroundings_of(plant, scene_graph, context)


def surroundings_of(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    context: Context,
    *,
    without: Collection[str] = (),
) -> Surroundings:
    """Return the bodies of a finalized plant at their present poses in its world frame.

    Bodies on joints are fixed where they are; floating ones are free. Model instances `without`,
    such as a robot, and bodies without collision geometry are left out.
    """
    inspector, floating = scene_graph.model_inspector(), plant.GetFloatingBaseBodies()
    bodies = []
    for body in (plant.get_body(BodyIndex(k)) for k in range(plant.num_bodies())):
        instance = plant.GetModelInstanceName(body.model_instance())
        alone = plant.num_bodies() and len(plant.GetBodyIndices(body.model_instance())) == 1
        name = instance if alone else f"{instance}::{body.name()}"
        X_WB = np.asarray(body.EvalPoseInWorld(context).GetAsMatrix4())
        ids = [] if instance in without else plant.GetCollisionGeometriesForBody(body)
        shapes = [_shape(inspector, geometry, name) for geometry in ids]
        geometries = tuple(g for g in shapes if g is not None and _rises(g, X_WB))
        if geometries:
            friction = float(np.mean([_friction(inspector, geometry) for geometry in ids]))
            inertial = _inertial(body) if body.index() in floating else None
            bodies.append(Body(name, geometries, X_WB, inertial, friction))
    return Surroundings(tuple(bodies))


def _shape(inspector: SceneGraphInspector, geometry: GeometryId, name: str) -> LinkGeometry | None:
    """Return a shape of a body; None for a half space, which is a table or floor."""
    shape, X_BG = inspector.GetShape(geometry), inspector.GetPoseInFrame(geometry).GetAsMatrix4()
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
            mesh = load_link_mesh(Path(shape.source().path()), shape.scale3())
            mesh = mesh.convex_hull if isinstance(shape, Convex) else mesh
        case HalfSpace():
            return None
        case _:
            raise InvalidFileError(
                f"the shapes of a world must be boxes, spheres, cylinders, capsules, ellipsoids or"
                f" meshes; body {name} has a {type(shape).__name__}: replace it"
            )
    return LinkGeometry(name, X_BG, "mesh", (), mesh)


def _rises(geometry: LinkGeometry, X_WB: np.ndarray) -> bool:
    """Return whether a shape is higher than the table."""
    mesh = geometry.mesh.copy().apply_transform(X_WB @ geometry.X_LG)
    return bool(mesh.bounds[1, 2] > _TABLE)


def _friction(inspector: SceneGraphInspector, geometry: GeometryId) -> float:
    properties = inspector.GetProximityProperties(geometry)
    usual = CoulombFriction(USUAL_FRICTION, USUAL_FRICTION)
    return float(
        properties.GetPropertyOrDefault("material", "coulomb_friction", usual).static_friction()
    )


def _inertial(body: RigidBody) -> Inertial:
    inertia = body.default_spatial_inertia()
    center = np.array(inertia.get_com())
    matrix = inertia.Shift(center).CalcRotationalInertia().CopyToFullMatrix3()
    return Inertial(float(inertia.get_mass()), center, np.asarray(matrix))
