"""Links and joints of a hand or an arm in a Drake plant, before control and skin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import Box, Capsule, Convex, Cylinder, InMemoryMesh, Shape, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
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

from lis_grasp.robots.hand_parts import Inertial, LinkGeometry
from lis_grasp.robots.hand_parts import Joint as TreeJoint
from lis_grasp.robots.inertias import LEAST_MASS
from lis_grasp.robots.link_tree import HandModel
from lis_grasp.simulation.drake.object_plant import spatial_inertia
from lis_grasp.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class LinksInPlant:
    """Bodies and joints that `add_links` has added to a plant."""

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


def add_links(plant: MultibodyPlant, tree: HandModel, instance: ModelInstanceIndex) -> LinksInPlant:
    """Add the links and joints of a tree; its root gets no joint.

    Joints have limits and no damping. Joints that follow another get a joint and, by
    `couple_followers`, a constraint.
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
    return LinksInPlant(bodies, ordered, tuple(followers))


def couple_followers(plant: MultibodyPlant, added: LinksInPlant) -> None:
    """Constrain the joints that follow another to it."""
    for follower, joint in added.followers:
        plant.AddCouplerConstraint(
            follower, added.joints[joint.index], joint.multiplier, joint.offset
        )


def collision_shape(geometry: LinkGeometry) -> Shape:
    """Return Drake's shape of a collision body; a mesh is convex."""
    if geometry.kind == "mesh":
        obj = geometry.mesh.export(file_type="obj", include_normals=False)
        return Convex(InMemoryMesh(mesh_file=MemoryFile(obj.encode(), ".obj", geometry.link)))
    primitives = {"box": Box, "sphere": Sphere, "cylinder": Cylinder, "capsule": Capsule}
    return primitives[geometry.kind](*geometry.dimensions)


def _spatial_inertia(inertial: Inertial | None) -> SpatialInertia:
    # A link without inertia needs a mass for the solver: a gram on a hand of a kilogram.
    if inertial is None or inertial.mass < LEAST_MASS:
        return SpatialInertia(LEAST_MASS, np.zeros(3), UnitInertia.SolidSphere(0.01))
    return spatial_inertia(inertial.mass, inertial.center_L, inertial.inertia_L)
