"""Drake scene of an arm's motions in free space, with the object and the table in place."""

from __future__ import annotations

import numpy as np
import trimesh
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import QuaternionFloatingJoint
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from lis_grasp.arms.joint_trajectory import JointTrajectory
from lis_grasp.arms.station import Station
from lis_grasp.arms.time_scaling import TIME_STEP
from lis_grasp.lifting.arm_use import ArmUse
from lis_grasp.lifting.joint_path import JointPath
from lis_grasp.simulation.drake.advance_simulation import advance
from lis_grasp.simulation.drake.arm_dynamics import ArmDynamics
from lis_grasp.simulation.drake.arm_plant import add_arm, ignore_mounting
from lis_grasp.simulation.drake.arm_watch import ArmWatch
from lis_grasp.simulation.drake.hand_plant import LIFTING_SKIN, add_hand, ignore_self_collision
from lis_grasp.simulation.drake.object_plant import add_object, add_table, let_rest
from lis_grasp.typing import FloatArray

# Fingers do not move on the way: their joints are locked.
_FINGER_STIFFNESS, _FINGER_DAMPING, _FRICTION = 5.0, 0.1, 0.8

# Time before and after a touch in which the fingertip is within millimetres of the object [s].
_GRAZING = 0.2


class TransitScene:
    """A simulation of an arm that moves in free space with the hand in one posture.

    The time step is 10 ms: nothing is to be touched, and the joints' control is implicit. The
    object stays where it is. `use` records what is demanded of the arm, and every contact.

    Parameters
    ----------
    station
        The station.
    mesh
        The true object, watertight.
    use
        Gets what the motions demand of the arm.
    """

    def __init__(self, station: Station, mesh: trimesh.Trimesh, use: ArmUse) -> None:
        hand, X_FB = station.hand, station.mount.X_FB
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlant(
            MultibodyPlantConfig(
                time_step=TIME_STEP,
                contact_model="hydroelastic_with_fallback",
                discrete_contact_approximation="lagged",
            ),
            builder,
        )
        self._plant: MultibodyPlant = plant
        self._hand = add_hand(
            plant,
            hand,
            stiffness=_FINGER_STIFFNESS,
            damping=_FINGER_DAMPING,
            friction=_FRICTION,
            hydroelastic_modulus=LIFTING_SKIN,
        )
        posture = next(iter(hand.probe_postures.values())).joint_positions
        self._dynamics = ArmDynamics(station.arm, hand, station.X_WA, X_FB, posture)
        self._arm = add_arm(
            plant, station.arm, self._hand, X_WA=station.X_WA, X_FB=X_FB, dynamics=self._dynamics
        )
        instance = plant.AddModelInstance("object")
        body, geometry = add_object(plant, mesh, mass=1.0, friction=_FRICTION, instance=instance)
        self._fixture = plant.AddJoint(
            QuaternionFloatingJoint("fixture", plant.world_frame(), body.body_frame())
        )
        table: GeometryId | None = None
        if station.table is not None:
            table = add_table(plant, station.table.height, _FRICTION, under=mesh)
        plant.Finalize()
        ignore_self_collision(scene_graph, self._hand)
        let_rest(scene_graph, geometry, support=None, table=table)
        self._simulator = Simulator(builder.Build())
        self._root_context = self._simulator.get_mutable_context()
        self._context = plant.GetMyMutableContextFromRoot(self._root_context)
        filters = scene_graph.collision_filter_manager(
            scene_graph.GetMyMutableContextFromRoot(self._root_context)
        )
        ignore_mounting(filters, self._arm, table)
        arm_instance = self._arm.instance
        self._states = plant.get_desired_state_input_port(arm_instance)
        self._efforts = plant.get_actuation_input_port(arm_instance)
        self._fingers = plant.get_desired_state_input_port(self._hand.instance)
        self._finger_efforts = plant.get_actuation_input_port(self._hand.instance)
        self._watch = ArmWatch(
            plant, self._context, self._arm, table=table, use=use, object_ends=True
        )

    def run(
        self,
        way: JointTrajectory,
        q_hand: FloatArray,
        X_WO: FloatArray,
        *,
        touch: float | None = None,
    ) -> None:
        """Simulate a motion of the arm, with the hand's joints (K,) fixed and the object at X_WO.

        `touch` is the time of the touch that begins or ends it [s], beside which a fingertip may
        graze the object; None for none.

        Raises
        ------
        ArmStoppedError
            If the arm touches something, or a joint stays at its largest effort.
        SimulationError
            If Drake's solver fails.
        """
        path = JointPath.of(way, TIME_STEP)
        self._place(path, q_hand, X_WO)
        for n in range(1, len(path.q)):
            self._command(path, n)
            self._watch.free = touch is None or abs(n * TIME_STEP - touch) > _GRAZING
            advance(self._simulator, n * TIME_STEP, of="an arm's way")
            self._watch.check()

    def _place(self, path: JointPath, q_hand: FloatArray, X_WO: FloatArray) -> None:
        """Set everything to the start of a motion, the joints of hand and object locked."""
        plant, context = self._plant, self._context
        held = [*self._hand.joints, *(joint for joint, _ in self._hand.followers), self._fixture]
        for joint in held:
            joint.Unlock(context)
        self._hand.set_joint_positions(context, q_hand)
        R_WO = RotationMatrix.ProjectToRotationMatrix(X_WO[:3, :3])
        self._fixture.SetPose(context, RigidTransform(R_WO, X_WO[:3, 3]))
        plant.SetVelocities(context, np.zeros(plant.num_velocities()))
        plant.SetPositions(context, self._arm.instance, path.q[0])
        plant.SetVelocities(context, self._arm.instance, path.qd[0])
        for joint in held:
            joint.Lock(context)
        self._fingers.FixValue(context, np.concatenate([q_hand, np.zeros_like(q_hand)]))
        self._finger_efforts.FixValue(context, np.zeros(len(q_hand)))
        self._command(path, 0)
        # Time starts at 0, so that its rounding is the same for every motion.
        self._root_context.SetTime(0.0)
        self._simulator.Initialize()

    def _command(self, path: JointPath, n: int) -> None:
        q, qd, qdd = path.q[n], path.qd[n], path.qdd[n]
        self._states.FixValue(self._context, np.concatenate([q, qd]))
        self._efforts.FixValue(self._context, self._dynamics.efforts(q, qd, qdd))
