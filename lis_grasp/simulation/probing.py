"""Touch a fixed object with a hand's fingertip in Drake: guarded motion, and contacts out of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh
from pydrake.geometry import HydroelasticContactRepresentation
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    HydroelasticContactInfo,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import (
    PdControllerGains,
    PrismaticJoint,
    QuaternionFloatingJoint,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidHandError
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.grasping.hand import Hand, ProbePosture
from lis_grasp.simulation.hand_plant import add_hand, ignore_self_collision
from lis_grasp.simulation.object_plant import add_object
from lis_grasp.simulation.patches import Patch, split_patch

FloatArray = npt.NDArray[np.float64]

_TIME_STEP = 0.002  # [s]
# 0.2 mm a step: with the skin below, a touch passes the threshold by about 1 N at the most.
_SPEED = 0.1  # [m/s]
_FORCE_THRESHOLD = 0.2  # [N]
_SKIN_MODULUS = 1e6  # [Pa]: 0.2 N at a quarter of a millimetre for a tip of 12 mm radius
_FRICTION = 0.8
_ROLLS = 8
_FREE_POINT_SPACING = 0.01  # [m]
# The arm that carries the hand, along the motion: stiff to follow, limited to stop at a touch.
_ARM_STIFFNESS, _ARM_DAMPING, _ARM_FORCE = 20_000.0, 600.0, 60.0  # [N/m], [N s/m], [N]
# Fingers of a hand-sized revolute joint, and of a jaw's prismatic one.
_FINGER_GAINS = {"multi_finger": (5.0, 0.1), "jaw": (5_000.0, 50.0)}


@dataclass(frozen=True, slots=True, eq=False)
class _Placement:
    """How hand and object stand in W for one probe: the motion is along +x, from the origin."""

    posture: ProbePosture
    X_WB: FloatArray
    X_WO: RigidTransform


class DynamicProber:
    """Probes with the whole hand in Drake: every link can touch, and what touches first is felt.

    The hand rides on an arm along the probe's direction, the leading finger in its probe posture,
    the joints under PD control; the object is fixed. For each probe the hand is put at the start
    of the motion with a roll about its direction that leaves every link free. Contact is Drake's
    hydroelastic one between the exact mesh and compliant links, so bores and concave corners are
    true; a touch is a patch with more normal force than 0.2 N.

    Parameters
    ----------
    hand
        The hand; it needs a probe posture.
    mesh
        The true object in O [m], watertight.
    finger
        The leading finger; None takes the hand's first probe posture.

    Raises
    ------
    InvalidHandError
        If the hand has no probe posture for that finger.
    """

    def __init__(self, hand: Hand, mesh: trimesh.Trimesh, *, finger: str | None = None) -> None:
        postures = hand.probe_postures
        finger = next(iter(postures), None) if finger is None else finger
        if finger not in postures:
            raise InvalidHandError(
                f"touching needs a probe posture; hand '{hand.name}' has"
                f" {', '.join(postures) or 'none'}: add one for '{finger}' to its YAML"
            )
        self._posture = postures[finger]
        self._clock = 0.0
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlant(
            MultibodyPlantConfig(
                time_step=_TIME_STEP,
                contact_model="hydroelastic",
                discrete_contact_approximation="lagged",
                use_sampled_output_ports=False,
            ),
            builder,
        )
        self._add_bodies(plant, hand, mesh)
        plant.Finalize()
        ignore_self_collision(scene_graph, self._hand)
        self._simulator = Simulator(builder.Build())
        self._context = self._simulator.get_mutable_context()
        self._plant_context = plant.GetMyMutableContextFromRoot(self._context)
        self._query_port = scene_graph.get_query_output_port()
        self._scene_context = scene_graph.GetMyContextFromRoot(self._context)
        self._simulator.Initialize()

    def _add_bodies(self, plant: MultibodyPlant, hand: Hand, mesh: trimesh.Trimesh) -> None:
        self._plant = plant
        stiffness, damping = _FINGER_GAINS[hand.kind]
        self._hand = add_hand(
            plant,
            hand,
            stiffness=stiffness,
            damping=damping,
            friction=_FRICTION,
            hydroelastic_modulus=_SKIN_MODULUS,
        )
        self._arm = plant.AddModelInstance("arm")
        carriage = plant.AddRigidBody(
            "carriage", self._arm, SpatialInertia(0.5, np.zeros(3), UnitInertia.SolidSphere(0.05))
        )
        self._slider = plant.AddJoint(
            PrismaticJoint(
                "slider", plant.world_frame(), carriage.body_frame(), np.array([1.0, 0.0, 0.0])
            )
        )
        plant.AddJointActuator("slider", self._slider, _ARM_FORCE).set_controller_gains(
            PdControllerGains(p=_ARM_STIFFNESS, d=_ARM_DAMPING)
        )
        instance = plant.AddModelInstance("object")
        body, self._object_geometry = add_object(
            plant, mesh, mass=1.0, friction=_FRICTION, instance=instance
        )
        # Two joints that are locked during a probe, so that one plant serves every direction.
        base = self._hand.bodies[hand.base_link]
        self._mount = plant.AddJoint(
            QuaternionFloatingJoint("mount", carriage.body_frame(), base.body_frame())
        )
        self._fixture = plant.AddJoint(
            QuaternionFloatingJoint("fixture", plant.world_frame(), body.body_frame())
        )
        for still in (self._arm, instance):
            plant.set_gravity_enabled(still, False)

    def probe(self, probe: Probe) -> ProbeOutcome:
        """Carry out one probe; see `Prober`."""
        placement = self._find_free_start(probe)
        if placement is None:
            return ProbeOutcome(probe, "blocked")
        felt, duration = self._advance(probe.standoff + probe.overshoot)
        self._clock += duration
        free_points = self._free_points(probe)
        if not felt:
            return ProbeOutcome(probe, "missed", free_points=free_points, duration=duration)
        patches = [patch for info in felt for patch in self._patches(info)]
        contacts = self._contacts(patches, placement.X_WO.inverse(), free_points)
        return ProbeOutcome(probe, "touched", contacts, free_points, duration)

    def _find_free_start(self, probe: Probe) -> _Placement | None:
        """Put hand and object at the start of the motion, and return how; None if no roll is free."""
        hand, posture = self._hand.hand, self._posture
        poses = hand.forward_kinematics(np.eye(4), posture.joint_positions)  # X_HL
        X_HL = poses[posture.link]
        center = X_HL[:3, :3] @ posture.center_L + X_HL[:3, 3]
        R_WH = _rotation_to_x(posture.direction_H)
        X_WH = np.eye(4)
        X_WH[:3, :3] = R_WH
        X_WH[:3, 3] = -R_WH @ (center + posture.radius * posture.direction_H)
        X_WB = X_WH @ poses[hand.base_link]
        for k in range(_ROLLS):
            R_WO = _roll(2.0 * np.pi * k / _ROLLS) @ _rotation_to_x(probe.direction)
            X_WO = RigidTransform(RotationMatrix(R_WO), -R_WO @ probe.start)
            self._put(posture, X_WB, X_WO)
            if not self._collides():
                return _Placement(posture, X_WB, X_WO)
        return None

    def _put(self, posture: ProbePosture, X_WB: FloatArray, X_WO: RigidTransform) -> None:
        plant, context = self._plant, self._plant_context
        for joint in (self._mount, self._fixture):
            joint.Unlock(context)
        plant.SetVelocities(context, np.zeros(plant.num_velocities()))
        self._hand.set_joint_positions(context, posture.joint_positions)
        self._slider.set_translation(context, 0.0)
        self._mount.SetPose(context, RigidTransform(X_WB))
        self._fixture.SetPose(context, X_WO)
        for joint in (self._mount, self._fixture):
            joint.Lock(context)
        still = np.zeros_like(posture.joint_positions)
        plant.get_desired_state_input_port(self._hand.instance).FixValue(
            context, np.concatenate([posture.joint_positions, still])
        )

    def _collides(self) -> bool:
        query = self._query_port.Eval(self._scene_context)
        polygon = HydroelasticContactRepresentation.kPolygon
        return bool(query.ComputeContactSurfaces(polygon))

    def _advance(self, length: float) -> tuple[list[HydroelasticContactInfo], float]:
        """Move the arm along `length` [m] until something is felt; return that and the time taken."""
        port = self._plant.get_desired_state_input_port(self._arm)
        results = self._plant.get_contact_results_output_port()
        start = self._context.get_time()
        steps = int(np.ceil(length / (_SPEED * _TIME_STEP)))
        for n in range(1, steps + 1):
            port.FixValue(self._plant_context, [n * _SPEED * _TIME_STEP, _SPEED])
            self._simulator.AdvanceTo(start + n * _TIME_STEP)
            contact = results.Eval(self._plant_context)
            if contact.num_hydroelastic_contacts() == 0:
                continue
            felt = [
                info
                for i in range(contact.num_hydroelastic_contacts())
                if _normal_force(info := contact.hydroelastic_contact_info(i)) > _FORCE_THRESHOLD
            ]
            if felt:
                return felt, n * _TIME_STEP
        return [], steps * _TIME_STEP

    def _free_points(self, probe: Probe) -> FloatArray:
        """Return where the centre of the leading tip went, every centimetre, shape (K, 3)."""
        travelled = max(self._slider.get_translation(self._plant_context), 0.0)
        steps = np.arange(0.0, travelled, _FREE_POINT_SPACING)[:, None]  # (K, 1)
        return probe.start + (steps - self._posture.radius) * probe.direction

    def _patches(self, info: HydroelasticContactInfo) -> list[Patch]:
        surface = info.contact_surface()
        object_is_m = surface.id_M() == self._object_geometry
        link = self._hand.link_of_geometry[surface.id_N() if object_is_m else surface.id_M()]
        mesh = surface.tri_mesh_W() if surface.is_triangle() else surface.poly_mesh_W()
        faces = range(surface.num_faces())
        areas = np.array([surface.area(i) for i in faces])
        # A face's normal points out of N into M: it is the object's outward one when N is the object.
        outward = -1.0 if object_is_m else 1.0
        normals = outward * np.array([surface.face_normal(i) for i in faces])
        centroids = np.array([mesh.element_centroid(i) for i in faces])
        return split_patch(link, areas, centroids, normals, force=_normal_force(info))

    def _contacts(
        self, patches: list[Patch], X_OW: RigidTransform, free_points: FloatArray
    ) -> Contacts:
        return Contacts(
            points=np.array([X_OW @ patch.point for patch in patches]),
            normals=np.array([X_OW.rotation() @ patch.normal for patch in patches]),
            forces=np.array([patch.force for patch in patches]),
            fingers=tuple(patch.link for patch in patches),
            times=np.full(len(patches), self._clock),
            free_points=free_points,
        )


def _normal_force(info: HydroelasticContactInfo) -> float:
    """Return the patch's force along its mean normal [N]: friction does not count as touch."""
    surface = info.contact_surface()
    normal = sum(surface.area(i) * surface.face_normal(i) for i in range(surface.num_faces()))
    length = np.linalg.norm(normal)
    return float(abs(info.F_Ac_W().translational() @ normal) / length) if length else 0.0


def _rotation_to_x(direction: FloatArray) -> FloatArray:
    """Return a rotation, shape (3, 3), that takes the unit `direction` to +x."""
    helper = np.eye(3)[np.argmin(np.abs(direction))]
    y = np.cross(direction, helper)
    y /= np.linalg.norm(y)
    return np.vstack([direction, y, np.cross(direction, y)])


def _roll(angle: float) -> FloatArray:
    """Return the rotation about +x by `angle` [rad], shape (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
