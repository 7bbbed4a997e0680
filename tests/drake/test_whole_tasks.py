"""Whole tasks in the user's own Diagram: explore and lift, an arm, and manipulation's station."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from diagrams import GraspAndLift, OwnDiagram
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from lis_grasp import Hand, surface_error
from lis_grasp.arms.station import Station, Table
from lis_grasp.drake import HapticExplorer, SurfaceEstimator, TouchSensor, add_hand, add_object
from lis_grasp.exploration import Workspace
from lis_grasp.robots.arm import Arm
from lis_grasp.simulation.drake.arm_plant import add_arm, ignore_mounting

BOX = trimesh.creation.box([0.06, 0.08, 0.12])


@pytest.mark.slow
@pytest.mark.filterwarnings("error::lis_grasp.exceptions.LisGraspWarning")  # estimates grow
def test_a_free_box_is_explored_grasped_and_lifted_in_one_simulation() -> None:
    own = OwnDiagram(obj=BOX, free=True, explorer={"touches": 14}, lifts=True)
    simulator = own.build()
    X_WO = own.plant.EvalBodyPoseInWorld
    plant_context = own.plant.GetMyContextFromRoot(simulator.get_context())
    while not own.value(own.explorer.GetOutputPort("done"))[0]:
        simulator.AdvanceTo(simulator.get_context().get_time() + 1.0)
        assert simulator.get_context().get_time() < 120.0
    moved = X_WO(plant_context, own.body).translation() - own.center
    assert np.linalg.norm(moved) < 0.5e-3
    mesh = own.value(own.estimator.estimate).mesh
    error = surface_error(mesh, BOX.copy().apply_translation(own.center))
    assert error.rmsd < 1e-3
    simulator.AdvanceTo(simulator.get_context().get_time() + GraspAndLift.DURATION + 2.0)
    assert X_WO(plant_context, own.body).translation()[2] > own.center[2] + 0.1


@pytest.mark.slow
def test_an_arm_touches_and_returns_home_without_collisions() -> None:
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(
        time_step=0.002,
        contact_model="hydroelastic_with_fallback",
        discrete_contact_approximation="lagged",
    )
    plant, scene_graph = AddMultibodyPlant(config, builder)
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    station = Station.make(
        Arm.load("iiwa14"),
        Hand.load("wsg50"),
        RigidTransform([-0.6, 0, 0]).GetAsMatrix4(),
        table=Table(0.0),
    )
    hand = add_hand(plant, station.hand)
    q_hand = next(iter(station.hand.probe_postures.values())).joint_positions
    arm = add_arm(plant, station, hand, q_hand)
    plant.set_gravity_enabled(hand.instance, False)
    body = add_object(plant, BOX)
    X_WO = RigidTransform([0.0, 0.0, 0.06])
    plant.WeldFrames(plant.world_frame(), body.body_frame(), X_WO)
    plant.Finalize()
    ignore_mounting(scene_graph.collision_filter_manager(), arm, None)
    space = Workspace(0.03, np.array([0.0, 0.0, 0.06]), 0.12, 0.0)
    sensor = builder.AddSystem(TouchSensor(plant, hand, feels=[body], space=space))
    estimator = builder.AddSystem(SurfaceEstimator(table=0.0))
    explorer = builder.AddSystem(HapticExplorer(hand, space, station=station, touches=2))
    connect, into = builder.Connect, plant.get_desired_state_input_port
    for name in ("contact_results", "body_poses"):
        connect(plant.GetOutputPort(name), sensor.GetInputPort(name))
    connect(sensor.contacts, estimator.get_input_port())
    connect(sensor.contacts, explorer.GetInputPort("contacts"))
    connect(estimator.estimate, explorer.GetInputPort("estimate"))
    connect(explorer.GetOutputPort("listening"), sensor.GetInputPort("enable"))
    connect(explorer.GetOutputPort("joint_state"), into(hand.instance))
    connect(explorer.GetOutputPort("arm_state"), into(arm.links.instance))
    simulator = Simulator(builder.Build())
    root = simulator.get_mutable_context()
    context = plant.GetMyMutableContextFromRoot(root)
    port = plant.get_actuation_input_port(arm.links.instance)
    port.FixValue(context, np.zeros(len(station.arm.joint_names)))
    explorer_context = explorer.GetMyContextFromRoot(root)
    home = explorer.GetOutputPort("arm_state").Eval(explorer_context)[: port.size()]
    arm.place(context, home, np.zeros(port.size()))
    hand.set_joint_positions(context, q_hand)
    wrong = set()
    while not explorer.GetOutputPort("done").Eval(explorer_context)[0]:
        simulator.AdvanceTo(root.get_time() + 0.1)
        assert root.get_time() < 60.0
        results = plant.get_contact_results_output_port().Eval(context)
        for i in range(results.num_hydroelastic_contacts()):
            surface = results.hydroelastic_contact_info(i).contact_surface()
            pair = {surface.id_M(), surface.id_N()}
            wrong |= {arm.link_of_geometry[g] for g in pair if g in arm.link_of_geometry}
    exploration = explorer.exploration.Eval(explorer_context)
    assert not wrong
    assert len(exploration.contacts) == 2
    faces = np.abs(exploration.contacts.points - X_WO.translation()) - BOX.extents / 2.0
    assert np.abs(faces.max(axis=1)).max() < 1e-6  # on the box
    np.testing.assert_allclose(plant.GetPositions(context, arm.links.instance), home, atol=0.01)


def test_a_hand_added_by_the_hook_of_manipulations_station_feels() -> None:
    stations = pytest.importorskip("manipulation.station")
    scenario = stations.LoadScenario(
        data="""
plant_config:
  time_step: 0.002
  contact_model: hydroelastic_with_fallback
  discrete_contact_approximation: lagged
directives: []
model_drivers:
  hand: !JointStiffnessDriver
    gains:
      left_slide: {kp: 5000, kd: 50}
      right_slide: {kp: 5000, kd: 50}
"""
    )
    made = {}

    def add(parser: object) -> None:
        plant = parser.plant()
        world = plant.world_frame()
        made["hand"] = add_hand(plant, "wsg50", parent=world)
        made["body"] = add_object(plant, BOX)
        plant.WeldFrames(world, made["body"].body_frame(), RigidTransform([0.0, 0.0, 0.125]))

    builder = DiagramBuilder()
    station = builder.AddSystem(
        stations.MakeHardwareStation(scenario, parser_prefinalize_callback=add)
    )
    plant = station.GetSubsystemByName("plant")
    sensor = builder.AddSystem(TouchSensor(plant, made["hand"], feels=[made["body"]]))
    for name in ("contact_results", "body_poses"):
        builder.Connect(station.GetOutputPort(name), sensor.GetInputPort(name))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    root = simulator.get_mutable_context()
    context = station.GetMyMutableContextFromRoot(root)
    station.GetInputPort("hand.desired_state").FixValue(context, np.zeros(4))
    station.GetInputPort("hand.tau_feedforward").FixValue(context, np.zeros(2))
    simulator.AdvanceTo(0.02)
    assert len(sensor.contacts.Eval(sensor.GetMyContextFromRoot(root)))
