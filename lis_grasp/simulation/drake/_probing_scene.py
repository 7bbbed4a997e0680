"""Drake scene of a probe: an object, fixed or free, and a hand that moves along one line."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import trimesh
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import RigidBody

from lis_grasp.arms.station import Station
from lis_grasp.arms.use import ArmUse
from lis_grasp.contacts import Contacts
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes.object_mass import GRAVITY, USUAL_FRICTION
from lis_grasp.shapes.solids import merge_flat_faces
from lis_grasp.simulation.drake._plant_scene import PlantScene
from lis_grasp.simulation.drake._probe_carriers import ProbeArm, ProbeRail
from lis_grasp.simulation.drake.hand_plant import add_hand_model
from lis_grasp.simulation.drake.object_plant import (
    FreeObject,
    add_object_body,
    add_support,
    add_table,
)
from lis_grasp.typing import FloatArray
from lis_grasp.world import ALONE, Surroundings

_TIME_STEP = 0.002  # [s]
# After a touch the hand retreats until the object is slower than this [m/s] over this many steps,
# for this time at most [s]. Contact with the table makes it tremble by micrometres from step to
# step.
_STILL = 5e-4
_STEPS_OF_REST = 20
_LONGEST_SETTLING = 2.0
# Rolling resistance: its moment is the weight's at a lever of 0.01 radii, as for wood on wood. It
# falls to 0 below this angular speed [rad/s].
_ROLLING_RESISTANCE = 0.01
_ROLLING = 0.05


class ProbingScene:
    """A Drake simulation of a hand on a rail and an object; W is the frame of the probes.

    One plant serves every probe: `place` sets the poses of rail, hand and object, and locks their
    joints for the motion. The joint of a `free` object stays unlocked. Rolling meets a
    resistance. The hand feels contacts with more normal force than a `threshold` [N], of the object
    and of the bodies beside it, the `surroundings`, given in W.
    """

    time_step = _TIME_STEP

    def __init__(
        self,
        hand: Hand,
        mesh: trimesh.Trimesh,
        threshold: float,
        *,
        free: FreeObject | None = None,
        station: Station | None = None,
        arm_use: ArmUse | None = None,
        surroundings: Surroundings = ALONE,
    ) -> None:
        self._scene = scene = PlantScene(
            _TIME_STEP,
            surroundings=surroundings,
            # Two rigid meshes meet by points.
            contact_model="hydroelastic_with_fallback" if len(surroundings) else "hydroelastic",
            use_sampled_output_ports=False,  # contact results right after a placement
        )
        plant = scene.plant
        friction = USUAL_FRICTION if free is None else free.friction
        self._hand = add_hand_model(plant, hand, friction=friction)
        self.carrier: ProbeRail | ProbeArm = (
            ProbeRail(plant, self._hand)
            if station is None
            else ProbeArm(plant, self._hand, station, arm_use)
        )
        self._free, self._threshold = free is not None, threshold
        support = table = None
        resisted: dict[RigidBody, float] = {}
        if free is None:
            self._object = add_object_body(plant, mesh, mass=1.0, friction=friction)
            plant.set_gravity_enabled(self._object.body.model_instance(), False)
        else:
            # Contact with the table costs by the triangles of the faces on it.
            faces = merge_flat_faces(mesh)
            self._object = add_object_body(plant, faces, mass=free.mass, friction=friction)
            resisted[self._object.body] = _resistance(free.mass, mesh)
        if scene.surroundings is not None:
            for body in surroundings.free:
                assert body.inertial is not None
                moment = _resistance(body.inertial.mass, body.mesh)
                resisted[scene.surroundings.bodies[body.name]] = moment
        # Without an arm, the planned motion avoids the table.
        if station is not None and station.table is not None:
            table = add_table(plant, station.table.height, under=mesh)
        if free is not None:
            height = free.support_height
            support = add_support(plant, height, friction, under=mesh, mass=free.mass)
        scene.finalize(self._hand, self._object, support=support, table=table, threshold=threshold)
        self.carrier.connect(scene)
        # Drake gives a body without a joint this one: six degrees of freedom.
        joints = [plant.GetJointIndices(body.model_instance())[0] for body in resisted]
        self._rolling = [
            (body.index(), plant.get_joint(joint), moment)
            for (body, moment), joint in zip(resisted.items(), joints, strict=True)
        ]
        self._fingers_port = plant.get_desired_state_input_port(self._hand.instance)
        self._forces_port = plant.get_applied_spatial_force_input_port()

    @property
    def X_WO(self) -> FloatArray:
        """Current pose of the object, shape (4, 4)."""
        return np.asarray(self._scene.object_joint.GetPose(self._scene.context).GetAsMatrix4())

    @property
    def X_WH(self) -> FloatArray:
        """Current pose of the palm, shape (4, 4)."""
        return self._hand.X_WH(self._scene.context)

    @property
    def joint_positions(self) -> FloatArray:
        """Current positions of the hand's joints, shape (J,)."""
        return self._hand.joint_positions(self._scene.context)

    @property
    def poses_beside(self) -> dict[str, FloatArray]:
        """Current poses (4, 4) of the free bodies beside the object that were touched."""
        beside, resting = self._scene.surroundings, self._scene.resting
        poses = {} if beside is None else beside.poses(self._scene.context)
        return {name: X for name, X in poses.items() if name not in resting}

    @property
    def forces_beside(self) -> dict[str, float]:
        """Largest force [N] on each body beside the object so far, of hand, arm or object."""
        return self._scene.largest_pushes

    def place(
        self,
        q: FloatArray,
        X_WB: FloatArray,
        direction: FloatArray,
        X_WO: FloatArray,
        q_arm: FloatArray | None = None,
        beside: Mapping[str, FloatArray] = MappingProxyType({}),
    ) -> None:
        """Set everything to the start of a motion along `direction` (3,), at rest.

        `q` are the joints (J,), `X_WB` is the pose (4, 4) of the base link, `X_WO` the object's,
        `q_arm` are the joint positions of an arm, `beside` the poses of free bodies by name.
        """
        scene, context = self._scene, self._scene.context
        scene.unlock_object()
        scene.stop()
        self._hand.set_joint_positions(context, q)
        self.carrier.place(X_WB, direction, q_arm)
        scene.place_object(X_WO)
        scene.place_surroundings(beside)
        if not self._free:
            scene.lock_object()
        self._fingers_port.FixValue(context, np.concatenate([q, np.zeros_like(q)]))

    def start_motion(self, travelled: float, speed: float) -> None:
        """Set the hand `travelled` [m] along its motion, at a speed [m/s], without lag."""
        self.carrier.start(travelled, speed)
        self._scene.restart()

    def step(self, travelled: float, speed: float) -> None:
        """Simulate one time step towards a commanded position [m] and speed [m/s]."""
        self.command(travelled, speed)
        self.advance()

    def command(self, travelled: float, speed: float) -> None:
        """Command a position [m] and a speed [m/s] for the next time step."""
        self.carrier.command(travelled, speed)
        if self._rolling:
            self._resist_rolling()

    def advance(self) -> None:
        """Simulate one time step as commanded."""
        self._scene.step(of="a touch")
        self.carrier.check()

    def retreat(self, travelled: float, speed: float) -> None:
        """Retreat from `travelled` [m] at a speed [m/s] until all that can move rests."""
        before = self._places()
        for n in range(1, round(_LONGEST_SETTLING / _TIME_STEP) + 1):
            self.step(travelled - n * speed * _TIME_STEP, -speed)
            if n % _STEPS_OF_REST == 0:
                now = self._places()
                most = max(map(_motion, before, now))
                if most < _STILL * _STEPS_OF_REST * _TIME_STEP:
                    return
                before = now

    def _places(self) -> list[FloatArray]:
        return [self.X_WO, *self.poses_beside.values()]

    def _resist_rolling(self) -> None:
        """Apply the moments of rolling resistance to all that is free, for one step."""
        loads = []
        for body, joint, resistance in self._rolling:
            turn = joint.get_angular_velocity(self._scene.context)
            load = ExternallyAppliedSpatialForce()
            load.body_index = body
            moment = -resistance / max(float(np.linalg.norm(turn)), _ROLLING) * turn
            load.F_Bq_W = SpatialForce(tau=moment, f=np.zeros(3))
            loads.append(load)
        self._forces_port.FixValue(self._scene.context, loads)

    def touch(self) -> Contacts:
        """Return what the touch sensor feels, in W: flat parts of contacts above the threshold.

        The forces belong to the commanded step: Drake computes them once for both.
        """
        return self._scene.touch()

    def felt_beside(self) -> dict[str, int]:
        """Return how many of the contacts of `touch` are with each body beside the object."""
        return self._scene.felt_beside(self._threshold)


def _resistance(mass: float, mesh: trimesh.Trimesh) -> float:
    """Return the largest moment of rolling resistance [N m], taken at half the least extent."""
    radius = 0.5 * float(np.min(mesh.extents))
    return _ROLLING_RESISTANCE * mass * GRAVITY * radius


def _motion(X: FloatArray, Y: FloatArray) -> float:
    """Return the larger of displacement and turn, at a lever of 0.1 m, between poses [m]."""
    turn = np.linalg.norm(Y[:3, :3] - X[:3, :3]) / np.sqrt(2.0)  # of small angles
    return float(max(np.linalg.norm(Y[:3, 3] - X[:3, 3]), 0.1 * turn))
