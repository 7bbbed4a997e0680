"""The scene of a grasp trial: a free object on a table, and a hand on a wrist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh
from pydrake.geometry import CollisionFilterDeclaration, FilterId, GeometrySet
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    HydroelasticContactInfo,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from lis_grasp.exceptions import SimulationError
from lis_grasp.hands.hand import Hand
from lis_grasp.motion import OBJECT
from lis_grasp.shapes.simplification import merge_flat_faces
from lis_grasp.simulation.advancing import advance
from lis_grasp.simulation.hand_plant import add_hand, add_wrist, ignore_self_collision
from lis_grasp.simulation.object_plant import add_object
from lis_grasp.simulation.table import add_table
from lis_grasp.typing import FloatArray

# Firm rubber: 5 N flatten a spherical fingertip by 0.4 mm, F = pi E d^2.
_SKIN_MODULUS = 1e7  # [Pa]
# Of the wrist's sliding and turning joints: a kilogram of hand follows 1 g within a millimetre,
# and a wrist that meets an obstacle pushes no harder than an arm would.
_WRIST_STIFFNESS = (2e4, 3e2)  # [N/m, N m/rad]
_WRIST_DAMPING = (4e2, 6.0)  # [N s/m, N m s/rad]
_WRIST_LIMITS = (150.0, 15.0)  # [N, N m]
_FAR = 0.25  # [m]


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """Where a link of the hand touches the object, all in W.

    Parameters
    ----------
    link
        Name of the link.
    point
        Shape (3,) [m], centroid of the contact patch.
    normal
        Shape (3,), unit, outward of the object: area-weighted mean over the patch.
    force
        Shape (3,) [N], of the hand on the object.
    """

    link: str
    point: FloatArray
    normal: FloatArray
    force: FloatArray

    @property
    def strength(self) -> float:
        """Size of the force [N]."""
        return float(np.linalg.norm(self.force))


class LiftScene:
    """A Drake simulation of hand, object and table, advanced one time step at a time.

    The world frame W is the object's frame O as the grasp was planned in it. Contacts are
    hydroelastic throughout: the object is its exact rigid mesh, never its hull; the hand's links
    and the table are compliant. The hand's links do not collide with each other.

    Parameters
    ----------
    mesh
        The true object, watertight [m].
    hand
        The hand.
    X_WH
        Shape (4, 4), pose of the palm at which the wrist is at zero.
    support_height
        Height of the table's top in W [m].
    mass, friction
        Of the object [kg], and of all surfaces.
    stiffness, damping
        Gains of the finger joints, shape (J,) or scalar.
    time_step
        [s].
    X_WO
        Shape (4, 4): where the object stands; None for where it was planned on, O = W.
    """

    def __init__(
        self,
        mesh: trimesh.Trimesh,
        hand: Hand,
        X_WH: FloatArray,
        *,
        support_height: float,
        mass: float,
        friction: float,
        stiffness: npt.ArrayLike,
        damping: npt.ArrayLike,
        time_step: float,
        X_WO: FloatArray | None = None,
    ) -> None:
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlant(
            MultibodyPlantConfig(
                time_step=time_step,
                contact_model="hydroelastic_with_fallback",
                discrete_contact_approximation="lagged",
            ),
            builder,
        )
        self._plant = plant
        self._time_step = time_step
        self._hand = add_hand(
            plant,
            hand,
            stiffness=stiffness,
            damping=damping,
            friction=friction,
            hydroelastic_modulus=_SKIN_MODULUS,
        )
        self._wrist = add_wrist(
            plant,
            self._hand,
            X_WH @ np.linalg.inv(hand.X_LH),
            stiffness=_WRIST_STIFFNESS,
            damping=_WRIST_DAMPING,
            limits=_WRIST_LIMITS,
        )
        instance = plant.AddModelInstance(OBJECT)
        body_mesh, self._p_OB = _about_its_frame(mesh)
        self._object, self._object_geometry = add_object(
            plant, merge_flat_faces(body_mesh), mass=mass, friction=friction, instance=instance
        )
        self._vertices = np.asarray(mesh.convex_hull.vertices)  # the lowest one is a hull vertex
        self._center = np.asarray(mesh.center_mass)
        self._table = add_table(plant, support_height, friction, under=mesh)
        plant.Finalize()
        ignore_self_collision(scene_graph, self._hand)
        # Drake gives a body without a joint this one: six degrees of freedom.
        (joint,) = plant.GetJointIndices(instance)
        self._object_joint = plant.get_joint(joint)
        self._diagram = builder.Build()
        root = self._diagram.CreateDefaultContext()
        self._context = plant.GetMyMutableContextFromRoot(root)
        X_WB = RigidTransform(np.eye(4) if X_WO is None else X_WO) @ RigidTransform(self._p_OB)
        plant.SetFreeBodyPose(self._context, self._object, X_WB)
        self._simulator = Simulator(self._diagram, root)
        self._filters = scene_graph.collision_filter_manager(
            scene_graph.GetMyMutableContextFromRoot(root)
        )
        self._resting: FilterId | None = None
        self._steps = 0
        self._fingers_port = plant.get_desired_state_input_port(self._hand.instance)
        self._efforts_port = plant.get_actuation_input_port(self._hand.instance)
        self._wrist_port = plant.get_desired_state_input_port(self._wrist.instance)
        plant.get_actuation_input_port(self._wrist.instance).FixValue(self._context, np.zeros(6))
        self._velocity_columns = [joint.velocity_start() for joint in self._hand.joints]
        self._position_rows = [joint.position_start() for joint in self._hand.joints]

    @property
    def time(self) -> float:
        """Simulated time since the start [s]."""
        return self._steps * self._time_step

    @property
    def steps(self) -> int:
        """Time steps since the start."""
        return self._steps

    def place_hand(self, displacement: FloatArray, q: FloatArray) -> None:
        """Put the palm at a displacement (3,) [m] from its zero and the joints at q, at rest."""
        for joint, value in zip(self._wrist.joints[:3], displacement, strict=True):
            joint.set_translation(self._context, value)
        self._hand.set_joint_positions(self._context, q)
        self.command_wrist(np.append(displacement, np.zeros(3)), np.zeros(6))
        self.command_fingers(q, np.zeros(len(q)))

    def command_wrist(self, displacement: FloatArray, velocity: FloatArray) -> None:
        """Ask the palm for a displacement (6,) from its zero, see `WristPath`, and its rate."""
        self._wrist_port.FixValue(self._context, np.concatenate([displacement, velocity]))

    def command_fingers(self, q: FloatArray, efforts: FloatArray) -> None:
        """Ask the joints to be at q, shape (J,), and add efforts (J,) to what that takes."""
        self._fingers_port.FixValue(self._context, np.concatenate([q, np.zeros(len(q))]))
        self._efforts_port.FixValue(self._context, efforts)

    def rest_object(self) -> None:
        """Lock the object where it stands until the hand touches it.

        It does not move by itself, and its contact with the table, which is the costliest one,
        need not be computed until then.
        """
        # Drake 1.51 crashes on contact between a locked body and the world: filter it meanwhile.
        self._resting = self._filters.ApplyTransient(
            CollisionFilterDeclaration().ExcludeBetween(
                GeometrySet([self._object_geometry]), GeometrySet([self._table])
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
        advance(self._simulator, self.time, of="a grasp trial")
        if not np.isfinite(self._plant.GetPositions(self._context)).all():
            raise SimulationError(f"a grasp trial diverged at {self.time:.3f} s")
        if self._resting is not None and self.touches():
            self._filters.RemoveDeclaration(self._resting)
            self._object_joint.Unlock(self._context)
            self._resting = None

    @property
    def joint_positions(self) -> FloatArray:
        """Joint positions, shape (J,)."""
        positions: FloatArray = self._plant.GetPositions(self._context)[self._position_rows]
        return positions

    @property
    def X_WH(self) -> FloatArray:
        """Pose of the palm, shape (4, 4)."""
        base = self._hand.bodies[self._hand.hand.base_link]
        return self._pose(base) @ self._hand.hand.X_LH

    @property
    def X_WO(self) -> FloatArray:
        """Pose of the object, shape (4, 4)."""
        X_WO = self._pose(self._object)
        X_WO[:3, 3] -= X_WO[:3, :3] @ self._p_OB
        return X_WO

    @property
    def object_center(self) -> FloatArray:
        """The object's centre of mass, shape (3,) [m]."""
        return self.X_WO[:3, :3] @ self._center + self.X_WO[:3, 3]

    @property
    def object_bottom(self) -> float:
        """Height of the object's lowest point [m]."""
        X_WO = self.X_WO
        return float((self._vertices @ X_WO[2, :3]).min() + X_WO[2, 3])

    def poses(self) -> dict[str, FloatArray]:
        """Return the pose of every hand link and the object, each (4, 4)."""
        links = {name: self._pose(body) for name, body in self._hand.bodies.items()}
        return {**links, OBJECT: self.X_WO}

    def touches(self) -> tuple[Touch, ...]:
        """Return where the hand touches the object, in a fixed order."""
        results = self._plant.get_contact_results_output_port().Eval(self._context)
        found = []
        for i in range(results.num_hydroelastic_contacts()):
            info = results.hydroelastic_contact_info(i)
            touch = self._touch(info)
            if touch is not None:
                found.append(touch)
        return tuple(found)

    def jacobian(self, link: str, p_L: FloatArray) -> FloatArray:
        """Return how a point of a link moves in W with the joints, shape (3, J).

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
        return self._pose(self._hand.bodies[link])

    def _pose(self, body: object) -> FloatArray:
        pose: FloatArray = self._plant.EvalBodyPoseInWorld(self._context, body).GetAsMatrix4()
        return pose

    def _touch(self, info: HydroelasticContactInfo) -> Touch | None:
        surface = info.contact_surface()
        # Drake's force acts on the body of M; its face normals point out of N, into M.
        if surface.id_N() == self._object_geometry:
            other, force, sign = surface.id_M(), -info.F_Ac_W().translational(), 1.0
        elif surface.id_M() == self._object_geometry:
            other, force, sign = surface.id_N(), info.F_Ac_W().translational(), -1.0
        else:
            return None
        link = self._hand.link_of_geometry.get(other)
        if link is None:
            return None
        faces = range(surface.num_faces())
        normal = sign * sum(surface.area(f) * surface.face_normal(f) for f in faces)
        length = np.linalg.norm(normal)
        if length == 0.0:
            return None
        return Touch(link, surface.centroid(), normal / length, force)


def _about_its_frame(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, FloatArray]:
    """Return the mesh in its body's frame B, and where that is in O: in the middle of a far object.

    Time steps turn a body about its frame: about one that is a metre away they would be off by
    parts of a millimetre.
    """
    middle: FloatArray = mesh.bounds.mean(axis=0)
    if np.linalg.norm(middle) <= _FAR:
        return mesh, np.zeros(3)
    return mesh.copy().apply_translation(-middle), middle
