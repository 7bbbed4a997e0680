"""Hand in a Drake plant: inertia and kinematics of the URDF, PD control, contacts."""

from typing import Any

import numpy as np
import pytest
import trimesh
from pydrake.geometry import HydroelasticContactRepresentation
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from lis_grasp.robots.hand import Hand
from lis_grasp.robots.shipped_models import HAND_NAMES, model_path
from lis_grasp.simulation.drake.hand_plant import HandInPlant, add_hand_model
from lis_grasp.simulation.drake.lift import WristInPlant
from lis_grasp.simulation.drake.link_plant import add_visuals
from lis_grasp.simulation.drake.object_plant import add_object_body

TIME_STEP = 0.002


@pytest.fixture(scope="module", params=HAND_NAMES)
def hand(request: pytest.FixtureRequest) -> Hand:
    return Hand.load(request.param)


def fixed_hand(hand: Hand) -> tuple[Any, Any, Any, HandInPlant]:
    """Return diagram, plant, scene graph and hand, its base welded to the world."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, TIME_STEP)
    added = add_hand_model(plant, hand)
    plant.WeldFrames(plant.world_frame(), added.base.body_frame())
    plant.Finalize()
    return builder.Build(), plant, scene_graph, added


def test_the_mass_matrix_is_that_of_the_urdf_parsed_by_drake(hand: Hand) -> None:
    _, plant, _, added = fixed_hand(hand)
    parsed = MultibodyPlant(TIME_STEP)  # motors with gains are for discrete plants
    Parser(parsed).AddModels(str(model_path(f"hands/{hand.name}/{hand.name}.urdf")))
    base = parsed.GetBodyByName(hand.base_link).body_frame()
    parsed.WeldFrames(parsed.world_frame(), base)
    parsed.Finalize()
    q = 0.3 * hand.lower + 0.7 * hand.upper
    contexts = [plant.CreateDefaultContext(), parsed.CreateDefaultContext()]
    added.set_joint_positions(contexts[0], q)
    positions = np.zeros(parsed.num_positions())
    moving = [joint for joint in hand.joints if joint.index >= 0]
    theirs = [parsed.GetJointByName(joint.name).velocity_start() for joint in moving]
    positions[theirs] = [float(joint.position(q)) for joint in moving]
    parsed.SetPositions(contexts[1], positions)
    ours = [plant.GetJointByName(joint.name).velocity_start() for joint in moving]
    ours_M = plant.CalcMassMatrix(contexts[0])[np.ix_(ours, ours)]
    their_M = parsed.CalcMassMatrix(contexts[1])[np.ix_(theirs, theirs)]
    np.testing.assert_allclose(ours_M, their_M, atol=1e-12)  # kg m^2, of order 1e-3


def test_link_poses_are_those_of_the_hands_kinematics(hand: Hand) -> None:
    _, plant, _, added = fixed_hand(hand)
    context = plant.CreateDefaultContext()
    q = np.random.default_rng(0).uniform(hand.lower, hand.upper)
    added.set_joint_positions(context, q)
    for link, X in hand.forward_kinematics(hand.X_LH, q).items():
        np.testing.assert_allclose(added.X_WL(context, link), X, atol=1e-13)
    np.testing.assert_allclose(added.X_WH(context), hand.X_LH, atol=1e-13)
    np.testing.assert_array_equal(added.joint_positions(context), q)


def test_joints_follow_commands_in_the_hands_order(hand: Hand) -> None:
    diagram, plant, _, added = fixed_hand(hand)
    simulator = Simulator(diagram)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    q = np.random.default_rng(1).uniform(hand.lower, hand.upper)
    added.set_joint_positions(context, 0.5 * (hand.lower + hand.upper))
    desired = np.concatenate([q, np.zeros(len(q))])
    plant.get_desired_state_input_port(added.instance).FixValue(context, desired)
    simulator.AdvanceTo(1.0)
    reached = [plant.GetPositions(context)[joint.position_start()] for joint in added.joints]
    # Gravity is compensated, so the PD law has no steady error; after 1 s (damping over stiffness
    # is 20 ms and less) what is left is far below a thousandth of the way.
    np.testing.assert_allclose(reached, q, atol=1e-3 * np.ptp([hand.lower, hand.upper]))


def test_the_wrist_starts_at_its_pose_and_takes_roll_pitch_yaw_in_the_world() -> None:
    hand = Hand.load("wsg50")
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, TIME_STEP)
    added = add_hand_model(plant, hand)
    X_WB = trimesh.transformations.euler_matrix(0.4, -0.7, 1.1)
    X_WB[:3, 3] = [0.1, 0.2, 0.3]
    wrist = WristInPlant(plant, added, X_WB)
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    base = added.base
    np.testing.assert_allclose(
        plant.EvalBodyPoseInWorld(context, base).GetAsMatrix4(), X_WB, atol=1e-12
    )
    target = np.array([0.01, 0.02, -0.03, 0.1, 0.2, -0.3])
    port = plant.get_desired_state_input_port(wrist._instance)
    port.FixValue(context, np.concatenate([target, np.zeros(6)]))
    plant.get_desired_state_input_port(added.instance).FixValue(context, np.zeros(4))
    simulator.AdvanceTo(1.0)
    turn = trimesh.transformations.euler_matrix(*target[3:], axes="sxyz")
    expected = np.eye(4)
    expected[:3, :3] = turn[:3, :3] @ X_WB[:3, :3]
    expected[:3, 3] = X_WB[:3, 3] + target[:3]
    reached = plant.EvalBodyPoseInWorld(context, base).GetAsMatrix4()
    np.testing.assert_allclose(reached, expected, atol=1e-4)  # 50 times the slowest time constant


def test_an_object_weighs_and_balances_like_its_solid() -> None:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, TIME_STEP)
    sides = np.array([0.1, 0.06, 0.04])
    mesh = trimesh.creation.box(extents=sides).apply_translation([0.02, 0.0, 0.01])
    body = add_object_body(plant, mesh, mass=0.3).body
    plant.Finalize()
    spatial = body.default_spatial_inertia()
    assert spatial.get_mass() == pytest.approx(0.3)
    np.testing.assert_allclose(spatial.get_com(), [0.02, 0.0, 0.01], atol=1e-12)
    central = spatial.Shift(spatial.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    expected = 0.3 / 12.0 * (sides @ sides - sides**2)
    np.testing.assert_allclose(np.diag(central), expected, rtol=1e-9)


def test_an_object_keeps_its_hole() -> None:
    hand = Hand.load("wsg50")
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, TIME_STEP)
    added = add_hand_model(plant, hand)
    # Opened, the left dome (6 mm in radius) is in the middle of a hole of 20 mm radius.
    base = added.base.body_frame()
    plant.WeldFrames(plant.world_frame(), base, RigidTransform([-0.065, 0.0, -0.069]))
    ring = trimesh.creation.torus(major_radius=0.03, minor_radius=0.01)
    body = add_object_body(plant, ring, mass=0.2).body
    plant.WeldFrames(plant.world_frame(), body.body_frame())
    plant.Finalize()
    root = builder.Build().CreateDefaultContext()
    context = plant.GetMyMutableContextFromRoot(root)

    def links_in_contact(opening: float) -> set[str]:
        added.set_joint_positions(context, np.array([opening, 0.0]))
        query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(root))
        surfaces = query.ComputeContactSurfaces(HydroelasticContactRepresentation.kPolygon)
        ids = {identity for surface in surfaces for identity in (surface.id_M(), surface.id_N())}
        return {link for identity, link in added.link_of_geometry.items() if identity in ids}

    assert links_in_contact(0.055) == set()
    assert "left_tip" in links_in_contact(0.07)  # the dome reaches 21 mm from the middle


def test_a_coupled_joint_follows_its_leader_while_it_moves() -> None:
    hand = Hand.load("barrett")
    diagram, plant, _, added = fixed_hand(hand)
    simulator = Simulator(diagram)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    added.set_joint_positions(context, np.zeros(4))
    goal = np.array([0.6, 0.9, 0.3, 1.2])
    port = plant.get_desired_state_input_port(added.instance)
    port.FixValue(context, np.concatenate([goal, np.zeros(4)]))
    for time in (0.05, 0.2, 3.0):
        simulator.AdvanceTo(time)
        q = np.array([joint.get_angle(context) for joint in added.joints])
        for joint, follower in added.links.followers:
            # Drake's constraint is a stiff spring: a thousandth of a radian at the start.
            assert joint.get_angle(context) == pytest.approx(float(follower.position(q)), abs=2e-3)
    np.testing.assert_allclose(q, goal, atol=2e-2)


def test_a_hand_is_seen_where_its_links_are(hand: Hand) -> None:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, TIME_STEP)
    added = add_hand_model(plant, hand)
    add_visuals(plant, hand, added.links)
    plant.Finalize()
    seen = plant.GetVisualGeometriesForBody
    shown = {link for link, body in added.links.bodies.items() if seen(body)}
    assert {geometry.link for geometry in hand.link_geometries} <= shown
    assert {visual.link for visual in hand.visuals} <= shown
    inspector = scene_graph.model_inspector()
    for visual in hand.visuals:
        poses = [inspector.GetPoseInFrame(g) for g in seen(added.links.bodies[visual.link])]
        assert any(X.IsNearlyEqualTo(RigidTransform(visual.X_LG), 1e-12) for X in poses)
