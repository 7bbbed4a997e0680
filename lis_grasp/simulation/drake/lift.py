"""Simulated lift in Drake: a free object on a table, and a hand on a free wrist or an arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    JacobianWrtVariable,
    Joint,
    PdControllerGains,
    PrismaticJoint,
    RevoluteJoint,
    SpatialInertia,
    UnitInertia,
)

from lis_grasp.exceptions import SimulationError
from lis_grasp.geometry import make_pose, rotate
from lis_grasp.lifting.closing import AcceptGrasp
from lis_grasp.lifting.outcome import LiftOutcome
from lis_grasp.lifting.scene import FreeWrist, HandContact, Touched
from lis_grasp.lifting.setup import (
    WRIST_DAMPING,
    WRIST_LIMITS,
    WRIST_STIFFNESS,
    LiftSetup,
    finger_gains,
    motor_inertias,
)
from lis_grasp.lifting.trial import LiftTrial
from lis_grasp.motion import OBJECT
from lis_grasp.shapes.solids import merge_flat_faces, split_large_faces
from lis_grasp.simulation.drake._arm_carrier import ArmCarrier
from lis_grasp.simulation.drake._plant_scene import PlantScene, Scheme
from lis_grasp.simulation.drake.hand_plant import LIFTING_SKIN, HandInPlant, add_hand_model
from lis_grasp.simulation.drake.object_plant import add_object_body, add_support, add_table
from lis_grasp.typing import FloatArray

# Length and width of the object's largest triangles [m]. Drake bounds up to three triangles by one
# box: around larger ones of several faces, it contains nearly all of a fingertip, which is then
# clipped by each of them.
_LONGEST = 0.1
_WIDEST = 0.03
# Speed up to which Drake regularises friction, so that held objects creep [m/s]. At Drake's default
# of 1e-4 a screwdriver between two flat pads turns by 1.2 deg/s, far below the limit of friction.
# At 1e-5 it turns by 0.25 deg/s; below, nothing changes.
_STICTION_TOLERANCE = 1e-5

_AXIS_NAMES = ("x", "y", "z")


def simulate_lift(
    setup: LiftSetup, accept_grasp: AcceptGrasp | None = None, *, scheme: Scheme = "discrete"
) -> LiftOutcome:
    """Execute one grasp on the true, free object, and return whether it holds.

    The object rests on a table. The hand approaches along a straight line in the pregrasp posture.
    Each finger closes until it touches the object: the grasp was planned on an estimate that is
    off by millimetres. The fingers squeeze with forces that balance each other at the measured
    contacts; the hand lifts, shakes and holds. The trial ends early once the grasp has failed.

    Contact model: hydroelastic, in Drake's discrete solver with the "lagged" approximation. The
    object is its exact rigid mesh, never its hull; all links of the hand and the table are
    compliant; links of the hand do not collide with each other.

    Parameters
    ----------
    setup
        Object, hand, grasp and options.
    accept_grasp
        Tactile check: called with the contacts of the closed fingers, if any, before they squeeze;
        if it returns False, the hand opens and retreats. A hand with a tactile check also stops and
        retreats if it touches the object on its approach.
    scheme
        "discrete", or "cenic" for Drake's error-controlled convex integrator; see `PlantScene`.
    """
    return LiftTrial(LiftScene(setup, scheme), setup, accept_grasp).run()


class LiftScene:
    """A Drake simulation of hand, object and table; see `LiftingScene` and `simulate_lift`."""

    def __init__(self, setup: LiftSetup, scheme: Scheme = "discrete") -> None:
        hand, mesh, friction = setup.hand, setup.mesh, setup.friction
        self._scene = scene = PlantScene(
            setup.options.time_step,
            contact_model="hydroelastic_with_fallback",
            surroundings=setup.surroundings,
            scheme=scheme,
            stiction_tolerance=_STICTION_TOLERANCE,
        )
        plant = scene.plant
        gains = finger_gains(hand, setup.grasp)
        self._hand = add_hand_model(
            plant, hand, gains=gains, friction=friction, modulus=LIFTING_SKIN
        )
        for joint, inertia in zip(self._hand.joints, motor_inertias(hand), strict=True):
            motor = plant.GetJointActuatorByName(joint.name(), self._hand.instance)
            motor.set_default_rotor_inertia(inertia)
        if scheme == "cenic":
            # At a joint's limit, CENIC of Drake 1.51 gives velocities of 1e7 rad/s. Commands are
            # within the limits.
            for joint in (
                *self._hand.joints,
                *(follower for follower, _ in self._hand.links.followers),
            ):
                joint.set_position_limits([-np.inf], [np.inf])
        self.carrier: WristInPlant | ArmCarrier = (
            WristInPlant(plant, self._hand, setup.X_WB)
            if setup.arm is None
            else ArmCarrier(plant, self._hand, setup)
        )
        # A time step rotates a body about its frame: with error if the body is a metre away.
        self._p_OB: FloatArray = mesh.bounds.mean(axis=0)
        centered = merge_flat_faces(mesh.copy().apply_translation(-self._p_OB))
        faces = split_large_faces(centered, longest=_LONGEST, widest=_WIDEST)
        self._object = add_object_body(plant, faces, mass=setup.mass, friction=friction)
        height = setup.support_height
        table = add_table(plant, height, friction, under=mesh)
        support = add_support(plant, height, friction, under=mesh, mass=setup.mass)
        scene.finalize(self._hand, self._object, support=support, table=table)
        X_WB = RigidTransform(setup.X_WO) @ RigidTransform(self._p_OB)
        plant.SetFreeBodyPose(scene.context, self._object.body, X_WB)
        scene.place_surroundings({body.name: body.X_EB for body in setup.surroundings})
        self.carrier.connect(scene)
        self._is_resting = False
        self._pull: HandContact | None = None
        self._carries_weight = setup.arm is not None
        self._fingers_port = plant.get_desired_state_input_port(self._hand.instance)
        self._efforts_port = plant.get_actuation_input_port(self._hand.instance)

    @property
    def time(self) -> float:
        """Simulated time since the start [s]."""
        return self._scene.steps * self._scene.time_step

    @property
    def steps(self) -> int:
        """Time steps since the start."""
        return self._scene.steps

    def place_hand(self, displacement: FloatArray, q: FloatArray) -> None:
        """Set the palm to a displacement (6,) from the grasp and the joints to q, at rest."""
        self.carrier.place(displacement)
        self._hand.set_joint_positions(self._scene.context, q)
        self.command_fingers(q, np.zeros(len(q)))

    def command_fingers(self, q: FloatArray, efforts: FloatArray) -> None:
        """Command joint positions q, shape (J,), and efforts (J,) on top of the springs'."""
        self._fingers_port.FixValue(self._scene.context, np.concatenate([q, np.zeros(len(q))]))
        if self._carries_weight:
            efforts = efforts + self._hand.weight_efforts(self._scene.plant, self._scene.context)
        self._efforts_port.FixValue(self._scene.context, efforts)

    def pull(self, contact: HandContact | None) -> None:
        """Apply the force of a link on the object, and its reaction; see `LiftingScene`."""
        self._pull = contact
        link = self._hand.base if contact is None else self._hand.links.bodies[contact.link]
        point, force = np.zeros((2, 3)) if contact is None else (contact.point, contact.force)
        self._scene.pull(link, point, force)

    def rest_object(self) -> None:
        """Lock the object until the hand touches it.

        It does not move by itself, and its contact with the support, the costliest one, need not be
        computed until then.
        """
        self._is_resting = True
        self._scene.lock_object()

    def step(self) -> None:
        """Advance by one time step.

        Raises `SimulationError` if Drake could not take the step, or the object's pose is no longer
        finite, and `ArmStoppedError` if an arm cannot go on.
        """
        self._scene.step(of="a lift")
        if not np.isfinite(self._scene.plant.GetPositions(self._scene.context)).all():
            raise SimulationError(f"a lift diverged at {self.time:.3f} s")
        if self._is_resting and self._is_touched():
            self._scene.unlock_object()
            self._is_resting = False
        self.carrier.check()

    @property
    def joint_positions(self) -> FloatArray:
        """Joint positions, shape (J,)."""
        return self._hand.joint_positions(self._scene.context)

    @property
    def X_WH(self) -> FloatArray:
        """Pose of the palm, shape (4, 4)."""
        return self._hand.X_WH(self._scene.context)

    @property
    def X_WO(self) -> FloatArray:
        """Pose of the object, shape (4, 4)."""
        X_WO: FloatArray = self._object.body.EvalPoseInWorld(self._scene.context).GetAsMatrix4()
        X_WO[:3, 3] -= rotate(X_WO, self._p_OB)
        return X_WO

    def poses(self) -> dict[str, FloatArray]:
        """Return the pose of every hand link, the object and an arm's links, each (4, 4)."""
        links = {name: self.X_WL(name) for name in self._hand.links.bodies}
        return {**links, OBJECT: self.X_WO, **self.carrier.poses()}

    def contacts(self, on: Touched = "object") -> list[HandContact]:
        """Return the contacts of the hand with the object or the table, in a fixed order."""
        pulls = [self._pull] if self._pull is not None and on == "object" else []
        contacts: list[HandContact] = [*self._scene.contacts(on), *pulls]
        if self._scene.scheme == "cenic" and on == "object":
            return _with_sum(contacts, self._scene.object_force() - self._scene.support_force())
        return contacts

    def _is_touched(self) -> bool:
        """Return whether the hand, or a body beside the object, touches it."""
        by_body = any(who == "object" for _, who in self._scene.forces_beside)
        return by_body or bool(self.contacts())

    def forces_beside(self) -> dict[str, float]:
        """Return the forces [N] of hand, arm and object on bodies beside the object now."""
        sums: dict[str, float] = {}
        for (name, _), force in self._scene.forces_beside.items():
            sums[name] = sums.get(name, 0.0) + force
        return sums

    def poses_beside(self) -> dict[str, FloatArray]:
        """Return the poses X_WB (4, 4) of the free bodies beside the object."""
        beside = self._scene.surroundings
        return {} if beside is None else beside.poses(self._scene.context)

    def jacobian(self, link: str, p_L: FloatArray) -> FloatArray:
        """Return the Jacobian of a point p_L of a link with respect to the joints, shape (3, J).

        Joints that follow another by a transmission move with it.
        """
        world = self._scene.plant.world_frame()
        every: FloatArray = self._scene.plant.CalcJacobianTranslationalVelocity(
            self._scene.context,
            JacobianWrtVariable.kV,
            self._hand.links.bodies[link].body_frame(),
            p_L,
            world,
            world,
        )
        return self._hand.by_joint(every)

    def X_WL(self, link: str) -> FloatArray:
        """Return the pose of a link, shape (4, 4)."""
        return self._hand.X_WL(self._scene.context, link)


class WristInPlant(FreeWrist):
    """Six joints under PD control that hold the hand's base link: `LiftCarrier` without an arm.

    The displacement ``[x, y, z, roll, pitch, yaw]`` is relative to X_WB, shape (4, 4), the pose of
    the base link in the grasp, in W's axes. There the wrist is far from its singularity, 90 degrees
    of pitch, for any pose of the hand. The plant is not finalized yet.
    """

    def __init__(self, plant: MultibodyPlant, hand: HandInPlant, X_WB: FloatArray) -> None:
        super().__init__(self._command_state)
        self._plant, self._instance = plant, plant.AddModelInstance("wrist")
        # Light against the hand, heavy enough to keep the solver's mass matrix well conditioned.
        carriage = SpatialInertia(0.1, np.zeros(3), UnitInertia.SolidSphere(0.05))
        X_WZ = RigidTransform(X_WB[:3, 3])
        frame = plant.AddFrame(
            FixedOffsetFrame("wrist_zero", plant.world_frame(), X_WZ, self._instance)
        )
        joints: list[Joint] = []
        for kind, turning in ((PrismaticJoint, False), (RevoluteJoint, True)):
            # Yaw first, roll last: the usual roll-pitch-yaw about W's axes.
            order = slice(None, None, -1 if turning else 1)
            for axis, letter in zip(np.eye(3)[order], _AXIS_NAMES[order], strict=True):
                name = f"wrist_{'turn' if turning else 'slide'}_{letter}"
                body = plant.AddRigidBody(f"{name}_body", self._instance, carriage)
                joints.append(plant.AddJoint(kind(name, frame, body.body_frame(), axis)))
                frame = body.body_frame()
        X_ZB = RigidTransform(make_pose(X_WB[:3, :3]))
        plant.WeldFrames(frame, hand.base.body_frame(), X_ZB)
        self._joints = (*joints[:3], *reversed(joints[3:]))  # x y z, then roll pitch yaw
        for joint in self._joints:
            turning = isinstance(joint, RevoluteJoint)
            actuator = plant.AddJointActuator(joint.name(), joint, WRIST_LIMITS[turning])
            gains = PdControllerGains(p=WRIST_STIFFNESS[turning], d=WRIST_DAMPING[turning])
            actuator.set_controller_gains(gains)
        plant.set_gravity_enabled(self._instance, False)

    def connect(self, scene: PlantScene) -> None:
        """Take the scene of the finalized plant."""
        self._context = scene.context
        self._port = self._plant.get_desired_state_input_port(self._instance)
        efforts = self._plant.get_actuation_input_port(self._instance)
        efforts.FixValue(self._context, np.zeros(6))

    def place(self, displacement: FloatArray) -> None:
        """Set the wrist to a displacement (6,) without a rotation, at rest."""
        for joint, value in zip(self._joints[:3], displacement[:3], strict=True):
            joint.set_translation(self._context, value)
        self._command_state(displacement, np.zeros(6))

    def check(self) -> None:
        """Do nothing: a free wrist has no limits to exceed."""

    def poses(self) -> dict[str, FloatArray]:
        """Return nothing: a free wrist has no bodies to see."""
        return {}

    def _command_state(self, displacement: FloatArray, velocity: FloatArray) -> None:
        self._port.FixValue(self._context, np.concatenate([displacement, velocity]))


def _with_sum(contacts: list[HandContact], total: FloatArray) -> list[HandContact]:
    """Return contacts with the same normal forces, and friction such that the forces' sum is total.

    Each has a part of the friction by its normal force.
    """
    pushes = np.array([contact.force @ contact.normal for contact in contacts])
    if not pushes.any():
        return contacts
    along = pushes[:, None] * np.array([contact.normal for contact in contacts])
    forces = along + (pushes / pushes.sum())[:, None] * (total - along.sum(axis=0))
    return [replace(c, force=force) for c, force in zip(contacts, forces, strict=True)]
