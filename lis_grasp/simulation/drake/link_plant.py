"""Links of hands and arms in a Drake plant: bodies, joints, compliant skin, and visuals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import trimesh
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    Box,
    Capsule,
    Convex,
    Cylinder,
    GeometryId,
    Mesh,
    ProximityProperties,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Joint,
    ModelInstanceIndex,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.framework import Context

from lis_grasp.robots.inertias import LEAST_MASS
from lis_grasp.robots.link_bodies import load_visual
from lis_grasp.robots.robot_model import Inertial, LinkGeometry, RobotModel
from lis_grasp.robots.robot_model import Joint as TreeJoint
from lis_grasp.simulation.drake.object_plant import in_memory, spatial_inertia
from lis_grasp.typing import FloatArray

_GREY = (0.6, 0.6, 0.63, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class LinksInPlant:
    """Bodies and joints that `add_links` has added to a plant."""

    instance: ModelInstanceIndex  # actuators and desired states in the order of `joints`
    bodies: Mapping[str, RigidBody]  # by link
    joints: tuple[Joint, ...]  # actuated, in the order of the tree's
    followers: tuple[tuple[Joint, TreeJoint], ...]  # coupled to actuated joints

    def set_positions(self, plant_context: Context, q: FloatArray) -> None:
        """Set the joints and their followers to positions q, shape (J,), at rest."""
        followed = [(joint, float(follower.position(q))) for joint, follower in self.followers]
        for joint, position in [*zip(self.joints, q, strict=True), *followed]:
            if isinstance(joint, RevoluteJoint):
                joint.set_angle(plant_context, position)
                joint.set_angular_rate(plant_context, 0.0)
            else:
                joint.set_translation(plant_context, position)
                joint.set_translation_rate(plant_context, 0.0)

    def X_WL(self, plant_context: Context, link: str) -> FloatArray:
        """Return the pose of a link, shape (4, 4)."""
        pose: FloatArray = self.bodies[link].EvalPoseInWorld(plant_context).GetAsMatrix4()
        return pose


def add_links(
    plant: MultibodyPlant, tree: RobotModel, instance: ModelInstanceIndex
) -> LinksInPlant:
    """Add the links and joints of a hand or an arm, without motors; its root gets no joint.

    Joints have limits and no damping. Joints that follow another are not coupled to it yet.
    """
    bodies = {
        link: plant.AddRigidBody(link, instance, _spatial_inertia(tree.inertials.get(link)))
        for link in tree.links
    }
    joints: dict[int, Joint] = {}
    followers: list[tuple[Joint, TreeJoint]] = []
    for joint in tree.joints:
        parent, child = bodies[joint.parent], bodies[joint.child]
        frame = plant.AddFrame(
            FixedOffsetFrame(
                f"{joint.name}_frame", parent.body_frame(), RigidTransform(joint.X_PJ), instance
            )
        )
        if joint.kind == "fixed":
            plant.WeldFrames(frame, child.body_frame())
            continue
        kind = RevoluteJoint if joint.kind == "revolute" else PrismaticJoint
        if joint.follows:
            follower = kind(joint.name, frame, child.body_frame(), joint.axis_J)
            followers.append((plant.AddJoint(follower), joint))
            continue
        i = joint.index
        limits = tree.lower[i], tree.upper[i], 0.0  # and damping
        joints[i] = plant.AddJoint(
            kind(joint.name, frame, child.body_frame(), joint.axis_J, *limits)
        )
    ordered = tuple(joints[i] for i in range(len(joints)))
    return LinksInPlant(instance, bodies, ordered, tuple(followers))


def add_skin(
    plant: MultibodyPlant, tree: RobotModel, links: LinksInPlant, *, friction: float, modulus: float
) -> dict[GeometryId, str]:
    """Add compliant collision bodies of a modulus [Pa], and return the link of each."""
    link_of_geometry = {}
    for number, geometry in enumerate(tree.link_geometries):
        identity = plant.RegisterCollisionGeometry(
            links.bodies[geometry.link],
            RigidTransform(geometry.X_LG),
            _collision_shape(geometry),
            f"{geometry.link}_{number}",
            _compliant(geometry, friction, modulus),
        )
        link_of_geometry[identity] = geometry.link
    return link_of_geometry


def add_visuals(plant: MultibodyPlant, tree: RobotModel, links: LinksInPlant) -> None:
    """Add what the links of a hand or an arm look like; those without a look, their bodies."""
    seen = set()
    for number, visual in enumerate(tree.visuals):
        mesh = load_visual(visual)
        if mesh is not None:
            seen.add(visual.link)
            plain = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
            shape = Mesh(in_memory(plain, visual.link))
            _show(plant, links, visual.link, visual.X_LG, shape, number)
    for number, geometry in enumerate(tree.link_geometries):
        if geometry.link not in seen:
            shape = _collision_shape(geometry)
            _show(plant, links, geometry.link, geometry.X_LG, shape, number)


def _show(
    plant: MultibodyPlant,
    links: LinksInPlant,
    link: str,
    X_LG: FloatArray,
    shape: Shape,
    number: int,
) -> None:
    name = f"{link}_visual_{number}"
    plant.RegisterVisualGeometry(links.bodies[link], RigidTransform(X_LG), shape, name, _GREY)


def _collision_shape(geometry: LinkGeometry) -> Shape:
    """Return Drake's shape of a collision body; a mesh is convex."""
    if geometry.kind == "mesh":
        return Convex(in_memory(geometry.mesh, geometry.link))
    return primitive_shape(geometry)


def primitive_shape(geometry: LinkGeometry) -> Shape:
    """Return Drake's shape of a collision body that is no mesh."""
    primitives = {"box": Box, "sphere": Sphere, "cylinder": Cylinder, "capsule": Capsule}
    return primitives[geometry.kind](*geometry.dimensions)


def _compliant(geometry: LinkGeometry, friction: float, modulus: float) -> ProximityProperties:
    """Return the properties of a compliant skin: Coulomb friction and hydroelastic modulus [Pa]."""
    properties = ProximityProperties()
    AddContactMaterial(
        dissipation=10.0, friction=CoulombFriction(friction, friction), properties=properties
    )
    smallest = (
        min(geometry.dimensions) if geometry.dimensions else float(geometry.mesh.extents.min())
    )
    AddCompliantHydroelasticProperties(
        resolution_hint=0.5 * smallest, hydroelastic_modulus=modulus, properties=properties
    )
    return properties


def _spatial_inertia(inertial: Inertial | None) -> SpatialInertia:
    # A link without inertia needs a mass for the solver: a gram on a hand of a kilogram.
    if inertial is None or inertial.mass < LEAST_MASS:
        return SpatialInertia(LEAST_MASS, np.zeros(3), UnitInertia.SolidSphere(0.01))
    return spatial_inertia(inertial.mass, inertial.center_L, inertial.inertia_L)
