"""Diagrams of users: a table, an object, a hand on a wrist under PD control, and the systems."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, DiagramBuilder, EventStatus, LeafSystem
from pydrake.trajectories import PiecewisePose

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


class GraspAndLift(LeafSystem):
    """Passes the explorer's commands on; when it is done, grasps as planned, and lifts."""

    DURATION = 9.0  # [s]

    def __init__(self, joints: int) -> None:
        super().__init__()
        make = AbstractValue.Make
        self._X = self.DeclareAbstractInputPort("X_WG", make(RigidTransform()))
        self._grasp = self.DeclareAbstractInputPort("grasp", make((0.0, RigidTransform())))
        self._state = self.DeclareVectorInputPort("joint_state", 2 * joints)
        self._done = self.DeclareVectorInputPort("done", 1)
        for name in ("pregrasp_positions", "joint_positions", "squeeze_efforts"):
            self.DeclareVectorInputPort(name, joints)
        index = self.DeclareAbstractState(make(None))
        needs = {self._X.ticket(), self._state.ticket(), self.time_ticket()}
        needs |= {self.abstract_state_ticket(index)}
        self.DeclareAbstractOutputPort(
            "X_WG_out", lambda: make(RigidTransform()), self._pose, needs
        )
        self.DeclareVectorOutputPort("state_out", 2 * joints, self._joints, needs)
        self.DeclareVectorOutputPort("efforts", joints, self._efforts, needs)
        self.DeclarePeriodicUnrestrictedUpdateEvent(0.1, 0.0, self._begin)

    def _begin(self, context: Context, state: Any) -> Any:
        if self._plan(context) is not None or not self._done.Eval(context)[0]:
            return EventStatus.DidNothing()
        cost, X_WG = self._grasp.Eval(context)
        assert cost < 1.0
        names = ("pregrasp_positions", "joint_positions", "squeeze_efforts")
        vectors = [self.GetInputPort(name).Eval(context) for name in names]
        q = self._state.Eval(context)
        X0 = self._X.Eval(context)
        away = X_WG @ RigidTransform([0.0, 0.0, -0.15])  # the hand approaches along its z
        up = RigidTransform(X0.rotation(), np.append(X0.translation()[:2], 0.45))
        high = RigidTransform(X0.rotation(), np.append(away.translation()[:2], 0.45))
        above = RigidTransform(away.rotation(), high.translation())
        lifted = RigidTransform(X_WG.rotation(), X_WG.translation() + [0.0, 0.0, 0.15])
        poses = [X0, up, high, above, away, X_WG, X_WG, lifted]  # the last probe ended beside it
        start = context.get_time()
        path = PiecewisePose.MakeLinear([0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 6.0, self.DURATION], poses)
        state.get_mutable_abstract_state(0).set_value((start, path, q[: len(q) // 2], vectors))
        return EventStatus.Succeeded()

    def _plan(self, context: Context) -> Any:
        return context.get_abstract_state(0).get_value()

    def _pose(self, context: Context, output: Any) -> None:
        plan = self._plan(context)
        if plan is None:
            output.set_value(self._X.Eval(context))
        else:
            elapsed = min(context.get_time() - plan[0], self.DURATION)
            output.set_value(plan[1].GetPose(elapsed))

    def _joints(self, context: Context, output: Any) -> None:
        plan = self._plan(context)
        if plan is None:
            output.SetFromVector(self._state.Eval(context))
            return
        start, _, before, (opened, closed, _) = plan
        elapsed = context.get_time() - start
        part = np.clip(elapsed / 2.0, 0.0, 1.0)
        q = before + part * (opened - before)
        q = q + np.clip(elapsed - 5.0, 0.0, 1.0) * (closed - q)
        output.SetFromVector(np.append(q, np.zeros(len(q))))

    def _efforts(self, context: Context, output: Any) -> None:
        plan = self._plan(context)
        squeeze = 0.0 if plan is None else np.clip(context.get_time() - plan[0] - 5.5, 0.0, 1.0)
        output.SetFromVector(np.zeros(output.size()) if plan is None else squeeze * plan[3][2])


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
    lifts: bool = False
    time_step: float = 0.002
    scheme: str = ""  # of integration; Drake's own where it is empty

    def __post_init__(self) -> None:
        builder = DiagramBuilder()
        config = MultibodyPlantConfig(
            time_step=self.time_step,
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
        self.wrist = hand.add_wrist(builder)
        for system in (self.sensor, self.estimator, self.planner, self.explorer):
            builder.AddSystem(system)
        connect = builder.Connect
        for name in ("contact_results", "body_poses"):
            connect(plant.GetOutputPort(name), self.sensor.GetInputPort(name))
        connect(self.sensor.contacts, self.estimator.get_input_port())
        connect(self.sensor.contacts, self.explorer.GetInputPort("contacts"))
        for system in (self.explorer, self.planner):
            connect(self.estimator.estimate, system.GetInputPort("estimate"))
        connect(self.explorer.GetOutputPort("listening"), self.sensor.GetInputPort("enable"))
        connect(self.wrist.get_output_port(), plant.get_applied_spatial_force_input_port())
        joints = plant.get_desired_state_input_port(hand.instance)
        if not self.lifts:
            connect(self.explorer.X_WG, self.wrist.GetInputPort("X_WG"))
            connect(self.explorer.GetOutputPort("joint_state"), joints)
            return
        lift = builder.AddSystem(GraspAndLift(len(hand.joints)))
        for system in (self.explorer, self.planner):
            for i in range(system.num_output_ports()):
                port = system.get_output_port(i)
                if lift.HasInputPort(port.get_name()):
                    connect(port, lift.GetInputPort(port.get_name()))
        connect(lift.GetOutputPort("X_WG_out"), self.wrist.GetInputPort("X_WG"))
        connect(lift.GetOutputPort("state_out"), joints)
        connect(lift.GetOutputPort("efforts"), plant.get_actuation_input_port(hand.instance))

    def build(self) -> Simulator:
        """Build the Diagram, with the hand at its home."""
        self.diagram = self.builder.Build()
        simulator = Simulator(self.diagram)
        if self.scheme:
            ApplySimulatorConfig(SimulatorConfig(integration_scheme=self.scheme), simulator)
        root = simulator.get_mutable_context()
        context = self.plant.GetMyMutableContextFromRoot(root)
        self.plant.SetFreeBodyPose(context, self.in_plant.base, self.home)
        if self.free:
            X_WO = self.X_WE @ RigidTransform(list(self.center))
            self.plant.SetFreeBodyPose(context, self.body, X_WO)
        postures = self.in_plant.hand.probe_postures.values()
        self.in_plant.set_joint_positions(context, next(iter(postures)).joint_positions)
        self.simulator = simulator
        return simulator

    def value(self, port: Any) -> Any:
        """Return the value of a system's output port now."""
        context = port.get_system().GetMyContextFromRoot(self.simulator.get_context())
        return port.Eval(context)
