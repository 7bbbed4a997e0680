"""Drake scene of a probe: an object, fixed or free, and a hand that moves along one line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import (
    QuaternionFloatingJoint,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from lis_grasp.arms.station import Station
from lis_grasp.exceptions import require_positive
from lis_grasp.lifting.arm_use import ArmUse
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.link_tree import by_joint_kind
from lis_grasp.shapes.solids import merge_flat_faces
from lis_grasp.simulation.drake.advance_simulation import advance
from lis_grasp.simulation.drake.contact_patches import Patch, link_contacts
from lis_grasp.simulation.drake.hand_plant import (
    PROBING_SKIN,
    add_hand,
    ignore_self_collision,
)
from lis_grasp.simulation.drake.object_plant import add_object, add_support, add_table, let_rest
from lis_grasp.simulation.drake.probe_arm import ProbeArm
from lis_grasp.simulation.drake.probe_rail import ProbeCarrier, ProbeRail
from lis_grasp.typing import FloatArray

_TIME_STEP = 0.002  # [s]
_FRICTION = 0.8
_STIFFNESS = {"revolute": 5.0, "prismatic": 5_000.0}  # [N m/rad], [N/m]
_DAMPING = {"revolute": 0.1, "prismatic": 50.0}  # [N m s/rad], [N s/m]

# After a touch the hand retreats until the object is slower than this [m/s] over so many steps, for
# this time at most [s]. Contact with the table makes it tremble by micrometres from step to step.
_STILL, _STEPS_OF_REST, _LONGEST_SETTLING = 5e-4, 20, 2.0
# Rolling resistance: its moment is that of the weight at a lever of 0.01 radii, as of wood on wood.
# It falls to 0 below this angular speed [rad/s].
_ROLLING_RESISTANCE, _ROLLING = 0.01, 0.05


@dataclass(frozen=True, slots=True)
class FreeObject:
    """An object that is free to move on a table.

    Parameters
    ----------
    support_height
        Height of the table in O [m].
    mass
        [kg], of uniform density.
    friction
        Coulomb coefficient, of object on table and of hand on object.

    Raises
    ------
    InvalidOptionError
        If mass or friction is not above 0.
    """

    support_height: float
    mass: float = 0.2
    friction: float = 0.5

    def __post_init__(self) -> None:
        require_positive(mass=self.mass, friction=self.friction)


class ProbingScene:
    """A Drake simulation of a hand on a rail and an object; W is the frame of the probes.

    One plant serves every probe: `place` sets the poses of rail, hand and object, and locks their
    joints for the motion. The joint of a `free` object stays unlocked, and rolling meets a
    resistance.
    """

    time_step = _TIME_STEP

    def __init__(
        self,
        hand: Hand,
        mesh: trimesh.Trimesh,
        free: FreeObject | None = None,
        station: Station | None = None,
        arm_use: ArmUse | None = None,
    ) -> None:
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
        self._free = free is not None
        self._resistance = 0.0 if free is None else _rolling_resistance(mesh, free.mass)
        self._add_hand(hand, free.friction if free is not None else _FRICTION)
        self.carrier: ProbeCarrier = (
            ProbeRail(plant, self._hand)
            if station is None
            else ProbeArm(plant, self._hand, station, arm_use)
        )
        self._add_object(mesh, free)
        # Without an arm, the planned motion avoids the table.
        table: GeometryId | None = None
        if station is not None and station.table is not None:
            table = add_table(plant, station.table.height, _FRICTION, under=mesh)
        support: GeometryId | None = None
        if free is not None:
            height = free.support_height
            support = add_support(plant, height, free.friction, under=mesh, mass=free.mass)
        plant.Finalize()
        ignore_self_collision(scene_graph, self._hand)
        let_rest(scene_graph, self._object_geometry, support=support, table=table)
        self._simulator = Simulator(builder.Build())
        self._root_context = self._simulator.get_mutable_context()
        self._context = plant.GetMyMutableContextFromRoot(self._root_context)
        filters = scene_graph.collision_filter_manager(
            scene_graph.GetMyMutableContextFromRoot(self._root_context)
        )
        self.carrier.connect(self._context, filters, table)
        self._fingers_port = plant.get_desired_state_input_port(self._hand.instance)
        self._forces_port = plant.get_applied_spatial_force_input_port()
        self._results_port = plant.get_contact_results_output_port()
        self._steps = 0

    def _add_hand(self, hand: Hand, friction: float) -> None:
        plant = self._plant
        self._hand = add_hand(
            plant,
            hand,
            stiffness=by_joint_kind(hand, **_STIFFNESS),
            damping=by_joint_kind(hand, **_DAMPING),
            friction=friction,
            hydroelastic_modulus=PROBING_SKIN,
        )

    def _add_object(self, mesh: trimesh.Trimesh, free: FreeObject | None) -> None:
        plant = self._plant
        instance = plant.AddModelInstance("object")
        body, self._object_geometry = add_object(
            plant,
            # Contact with the table costs by the triangles of the faces on it.
            mesh if free is None else merge_flat_faces(mesh),
            mass=1.0 if free is None else free.mass,
            friction=_FRICTION if free is None else free.friction,
            instance=instance,
        )
        self._fixture = plant.AddJoint(
            QuaternionFloatingJoint("fixture", plant.world_frame(), body.body_frame())
        )
        if free is None:
            plant.set_gravity_enabled(instance, False)
        else:
            self._body = body

    @property
    def X_WO(self) -> FloatArray:
        """Current pose of the object, shape (4, 4)."""
        return np.asarray(self._fixture.GetPose(self._context).GetAsMatrix4())

    @property
    def X_WH(self) -> FloatArray:
        """Current pose of the palm, shape (4, 4)."""
        return self._hand.X_WH(self._context)

    @property
    def joint_positions(self) -> FloatArray:
        """Current positions of the hand's joints, shape (J,)."""
        return self._hand.joint_positions(self._context)

    def place(
        self,
        q: FloatArray,
        X_WB: FloatArray,
        direction: FloatArray,
        X_WO: FloatArray,
        q_arm: FloatArray | None = None,
    ) -> None:
        """Set everything to the start of a motion along `direction` (3,), at rest.

        `q` are the joints (J,), `X_WB` is the pose (4, 4) of the base link, `X_WO` the object's,
        `q_arm` are the joint positions of an arm.
        """
        plant, context = self._plant, self._context
        self._fixture.Unlock(context)
        plant.SetVelocities(context, np.zeros(plant.num_velocities()))
        self._hand.set_joint_positions(context, q)
        self.carrier.place(X_WB, direction, q_arm)
        # A pose that was moved to another frame is a rotation but for rounding.
        R_WO = RotationMatrix.ProjectToRotationMatrix(X_WO[:3, :3])
        self._fixture.SetPose(context, RigidTransform(R_WO, X_WO[:3, 3]))
        if not self._free:
            self._fixture.Lock(context)
        self._fingers_port.FixValue(context, np.concatenate([q, np.zeros_like(q)]))

    def start_motion(self, travelled: float, speed: float) -> None:
        """Set the hand `travelled` [m] along its motion, at a speed [m/s], without lag."""
        self.carrier.start(travelled, speed)
        # Time starts at 0, so that its rounding is the same for every motion.
        self._root_context.SetTime(0.0)
        self._simulator.Initialize()
        self._steps = 0

    def step(self, travelled: float, speed: float) -> None:
        """Simulate one time step towards a commanded position [m] and speed [m/s]."""
        self.command(travelled, speed)
        self.advance()

    def command(self, travelled: float, speed: float) -> None:
        """Command a position [m] and a speed [m/s] for the next time step."""
        self.carrier.command(travelled, speed)
        if self._free:
            self._resist_rolling()

    def advance(self) -> None:
        """Simulate one time step as commanded."""
        self._steps += 1
        advance(self._simulator, self._steps * _TIME_STEP, of="a touch")
        self.carrier.check()

    def retreat(self, travelled: float, speed: float) -> None:
        """Retreat from `travelled` [m] at a speed [m/s] until the object rests."""
        before = self.X_WO
        for n in range(1, round(_LONGEST_SETTLING / _TIME_STEP) + 1):
            self.step(travelled - n * speed * _TIME_STEP, -speed)
            if n % _STEPS_OF_REST == 0:
                now = self.X_WO
                if _motion(before, now) < _STILL * _STEPS_OF_REST * _TIME_STEP:
                    return
                before = now

    def _resist_rolling(self) -> None:
        """Apply the moment of rolling resistance to the free object, for one step."""
        turn = self._fixture.get_angular_velocity(self._context)
        load = ExternallyAppliedSpatialForce()
        load.body_index = self._body.index()
        moment = -self._resistance / max(float(np.linalg.norm(turn)), _ROLLING) * turn
        load.F_Bq_W = SpatialForce(tau=moment, f=np.zeros(3))
        self._forces_port.FixValue(self._context, [load])

    def patches(self, threshold: float) -> list[Patch]:
        """Return the flat parts, in W, of contacts with a normal force above `threshold` [N].

        The forces are those of the step that was commanded: Drake computes them once for both.
        """
        contacts = link_contacts(
            self._results_port.Eval(self._context),
            self._object_geometry,
            self._hand.link_of_geometry,
        )
        return [
            part
            for contact in contacts
            if contact.normal_force > threshold
            for part in contact.flat_parts()
        ]


def _motion(X: FloatArray, Y: FloatArray) -> float:
    """Return the larger of displacement and turn, at a lever of 0.1 m, between poses [m]."""
    turn = np.linalg.norm(Y[:3, :3] - X[:3, :3]) / np.sqrt(2.0)  # of small angles
    return float(max(np.linalg.norm(Y[:3, 3] - X[:3, 3]), 0.1 * turn))


def _rolling_resistance(mesh: trimesh.Trimesh, mass: float) -> float:
    """Return the moment of rolling resistance [N m], at the radius of half the least extent."""
    return _ROLLING_RESISTANCE * mass * 9.81 * 0.5 * float(np.min(mesh.extents))
