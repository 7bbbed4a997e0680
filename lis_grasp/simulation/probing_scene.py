"""The scene of a probe in Drake: a fixed object, and a hand that rides on an arm along one line."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import (
    PdControllerGains,
    PrismaticJoint,
    QuaternionFloatingJoint,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from lis_grasp.exceptions import SimulationError
from lis_grasp.grasping.hand import Hand
from lis_grasp.simulation.hand_plant import add_hand, ignore_self_collision
from lis_grasp.simulation.object_plant import add_object
from lis_grasp.simulation.patches import Patch, contact_patches, normal_force

FloatArray = npt.NDArray[np.float64]

_TIME_STEP = 0.002  # [s]
_SKIN_MODULUS = 1e6  # [Pa]: 0.2 N at a quarter of a millimetre for a tip of 12 mm radius
_FRICTION = 0.8
# The arm that carries the hand, along the motion: stiff to follow, limited to stop at a touch.
_ARM_STIFFNESS, _ARM_DAMPING, _ARM_FORCE = 20_000.0, 600.0, 60.0  # [N/m], [N s/m], [N]
# Stiffness and damping of turning [N m/rad, N m s/rad] and of sliding joints [N/m, N s/m].
_FINGER_GAINS = {"revolute": (5.0, 0.1), "prismatic": (5_000.0, 50.0)}


class ProbingScene:
    """A hand that moves along W's +x axis, and an object that does not move.

    Hand and object can be placed anew at any time: both hang on joints that are locked during the
    motion, so that one plant serves every probe.

    Parameters
    ----------
    hand
        The hand.
    mesh
        The object in O [m], watertight.
    """

    time_step = _TIME_STEP

    def __init__(self, hand: Hand, mesh: trimesh.Trimesh) -> None:
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlant(
            MultibodyPlantConfig(
                time_step=_TIME_STEP,
                contact_model="hydroelastic",
                discrete_contact_approximation="lagged",
                use_sampled_output_ports=False,  # contact results right after a placement
            ),
            builder,
        )
        self._plant: MultibodyPlant = plant
        self._add_bodies(hand, mesh)
        plant.Finalize()
        ignore_self_collision(scene_graph, self._hand)
        self._simulator = Simulator(builder.Build())
        self._root_context = self._simulator.get_mutable_context()
        self._context = plant.GetMyMutableContextFromRoot(self._root_context)
        self._arm_port = plant.get_desired_state_input_port(self._arm)
        self._fingers_port = plant.get_desired_state_input_port(self._hand.instance)
        self._results_port = plant.get_contact_results_output_port()
        self._X_WO = np.eye(4)
        self._steps = 0

    def _add_bodies(self, hand: Hand, mesh: trimesh.Trimesh) -> None:
        plant = self._plant
        moving = sorted((j for j in hand.joints if j.index >= 0), key=lambda joint: joint.index)
        gains = np.array([_FINGER_GAINS[joint.kind] for joint in moving])  # (J, 2)
        self._hand = add_hand(
            plant,
            hand,
            stiffness=gains[:, 0],
            damping=gains[:, 1],
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
        base = self._hand.bodies[hand.base_link]
        self._mount = plant.AddJoint(
            QuaternionFloatingJoint("mount", carriage.body_frame(), base.body_frame())
        )
        self._fixture = plant.AddJoint(
            QuaternionFloatingJoint("fixture", plant.world_frame(), body.body_frame())
        )
        for still in (self._arm, instance):
            plant.set_gravity_enabled(still, False)

    @property
    def X_WO(self) -> FloatArray:
        """Pose of the object, shape (4, 4)."""
        return self._X_WO

    def place(self, q: FloatArray, X_WB: FloatArray, X_WO: FloatArray) -> None:
        """Put joints (J,), base link (4, 4) and object (4, 4) at the start of a motion, at rest."""
        plant, context = self._plant, self._context
        for joint in (self._mount, self._fixture):
            joint.Unlock(context)
        plant.SetVelocities(context, np.zeros(plant.num_velocities()))
        self._hand.set_joint_positions(context, q)
        self._slider.set_translation(context, 0.0)
        self._mount.SetPose(context, _rigid(X_WB))
        self._fixture.SetPose(context, _rigid(X_WO))
        for joint in (self._mount, self._fixture):
            joint.Lock(context)
        self._fingers_port.FixValue(context, np.concatenate([q, np.zeros_like(q)]))
        self._X_WO = X_WO

    def start_motion(self, travelled: float, speed: float) -> None:
        """Put the hand `travelled` [m] along its way, moving at `speed` [m/s] without lag."""
        self._slider.set_translation(self._context, travelled)
        self._slider.set_translation_rate(self._context, speed)
        self._arm_port.FixValue(self._context, [travelled, speed])
        # Time starts anew, so that its rounding cannot tell one motion from the next.
        self._root_context.SetTime(0.0)
        self._simulator.Initialize()
        self._steps = 0

    def step(self, travelled: float, speed: float) -> None:
        """Simulate one time step towards a commanded place [m] and speed [m/s] on the way."""
        self._arm_port.FixValue(self._context, [travelled, speed])
        self._steps += 1
        try:
            self._simulator.AdvanceTo(self._steps * _TIME_STEP)
        except RuntimeError as error:
            reason = str(error).splitlines()[0]
            raise SimulationError(f"the simulation of a touch failed: {reason}") from None

    def felt(self, threshold: float) -> list[Patch]:
        """Return what touches with a normal force above `threshold` [N], in W."""
        results = self._results_port.Eval(self._context)
        infos = [
            results.hydroelastic_contact_info(i) for i in range(results.num_hydroelastic_contacts())
        ]
        return [
            patch
            for info in infos
            if normal_force(info) > threshold
            for patch in contact_patches(
                info,
                object_geometry=self._object_geometry,
                link_of_geometry=self._hand.link_of_geometry,
            )
        ]


def _rigid(X: FloatArray) -> RigidTransform:
    return RigidTransform(RotationMatrix(X[:3, :3]), X[:3, 3])
