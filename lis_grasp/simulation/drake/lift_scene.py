"""Drake scene of a lift: a free object on a table, and a carried hand."""

from __future__ import annotations

import numpy as np
import trimesh
from pydrake.geometry import CollisionFilterDeclaration, FilterId, GeometrySet
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from lis_grasp.exceptions import SimulationError
from lis_grasp.geometry import apply_pose, inverse_pose, rotate
from lis_grasp.lifting.lift_gains import finger_gains
from lis_grasp.lifting.lift_setup import LiftSetup
from lis_grasp.lifting.lifting_scene import CarrierMotion
from lis_grasp.lifting.wrist_trajectory import WristPath
from lis_grasp.motion import OBJECT
from lis_grasp.shapes.solids import merge_flat_faces, split_large_faces
from lis_grasp.simulation.drake.advance_simulation import advance
from lis_grasp.simulation.drake.arm_carrier import ArmCarrier
from lis_grasp.simulation.drake.carrier import Carrier
from lis_grasp.simulation.drake.contact_patches import LinkContact, link_contacts
from lis_grasp.simulation.drake.free_wrist import FreeWrist
from lis_grasp.simulation.drake.hand_plant import (
    LIFTING_SKIN,
    add_hand,
    ignore_self_collision,
)
from lis_grasp.simulation.drake.object_plant import add_object, add_support, add_table, let_rest
from lis_grasp.typing import FloatArray

# An object farther than this from the origin gets a body frame of its own [m].
_FAR = 0.25
# Length and width of the object's largest triangles [m]. Drake bounds up to three triangles by one
# box: around larger ones of several faces, it contains nearly all of a fingertip, which is then
# clipped by each of them.
_LONGEST, _WIDEST = 0.1, 0.03
# Speed up to which Drake regularises friction, so that held objects creep [m/s]. At Drake's default
# of 1e-4 a screwdriver between two flat pads turns by 1.2 deg/s, far below the limit of friction.
# At 1e-5 it turns by 0.25 deg/s; below, nothing changes.
_STICTION_TOLERANCE = 1e-5


class LiftScene:
    """A Drake simulation of hand, object and table, advanced one time step at a time.

    The world frame W is the object's frame O in which the grasp was planned. All contacts are
    hydroelastic: the object is its exact rigid mesh, never its hull; the hand's links and the table
    are compliant. The hand's links do not collide with each other. A carrier moves the hand.
    """

    def __init__(self, setup: LiftSetup) -> None:
        hand, mesh, friction = setup.hand, setup.mesh, setup.friction
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlant(
            MultibodyPlantConfig(
                time_step=setup.options.time_step,
                contact_model="hydroelastic_with_fallback",
                discrete_contact_approximation="lagged",
                stiction_tolerance=_STICTION_TOLERANCE,
            ),
            builder,
        )
        self._plant = plant
        self._time_step = setup.options.time_step
        stiffness, damping = finger_gains(hand, setup.grasp)
        self._hand = add_hand(
            plant,
            hand,
            stiffness=stiffness,
            damping=damping,
            friction=friction,
            hydroelastic_modulus=LIFTING_SKIN,
        )
        X_WB = np.asarray(setup.grasp.X_OH, dtype=np.float64) @ inverse_pose(hand.X_LH)
        self.carrier: Carrier = (
            FreeWrist(plant, self._hand, X_WB)
            if setup.arm is None
            else ArmCarrier(plant, self._hand, setup.arm, X_WB, setup.grasp.pregrasp_positions)
        )
        instance = plant.AddModelInstance(OBJECT)
        body_mesh, self._p_OB = _near_its_frame(mesh)
        self._object, self._object_geometry = add_object(
            plant,
            split_large_faces(merge_flat_faces(body_mesh), longest=_LONGEST, widest=_WIDEST),
            mass=setup.mass,
            friction=friction,
            instance=instance,
        )
        self._vertices = np.asarray(mesh.convex_hull.vertices)  # the lowest one is a hull vertex
        self._center = np.asarray(mesh.center_mass)
        height = setup.support_height
        table = add_table(plant, height, friction, under=mesh)
        self._support = add_support(plant, height, friction, under=mesh, mass=setup.mass)
        plant.Finalize()
        ignore_self_collision(scene_graph, self._hand)
        let_rest(scene_graph, self._object_geometry, support=self._support, table=table)
        # Drake gives a body without a joint this one: six degrees of freedom.
        (joint,) = plant.GetJointIndices(instance)
        self._object_joint = plant.get_joint(joint)
        self._diagram = builder.Build()
        root = self._diagram.CreateDefaultContext()
        self._context = plant.GetMyMutableContextFromRoot(root)
        X_WB = RigidTransform(setup.X_WO) @ RigidTransform(self._p_OB)
        plant.SetFreeBodyPose(self._context, self._object, X_WB)
        self._simulator = Simulator(self._diagram, root)
        self._filters = scene_graph.collision_filter_manager(
            scene_graph.GetMyMutableContextFromRoot(root)
        )
        self._resting: FilterId | None = None
        self._steps = 0
        self._fingers_port = plant.get_desired_state_input_port(self._hand.instance)
        self._efforts_port = plant.get_actuation_input_port(self._hand.instance)
        self.carrier.connect(self._context, self._filters, self._object, table)
        self._carries_weight = setup.arm is not None
        self._velocity_columns = [joint.velocity_start() for joint in self._hand.joints]

    @property
    def time(self) -> float:
        """Simulated time since the start [s]."""
        return self._steps * self._time_step

    @property
    def steps(self) -> int:
        """Time steps since the start."""
        return self._steps

    def place_hand(self, displacement: FloatArray, q: FloatArray) -> None:
        """Set the palm to a displacement (6,) from the grasp and the joints to q, at rest."""
        self.carrier.place(displacement)
        self._hand.set_joint_positions(self._context, q)
        self.command_fingers(q, np.zeros(len(q)))

    def follow(self, path: WristPath, duration: float) -> CarrierMotion:
        """Return the palm's motion along a path of a duration [s]; an arm may take longer."""
        return self.carrier.follow(path, duration)

    def command_fingers(self, q: FloatArray, efforts: FloatArray) -> None:
        """Command joint positions q, shape (J,), and efforts (J,) on top of the springs'."""
        self._fingers_port.FixValue(self._context, np.concatenate([q, np.zeros(len(q))]))
        if self._carries_weight:
            efforts = efforts + self._hand.weight_efforts(self._plant, self._context)
        self._efforts_port.FixValue(self._context, efforts)

    def rest_object(self) -> None:
        """Lock the object until the hand touches it.

        It does not move by itself, and its contact with the support, the costliest one, need not be
        computed until then.
        """
        # Drake 1.51 crashes on contact between a locked body and the world: exclude it.
        self._resting = self._filters.ApplyTransient(
            CollisionFilterDeclaration().ExcludeBetween(
                GeometrySet([self._object_geometry]), GeometrySet([self._support])
            )
        )
        self._object_joint.Lock(self._context)

    def step(self) -> None:
        """Advance by one time step.

        Raises
        ------
        SimulationError
            If Drake could not take the step, or the object's pose is no longer finite.
        """
        self._steps += 1
        advance(self._simulator, self.time, of="a lift")
        if not np.isfinite(self._plant.GetPositions(self._context)).all():
            raise SimulationError(f"a lift diverged at {self.time:.3f} s")
        if self._resting is not None and self.contacts():
            self._filters.RemoveDeclaration(self._resting)
            self._object_joint.Unlock(self._context)
            self._resting = None

    @property
    def joint_positions(self) -> FloatArray:
        """Joint positions, shape (J,)."""
        return self._hand.joint_positions(self._context)

    @property
    def X_WH(self) -> FloatArray:
        """Pose of the palm, shape (4, 4)."""
        return self._hand.X_WH(self._context)

    @property
    def X_WO(self) -> FloatArray:
        """Pose of the object, shape (4, 4)."""
        X_WO: FloatArray = self._object.EvalPoseInWorld(self._context).GetAsMatrix4()
        X_WO[:3, 3] -= rotate(X_WO, self._p_OB)
        return X_WO

    @property
    def object_center(self) -> FloatArray:
        """The object's centre of mass, shape (3,) [m]."""
        return apply_pose(self.X_WO, self._center)

    @property
    def object_bottom(self) -> float:
        """Height of the object's lowest point [m]."""
        X_WO = self.X_WO
        return float((self._vertices @ X_WO[2, :3]).min() + X_WO[2, 3])

    def poses(self) -> dict[str, FloatArray]:
        """Return the pose of every hand link, the object and an arm's links, each (4, 4)."""
        links = {name: self.X_WL(name) for name in self._hand.bodies}
        return {**links, OBJECT: self.X_WO, **self.carrier.poses()}

    def contacts(self) -> list[LinkContact]:
        """Return the contacts of the hand with the object, in a fixed order."""
        results = self._plant.get_contact_results_output_port().Eval(self._context)
        return link_contacts(results, self._object_geometry, self._hand.link_of_geometry)

    def jacobian(self, link: str, p_L: FloatArray) -> FloatArray:
        """Return the Jacobian of a point p_L of a link with respect to the joints, shape (3, J).

        Joints that follow another by a transmission move with it.
        """
        world = self._plant.world_frame()
        every: FloatArray = self._plant.CalcJacobianTranslationalVelocity(
            self._context,
            JacobianWrtVariable.kV,
            self._hand.bodies[link].body_frame(),
            p_L,
            world,
            world,
        )
        columns: FloatArray = every[:, self._velocity_columns]
        for follower, joint in self._hand.followers:
            columns[:, joint.index] += joint.multiplier * every[:, follower.velocity_start()]
        return columns

    def X_WL(self, link: str) -> FloatArray:
        """Return the pose of a link, shape (4, 4)."""
        return self._hand.X_WL(self._context, link)


def _near_its_frame(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, FloatArray]:
    """Return the mesh in its body's frame B, and p_OB: the centre of an object far from O."""
    # A time step rotates a body about its frame: with error if that is a metre away.
    middle: FloatArray = mesh.bounds.mean(axis=0)
    if np.linalg.norm(middle) <= _FAR:
        return mesh, np.zeros(3)
    return mesh.copy().apply_translation(-middle), middle
