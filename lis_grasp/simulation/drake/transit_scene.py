"""Transits of an arm in Drake: a plant in which it moves between probes."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import trimesh

from lis_grasp.arms.station import Station
from lis_grasp.arms.trajectory import TIME_STEP, JointTrajectory
from lis_grasp.arms.use import ArmUse
from lis_grasp.simulation.drake._plant_scene import PlantScene
from lis_grasp.simulation.drake.arm_plant import ArmWatch, add_arm
from lis_grasp.simulation.drake.hand_plant import add_hand_model
from lis_grasp.simulation.drake.object_plant import add_object_body, add_table
from lis_grasp.typing import FloatArray
from lis_grasp.world import ALONE, Surroundings

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
    surroundings
        The true bodies beside the object, in W.
    """

    def __init__(
        self,
        station: Station,
        mesh: trimesh.Trimesh,
        use: ArmUse,
        surroundings: Surroundings = ALONE,
    ) -> None:
        self._scene = scene = PlantScene(
            TIME_STEP, surroundings=surroundings, contact_model="hydroelastic_with_fallback"
        )
        plant, hand = scene.plant, station.hand
        self._hand = add_hand_model(plant, hand)
        posture = next(iter(hand.probe_postures.values())).joint_positions
        self._arm = add_arm(plant, station, self._hand, posture)
        obj = add_object_body(plant, mesh, mass=1.0)
        table = None
        if station.table is not None:
            table = add_table(plant, station.table.height, under=mesh)
        scene.finalize(self._hand, obj, table=table)
        for coupling in plant.GetConstraintIds():  # singular between joints that are locked
            plant.SetConstraintActiveStatus(scene.context, coupling, False)
        self._fingers = plant.get_desired_state_input_port(self._hand.instance)
        self._finger_efforts = plant.get_actuation_input_port(self._hand.instance)
        self._watch = ArmWatch(scene, self._arm, stage="transit", use=use, object_ends=True)

    def run(
        self,
        way: JointTrajectory,
        q_hand: FloatArray,
        X_WO: FloatArray,
        *,
        touch: float | None = None,
        beside: Mapping[str, FloatArray] = MappingProxyType({}),
    ) -> None:
        """Simulate a motion of the arm, with the object fixed at X_WO.

        The hand's joints are held at `q_hand`, (K,) or (N, K) at the first N times, then the last.

        `touch` is the time of the touch that begins or ends it [s], beside which a fingertip may
        graze the object; None for none. `beside` are the poses of free bodies beside the object, by
        name.

        Raises `ArmStoppedError` if the arm touches something, or a joint stays at its largest
        effort, and `SimulationError` if Drake's solver fails.
        """
        postures = np.atleast_2d(q_hand)
        self._place(way, postures[0], X_WO, beside)
        for n in range(1, len(way.times)):
            self._command(way, n)
            if n < len(postures) and not np.array_equal(postures[n], postures[n - 1]):
                self._hold(postures[n])
            self._watch.free = touch is None or abs(n * TIME_STEP - touch) > _GRAZING
            self._scene.step(of="an arm's way")
            self._watch.check()

    @property
    def forces_beside(self) -> dict[str, float]:
        """Largest force [N] on each body beside the object so far."""
        return self._scene.largest_pushes

    def _place(
        self,
        way: JointTrajectory,
        q_hand: FloatArray,
        X_WO: FloatArray,
        beside: Mapping[str, FloatArray],
    ) -> None:
        """Set everything to the start of a motion, the joints of hand and object locked."""
        scene, context = self._scene, self._scene.context
        self._hold(q_hand)
        scene.unlock_object()
        scene.place_object(X_WO)
        scene.place_surroundings(beside)
        scene.stop()
        self._arm.place(context, way.positions[0], way.velocities[0])
        scene.lock_object()
        self._finger_efforts.FixValue(context, np.zeros(len(q_hand)))
        self._command(way, 0)
        scene.restart()

    def _hold(self, q_hand: FloatArray) -> None:
        """Lock the hand's joints at positions (K,)."""
        context, links = self._scene.context, self._hand.links
        held = [*links.joints, *(joint for joint, _ in links.followers)]
        for joint in held:
            joint.Unlock(context)
        self._hand.set_joint_positions(context, q_hand)
        for joint in held:
            joint.Lock(context)
        self._fingers.FixValue(context, np.concatenate([q_hand, np.zeros_like(q_hand)]))

    def _command(self, way: JointTrajectory, n: int) -> None:
        q, qd, qdd = way.positions[n], way.velocities[n], way.accelerations[n]
        self._arm.command(self._scene.context, q, qd, qdd)
