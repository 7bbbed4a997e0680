"""Diagrams of users: a table, an object, a hand on a wrist under PD control, and the systems."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce, SpatialVelocity
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ExternallyAppliedSpatialForce,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import RigidBody
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem

from lis_grasp.drake import (
    GraspPlanner,
    HapticExplorer,
    SurfaceEstimator,
    TouchSensor,
    add_hand,
    add_object,
)
from lis_grasp.exploration import Workspace
from lis_grasp.simulation.drake.object_plant import add_table

STIFFNESS, DAMPING = np.array([20.0] * 3 + [2000.0] * 3), np.array([0.6] * 3 + [100.0] * 3)


class PdWrist(LeafSystem):
    """Pulls a floating body to a desired pose."""

    def __init__(self, body: RigidBody) -> None:
        super().__init__()
        self._index = body.index()
        make = AbstractValue.Make
        self.DeclareAbstractInputPort("X_WG", make(RigidTransform()))
        self.DeclareAbstractInputPort("body_poses", make([RigidTransform()]))
        self.DeclareAbstractInputPort("body_spatial_velocities", make([SpatialVelocity()]))
        self.DeclareAbstractOutputPort(
            "forces", lambda: make([ExternallyAppliedSpatialForce()]), self._pull
        )

    def _pull(self, context: Context, output: Any) -> None:
        goal, poses, velocities = (self.get_input_port(i).Eval(context) for i in range(3))
        X, V = poses[self._index], velocities[self._index]
        turn = (goal.rotation() @ X.rotation().inverse()).ToAngleAxis()
        error = np.append(turn.angle() * turn.axis(), goal.translation() - X.translation())
        pull = STIFFNESS * error - DAMPING * np.append(V.rotational(), V.translational())
        force = ExternallyAppliedSpatialForce()
        force.body_index = self._index
        force.F_Bq_W = SpatialForce(tau=pull[:3], f=pull[3:])
        output.set_value([force])


@dataclass
class OwnDiagram:
    """A box on a table, a floating hand, and every system of `lis_grasp.drake`."""

    obj: Any = "box"
    hand: Any = "wsg50"
    free: bool = False
    X_WE: RigidTransform = field(default_factory=RigidTransform)
    size: float = 0.12
    center: tuple[float, float, float] = (0.0, 0.0, 0.06)
    explorer: dict[str, Any] = field(default_factory=dict)
    meshcat: Any = None
    mass: float = 0.4
    contact_model: str = "hydroelastic_with_fallback"
    sampled: bool = False

    def __post_init__(self) -> None:
        builder = DiagramBuilder()
        config = MultibodyPlantConfig(
            time_step=0.002,
            contact_model=self.contact_model,
            discrete_contact_approximation="lagged",
            use_sampled_output_ports=self.sampled,
        )
        plant, self.scene_graph = AddMultibodyPlant(config, builder)
        self.plant, self.builder = plant, builder
        self.body = add_object(plant, self.obj, mass=self.mass)
        self.in_plant = hand = add_hand(plant, self.hand)
        X_WO = self.X_WE @ RigidTransform(list(self.center))
        if self.free:
            import trimesh

            add_table(plant, 0.0, under=trimesh.creation.box([0.2] * 3))
            plant.SetDefaultFloatingBaseBodyPose(self.body, X_WO)
        else:
            plant.WeldFrames(plant.world_frame(), self.body.body_frame(), X_WO)
        plant.Finalize()
        step = 0.25 * self.size
        self.space = Workspace(step, np.array(self.center), self.size, 0.0)
        X_WE = self.X_WE
        self.sensor = TouchSensor(plant, hand, feels=[self.body], X_WE=X_WE, space=self.space)
        self.estimator = SurfaceEstimator("blend", table=0.0, X_WE=X_WE, meshcat=self.meshcat)
        self.planner = GraspPlanner(hand, table=0.0, X_WE=X_WE, count=2)
        home = X_WE @ RigidTransform([0.0, 0.0, 0.5]) @ RigidTransform(np.diag([1.0, -1, -1, 1]))
        self.home = home
        self.explorer = HapticExplorer(hand, self.space, X_WE=X_WE, home=home, **self.explorer)
        self.wrist = PdWrist(hand.base)
        for system in (self.sensor, self.estimator, self.planner, self.explorer, self.wrist):
            builder.AddSystem(system)
        connect = builder.Connect
        for name in ("contact_results", "body_poses"):
            connect(plant.GetOutputPort(name), self.sensor.GetInputPort(name))
        for name in ("body_poses", "body_spatial_velocities"):
            connect(plant.GetOutputPort(name), self.wrist.GetInputPort(name))
        connect(self.sensor.contacts, self.estimator.get_input_port())
        connect(self.sensor.contacts, self.explorer.GetInputPort("contacts"))
        for system in (self.explorer, self.planner):
            connect(self.estimator.estimate, system.GetInputPort("estimate"))
        connect(self.explorer.GetOutputPort("listening"), self.sensor.GetInputPort("enable"))
        connect(self.explorer.X_WG, self.wrist.GetInputPort("X_WG"))
        connect(self.wrist.get_output_port(), plant.get_applied_spatial_force_input_port())
        joints = plant.get_desired_state_input_port(hand.instance)
        connect(self.explorer.GetOutputPort("joint_state"), joints)

    def build(self) -> Simulator:
        """Build the Diagram, with the hand at its home."""
        self.diagram = self.builder.Build()
        simulator = Simulator(self.diagram)
        root = simulator.get_mutable_context()
        context = self.plant.GetMyMutableContextFromRoot(root)
        self.plant.SetFreeBodyPose(context, self.in_plant.base, self.home)
        postures = self.in_plant.hand.probe_postures.values()
        self.in_plant.set_joint_positions(context, next(iter(postures)).joint_positions)
        self.simulator = simulator
        return simulator

    def value(self, port: Any) -> Any:
        """Return the value of a system's output port now."""
        context = port.get_system().GetMyContextFromRoot(self.simulator.get_context())
        return port.Eval(context)
