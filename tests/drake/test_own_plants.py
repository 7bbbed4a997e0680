"""Plants as users set them: contact methods, time steps, integrators, weight, and who is who."""

from __future__ import annotations

import itertools
import warnings
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from diagrams import OwnDiagram
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    DefaultProximityProperties,
    Mesh,
    ProximityProperties,
    SceneGraphConfig,
)
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import FixedOffsetFrame, ModelInstanceIndex
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    GetIntegrationSchemes,
    Simulator,
    SimulatorConfig,
)
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource

from lis_grasp import Hand
from lis_grasp.drake import (
    GraspPlanner,
    HapticExplorer,
    SurfaceEstimator,
    TouchSensor,
    add_hand,
    add_object,
)
from lis_grasp.exceptions import InexactContactWarning, InvalidOptionError
from lis_grasp.exploration import Workspace
from lis_grasp.robots.shipped_models import HAND_NAMES, model_path
from lis_grasp.simulation.drake.pd_wrist import _FREQUENCY

STEP = 0.002
WSG50 = str(model_path("hands/wsg50/wsg50.urdf"))
SPACE = Workspace(step=0.03, center=np.zeros(3), size=0.12)
DOWN = RotationMatrix.MakeXRotation(np.pi)
PLACES = (-0.04, 0.04)  # of two bodies along the closing direction [m]
COMPLIANT = (
    "<drake:compliant_hydroelastic/><drake:hydroelastic_modulus>1e7</drake:hydroelastic_modulus>"
)


def plant_of(time_step: float = STEP) -> tuple[DiagramBuilder, Any, Any]:
    if not time_step and "cenic" not in GetIntegrationSchemes():
        pytest.skip("this Drake has no CENIC, and no PD control in continuous plants")
    builder = DiagramBuilder()
    return builder, *AddMultibodyPlantSceneGraph(builder, time_step)


def block(*size: float, at: tuple[float, float, float]) -> trimesh.Trimesh:
    return trimesh.creation.box(size).apply_translation(at)


def channel(folder: Path, properties: str, mesh: trimesh.Trimesh | None = None) -> Path:
    """Write the SDF of a block with a slot of 40 mm, open to its top at 60 mm, floor at 20 mm."""
    slotted = trimesh.boolean.union(
        [
            block(0.08, 0.06, 0.02, at=(0.0, 0.0, 0.01)),
            block(0.02, 0.06, 0.06, at=(-0.03, 0.0, 0.03)),
            block(0.02, 0.06, 0.06, at=(0.03, 0.0, 0.03)),
        ]
    )
    (mesh or slotted).export(folder / "u.obj")
    path = folder / "u.sdf"
    path.write_text(
        '<sdf version="1.9" xmlns:drake="http://drake.mit.edu"><model name="u"><link name="u">'
        '<collision name="c"><geometry><mesh><uri>u.obj</uri></mesh></geometry>'
        f"<drake:proximity_properties>{properties}</drake:proximity_properties></collision>"
        "</link></model></sdf>"
    )
    return path


def hold(plant: Any, simulator: Simulator, hand: Any, q: Any = 0.01) -> None:
    """Fix the desired state of a hand's joints."""
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    desired = np.full(len(hand.joints), q)
    hand.set_joint_positions(context, desired)
    port = plant.get_desired_state_input_port(hand.instance)
    port.FixValue(context, np.append(desired, np.zeros(len(desired))))


def felt_in_slot(
    path: Path, tip: float, *, default: str = "undefined", time_step: float = STEP
) -> tuple[Any, list[Any]]:
    """Return contacts and warnings of fingertips that are held at a height [m] in the slot."""
    builder, plant, scene_graph = plant_of(time_step)
    defaults = DefaultProximityProperties(compliance_type=default)
    scene_graph.set_config(SceneGraphConfig(default_proximity_properties=defaults))
    (instance,) = Parser(plant).AddModels(str(path))
    body = plant.GetBodyByName("u", instance)
    plant.WeldFrames(plant.world_frame(), body.body_frame())
    along_slot = RotationMatrix.MakeZRotation(np.pi / 2) @ DOWN
    X_WG = RigidTransform(along_slot, [0.0, 0.0, tip + 0.075])  # tips reach 75 mm ahead
    hand = add_hand(plant, "wsg50", parent=plant.world_frame(), X_PG=X_WG)
    plant.Finalize()
    sensor = builder.AddSystem(TouchSensor(plant, hand, feels=[body], threshold=0.01))
    results = plant.get_contact_results_output_port()
    builder.Connect(results, sensor.GetInputPort("contact_results"))
    simulator = Simulator(builder.Build())
    hold(plant, simulator, hand)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        simulator.AdvanceTo(3.0 * STEP)
    felt = sensor.contacts.Eval(sensor.GetMyContextFromRoot(simulator.get_context()))
    return felt, [w.message for w in caught if isinstance(w.message, InexactContactWarning)]


@pytest.mark.by_default("0.0--undefined-points", "0.002--undefined-points", "0.0--compliant-hull")
@pytest.mark.parametrize(
    ("properties", "default", "method"),
    [(COMPLIANT, "undefined", "hull"), ("", "compliant", "hull"), ("", "undefined", "points")],
)
@pytest.mark.parametrize("time_step", [STEP, 0.0])
def test_contact_with_the_hull_of_a_mesh_is_named(
    tmp_path: Path, properties: str, default: str, method: str, time_step: float
) -> None:
    # 40 mm above the slot's floor, in the middle of free space.
    path = channel(tmp_path, properties)
    felt, named = felt_in_slot(path, 0.0595, default=default, time_step=time_step)
    assert len(felt)
    assert {(w.link, w.body, w.method) for w in named} == {
        (f"hand::{link}", "u::u", method) for link in set(felt.fingers)
    }
    assert len(named) == len({w.link for w in named})


def test_contact_with_the_true_shape_is_exact_and_not_warned_of(tmp_path: Path) -> None:
    rigid = channel(tmp_path, "<drake:rigid_hydroelastic/>")
    for tip, touches in ((0.0595, False), (0.0195, True)):
        felt, named = felt_in_slot(rigid, tip)
        assert named == []
        assert (len(felt) > 0) == touches
    assert_allclose(felt.points[:, 2], 0.02, atol=1e-6)  # the floor; the tips are 0.5 mm in it
    convex = channel(tmp_path, COMPLIANT, block(0.08, 0.06, 0.06, at=(0.0, 0.0, 0.03)))
    felt, named = felt_in_slot(convex, 0.0595)
    assert len(felt)
    assert named == []


def test_contact_with_the_hull_of_a_links_own_mesh_is_named(tmp_path: Path) -> None:
    # A compliant channel on a fingertip is over a post, which is 1 mm in its slot and its hull.
    channel(tmp_path, COMPLIANT)
    builder, plant, _ = plant_of()
    body = add_object(plant, trimesh.creation.box((0.02, 0.02, 0.04)), name="post")
    plant.WeldFrames(plant.world_frame(), body.body_frame())
    hand_file = Parser(plant).AddModels(WSG50)[0]
    tip = plant.GetBodyByName("left_tip", hand_file)
    properties = ProximityProperties()
    AddCompliantHydroelasticProperties(0.01, 1e7, properties)
    AddContactMaterial(friction=CoulombFriction(0.8, 0.8), properties=properties)
    X_WB = RigidTransform(DOWN, [0.0, 0.0, 0.3])
    links = Hand.load("wsg50").forward_kinematics(np.eye(4), [0.01, 0.01])
    X_BT = RigidTransform(np.linalg.inv(links["body"]) @ links["left_tip"])
    above = RigidTransform(DOWN, [0.0, 0.0, 0.079])  # of the channel, whose rim is at 19 mm
    X_TC = (X_WB @ X_BT).inverse() @ above
    mesh = Mesh(str(tmp_path / "u.obj"))
    plant.RegisterCollisionGeometry(tip, X_TC, mesh, "channel", properties)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("body", hand_file), X_WB)
    hand = add_hand(plant, "wsg50", instance=hand_file)
    plant.Finalize()
    sensor = builder.AddSystem(TouchSensor(plant, hand, feels=[body], threshold=0.01))
    results = plant.get_contact_results_output_port()
    builder.Connect(results, sensor.GetInputPort("contact_results"))
    simulator = Simulator(builder.Build())
    hold(plant, simulator, hand)
    with pytest.warns(InexactContactWarning) as caught:
        simulator.AdvanceTo(3.0 * STEP)
    named = {(w.message.link, w.message.body, w.message.method) for w in caught}
    assert named == {("wsg50::left_tip", "post::post", "hull")}
    assert "of wsg50::left_tip:" in str(caught[0].message)


def test_a_compliant_mesh_of_tetrahedra_is_felt_as_it_is(tmp_path: Path) -> None:
    path = channel(tmp_path, COMPLIANT)
    write_vtk(tmp_path / "u.vtk")
    path.write_text(path.read_text().replace("u.obj", "u.vtk"))
    for tip, touches in ((0.0595, False), (0.0195, True)):
        felt, named = felt_in_slot(path, tip)
        assert named == []
        assert (len(felt) > 0) == touches
    # The skin of 1 MPa and the mesh of 10 MPa share a penetration of 0.5 mm.
    assert_allclose(felt.points[:, 2], 0.0197, atol=3e-4)


def write_vtk(path: Path) -> None:
    """Write the channel of `channel` as tetrahedra on a grid of 10 mm (Kuhn's six of each cube)."""
    cells = [
        (i, j, k)
        for i in range(-4, 4)
        for j in range(-3, 3)
        for k in range(6)
        if k < 2 or i not in (-2, -1, 0, 1)
    ]
    numbers: dict[tuple[int, ...], int] = {}
    rows = []
    for cell in cells:
        for order in itertools.permutations(range(3)):
            corners = [np.array(cell)]
            for axis in order:
                corners.append(corners[-1] + np.eye(3, dtype=int)[axis])
            if np.linalg.det(np.diff(corners, axis=0)) < 0.0:
                corners[1], corners[2] = corners[2], corners[1]
            rows.append([numbers.setdefault(tuple(c), len(numbers)) for c in corners])
    points = "\n".join(" ".join(f"{0.01 * x:.9g}" for x in point) for point in numbers)
    lines = "\n".join("4 " + " ".join(map(str, row)) for row in rows)
    path.write_text(
        "# vtk DataFile Version 3.0\nchannel\nASCII\nDATASET UNSTRUCTURED_GRID\n"
        f"POINTS {len(numbers)} double\n{points}\nCELLS {len(rows)} {5 * len(rows)}\n{lines}\n"
        f"CELL_TYPES {len(rows)}\n" + "10\n" * len(rows)
    )


def test_several_bodies_are_felt_at_once_each_where_it_is() -> None:
    builder, plant, _ = plant_of()
    block_mesh = trimesh.creation.box((0.02, 0.04, 0.06))
    bodies = [add_object(plant, block_mesh, name=name) for name in ("one", "two")]
    X_WG = RigidTransform(DOWN, [0.0, 0.0, 0.03 + 0.075 - 0.0005])
    hand = add_hand(plant, "wsg50", parent=plant.world_frame(), X_PG=X_WG)
    for body, x in zip(bodies, PLACES, strict=True):
        plant.WeldFrames(plant.world_frame(), body.body_frame(), RigidTransform([x, 0.0, 0.0]))
    plant.Finalize()
    sensors = {}
    for names in (("one",), ("two",), ("one", "two")):
        feels = [body for body in bodies if body.name() in names]
        sensors[names] = builder.AddSystem(TouchSensor(plant, hand, feels=feels))
    results = plant.get_contact_results_output_port()
    for sensor in sensors.values():
        builder.Connect(results, sensor.GetInputPort("contact_results"))
    simulator = Simulator(builder.Build())
    hold(plant, simulator, hand, 0.03)
    simulator.AdvanceTo(3.0 * STEP)
    root = simulator.get_context()
    felt = {n: s.contacts.Eval(s.GetMyContextFromRoot(root)) for n, s in sensors.items()}
    for name, x in zip(("one", "two"), PLACES, strict=True):
        assert len(felt[name,])
        assert (np.abs(felt[name,].points[:, 0] - x) < 0.01 + 1e-6).all()
    both = {tuple(p) for p in felt["one", "two"].points}
    assert both == {tuple(p) for name in ("one", "two") for p in felt[name,].points}


def test_a_hull_that_cannot_be_seen_in_a_finalized_plant_is_not_passed_over(
    tmp_path: Path,
) -> None:
    builder, plant, _ = plant_of()
    (instance,) = Parser(plant).AddModels(str(channel(tmp_path, COMPLIANT)))
    (found,) = Parser(plant).AddModels(WSG50)
    body = plant.GetBodyByName("u", instance)
    plant.WeldFrames(plant.world_frame(), body.body_frame())
    X_WG = RigidTransform(DOWN, [0.0, 0.0, 0.1345])
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("body", found), X_WG)
    plant.Finalize()
    hand = add_hand(plant, "wsg50", instance=found)
    sensor = builder.AddSystem(TouchSensor(plant, hand, feels=[body], threshold=0.01))
    results = plant.get_contact_results_output_port()
    builder.Connect(results, sensor.GetInputPort("contact_results"))
    simulator = Simulator(builder.Build())
    hold(plant, simulator, hand)
    with pytest.warns(InexactContactWarning) as caught:
        simulator.AdvanceTo(3.0 * STEP)
    assert {w.message.method for w in caught} == {"unknown"}


def on_box(time_step: float, scheme: str = "") -> Any:
    """Return what is felt in 10 ms by fingertips that are held 0.5 mm in a box of 60 mm."""
    builder, plant, _ = plant_of(time_step)
    body = add_object(plant, "box")  # from -60 to 60 mm
    plant.WeldFrames(plant.world_frame(), body.body_frame())
    X_WG = RigidTransform(DOWN, [0.0, 0.0, 0.06 + 0.075 - 0.0005])
    hand = add_hand(plant, "wsg50", parent=plant.world_frame(), X_PG=X_WG)
    plant.Finalize()
    sensor = builder.AddSystem(TouchSensor(plant, hand, feels=[body]))
    results = plant.get_contact_results_output_port()
    builder.Connect(results, sensor.GetInputPort("contact_results"))
    simulator = Simulator(builder.Build())
    if scheme:
        ApplySimulatorConfig(SimulatorConfig(integration_scheme=scheme), simulator)
    hold(plant, simulator, hand)
    simulator.AdvanceTo(0.01)
    return sensor.contacts.Eval(sensor.GetMyContextFromRoot(simulator.get_context()))


@pytest.mark.by_default("cenic")
@pytest.mark.parametrize("scheme", ["runge_kutta3", "cenic"])
def test_a_touch_in_a_continuous_plant_is_that_of_a_discrete_one(scheme: str) -> None:
    felt, expected = on_box(0.0, scheme), on_box(STEP)
    assert felt.fingers == expected.fingers
    assert set(expected.fingers) >= {"left_tip", "right_tip"}
    assert_allclose(felt.points[:, 2], 0.06, atol=1e-6)
    # Pressed in by the same 0.5 mm; the hand's joints yield by micrometres.
    assert_allclose(felt.points, expected.points, atol=1e-5)
    assert_allclose(felt.forces, expected.forces, rtol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("time_step", "scheme"), [(0.0, "runge_kutta3"), (0.0, "cenic"), (0.01, "")]
)
def test_an_exploration_is_exact_in_every_plant(time_step: float, scheme: str) -> None:
    box = trimesh.creation.box([0.06, 0.08, 0.12])
    options = {"touches": 3}
    own = OwnDiagram(obj=box, explorer=options, time_step=time_step, scheme=scheme)
    simulator = own.build()
    simulator.set_monitor(own.explorer.ended)
    simulator.AdvanceTo(40.0)
    exploration = own.value(own.explorer.exploration)
    assert exploration.ended == "3 contacts made"
    off = np.abs(exploration.contacts.points - own.center) - box.extents / 2.0
    assert_allclose(off.max(axis=1), 0.0, atol=5e-5)


def test_a_hand_with_coupled_joints_is_refused_in_a_continuous_plant() -> None:
    _, plant, _ = plant_of(0.0)
    with pytest.raises(InvalidOptionError) as refused:
        add_hand(plant, "barrett")
    assert refused.value.option == "plant"


@pytest.mark.parametrize("period", [0.0, -0.1, float("nan")])
def test_a_period_that_never_comes_is_refused(period: float) -> None:
    _, plant, _ = plant_of()
    hand = add_hand(plant, "wsg50")
    add_object(plant, "box")
    plant.Finalize()
    with pytest.raises(InvalidOptionError) as refused:
        TouchSensor(plant, hand, period=period)
    assert refused.value.option == "period"


def floating(hand: str, time_step: float, *, by_parser: bool = False) -> tuple[Any, Any, Any]:
    """Return plant, hand and simulator of a hand that a wrist pulls up by 50 mm."""
    builder, plant, _ = plant_of(time_step)
    instance = Parser(plant).AddModels(WSG50) if by_parser else None
    added = add_hand(plant, hand, instance=instance)
    plant.Finalize()
    wrist = added.add_wrist(builder)
    builder.Connect(wrist.get_output_port(), plant.get_applied_spatial_force_input_port())
    goal = AbstractValue.Make(RigidTransform(DOWN, [0.0, 0.0, 0.45]))
    source = builder.AddSystem(ConstantValueSource(goal))
    builder.Connect(source.get_output_port(), wrist.GetInputPort("X_WG"))
    q = np.clip(0.01, added.hand.lower, added.hand.upper)[added.actuated]
    fingers = builder.AddSystem(ConstantVectorSource(np.append(q, np.zeros(len(q)))))
    desired = plant.get_desired_state_input_port(added.instance)
    builder.Connect(fingers.get_output_port(), desired)
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetFreeBodyPose(context, added.base, RigidTransform(DOWN, [0.0, 0.0, 0.4]))
    added.set_joint_positions(context, np.clip(0.01, added.hand.lower, added.hand.upper))
    return plant, added, simulator


def height(plant: Any, hand: Any, simulator: Simulator) -> float:
    context = plant.GetMyContextFromRoot(simulator.get_context())
    return float(plant.EvalBodyPoseInWorld(context, hand.base).translation()[2])


@pytest.mark.parametrize("time_step", [0.002, 0.01, 0.05, 0.1])
def test_the_wrist_is_critically_damped_at_every_time_step(time_step: float) -> None:
    # Backward Euler of x'' = -w^2 x - 2 w x': x_n = (1 + n a / (1 + a)) / (1 + a)^n, a = w h. The
    # fingers slide across the motion, so that the hand moves as one body.
    plant, hand, simulator = floating("wsg50", time_step)
    a = _FREQUENCY * time_step
    for n in range(1, 21):
        simulator.AdvanceTo(n * time_step)
        expected = 0.05 * (1.0 + n * a / (1.0 + a)) / (1.0 + a) ** n
        assert 0.45 - height(plant, hand, simulator) == pytest.approx(expected, abs=1e-9)


@pytest.mark.by_default("wsg50")
@pytest.mark.parametrize(
    "hand",
    [pytest.param(n, marks=pytest.mark.slow if n == "allegro" else ()) for n in HAND_NAMES],
)
def test_the_wrist_holds_every_hand_at_the_longest_steps(hand: str) -> None:
    for time_step in (0.007, 0.1):
        plant, added, simulator = floating(hand, time_step)
        for n in range(1, 21):
            simulator.AdvanceTo(0.1 * n)
            assert abs(0.45 - height(plant, added, simulator)) < 0.05
        assert height(plant, added, simulator) == pytest.approx(0.45, abs=1e-4)


def test_a_hand_of_a_parser_hangs_as_high_as_one_that_is_added() -> None:
    for by_parser in (False, True):
        plant, hand, simulator = floating("wsg50", STEP, by_parser=by_parser)
        simulator.AdvanceTo(0.6)
        # What is left of 50 mm after 300 steps is 1e-10 of it; the weight would be 6 mm.
        assert height(plant, hand, simulator) == pytest.approx(0.45, abs=1e-8)


def test_a_wrist_is_refused_for_a_hand_that_is_held_or_has_weight() -> None:
    builder, plant, _ = plant_of()
    welded = add_hand(plant, "wsg50", name="welded", parent=plant.world_frame())
    (parsed,) = Parser(plant).AddModels(WSG50)
    with pytest.raises(InvalidOptionError) as refused:
        welded.add_wrist(builder)
    assert refused.value.option == "builder"
    plant.Finalize()
    heavy = add_hand(plant, "wsg50", instance=parsed)
    for hand, name in ((welded, "welded"), (heavy, "wsg50")):
        with pytest.raises(InvalidOptionError) as refused:
            hand.add_wrist(builder)
        assert (refused.value.option, refused.value.value) == ("hand", name)
    with pytest.raises(InvalidOptionError) as refused:
        heavy.add_wrist(plant)
    assert refused.value.option == "builder"


def test_a_body_a_frame_and_a_name_are_the_same_parent() -> None:
    _, plant, _ = plant_of()
    brick = add_object(plant, "box", name="brick")
    X_PG = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.1, 0.0, 0.2])
    parents = (brick, brick.body_frame(), "brick")
    poses = (X_PG, X_PG.GetAsMatrix4(), X_PG.GetAsMatrix4().tolist())
    hands = [
        add_hand(plant, "wsg50", name=f"hand_{k}", parent=parent, X_PG=pose)
        for k, (parent, pose) in enumerate(zip(parents, poses, strict=True))
    ]
    shifted = plant.AddFrame(FixedOffsetFrame("shifted", brick.body_frame(), X_PG))
    hands.append(add_hand(plant, "wsg50", name="hand_3", parent=shifted))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    X_WB = plant.EvalBodyPoseInWorld(context, brick)
    for hand in hands:
        X_WG = plant.EvalBodyPoseInWorld(context, hand.base)
        assert (X_WB @ X_PG).IsNearlyEqualTo(X_WG, 1e-12)


def test_an_instance_is_found_by_index_name_and_what_a_parser_returns() -> None:
    _, plant, _ = plant_of()
    instances = Parser(plant).AddModels(WSG50)
    for given in (instances, instances[0], "wsg50"):
        assert add_hand(plant, "wsg50", instance=given).instance == instances[0]


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("parent", 3),
        ("parent", "nobody"),
        ("parent", RigidTransform()),
        ("parent", ModelInstanceIndex(2)),
        ("X_PG", np.zeros((4, 4))),
        ("X_PG", [0.0, 0.0, 0.1]),
        ("X_PG", "above"),
        ("instance", 1),
        ("instance", "left"),
        ("instance", ModelInstanceIndex(77)),
        ("instance", []),
        ("friction", -0.1),
        ("friction", "rough"),
        ("modulus", 0.0),
        ("gains", (1.0, 2.0)),
        ("gains", 5.0),
        ("name", 7),
    ],
)
def test_a_hand_with_an_option_of_the_wrong_kind_is_refused(option: str, value: Any) -> None:
    _, plant, _ = plant_of()
    options: dict[str, Any] = {"parent": plant.world_frame()} if option == "X_PG" else {}
    count = plant.num_bodies()
    with pytest.raises(InvalidOptionError) as refused:
        add_hand(plant, "wsg50", **(options | {option: value}))
    assert refused.value.option == option
    assert plant.num_bodies() == count  # before any work


def test_a_pose_without_a_parent_is_refused() -> None:
    _, plant, _ = plant_of()
    with pytest.raises(InvalidOptionError) as refused:
        add_hand(plant, "wsg50", X_PG=RigidTransform())
    assert refused.value.option == "parent"


def test_what_is_no_plant_or_of_another_is_refused() -> None:
    _, plant, scene_graph = plant_of()
    _, other, _ = plant_of()
    for add in (lambda: add_hand(scene_graph, "wsg50"), lambda: add_object(None, "box")):
        with pytest.raises(InvalidOptionError) as refused:
            add()
        assert refused.value.option == "plant"
    with pytest.raises(InvalidOptionError) as refused:
        add_hand(plant, "wsg50", parent=other.world_frame())
    assert refused.value.option == "parent"


@pytest.mark.parametrize("add", [add_hand, add_object])
def test_arguments_in_another_order_are_answered_before_any_work(add: Any) -> None:
    _, plant, _ = plant_of()
    count = plant.num_bodies()
    for arguments, option in (
        (("wsg50", plant), "plant"),
        ((plant, plant), {add_hand: "hand", add_object: "obj"}[add]),
        ((plant, None), {add_hand: "hand", add_object: "obj"}[add]),
        ((plant, "part", "part.stl"), add.__name__),
        ((plant, "box", Path("part.stl"), 0.3), add.__name__),
    ):
        with pytest.raises(InvalidOptionError) as refused:
            add(*arguments)
        assert refused.value.option == option
    assert plant.num_bodies() == count
    assert next(iter(signature(add).parameters)) == "plant"  # for editors and the reference


def test_systems_without_their_hand_name_it() -> None:
    _, plant, _ = plant_of()
    hand = add_hand(plant, "wsg50")
    plant.Finalize()
    for make in (
        lambda: TouchSensor(hand, plant),
        lambda: TouchSensor(plant, "wsg50"),
        lambda: HapticExplorer(SPACE, hand),
        lambda: HapticExplorer("wsg50", SPACE),
        lambda: HapticExplorer(hand, "box"),
        lambda: GraspPlanner("wsg50"),
        lambda: SurfaceEstimator(0.1),
    ):
        with pytest.raises(InvalidOptionError) as refused:
            make()
        assert refused.value.option in ("plant", "hand", "space", "estimator")


def test_bodies_frames_and_instances_are_felt_by_index_or_name() -> None:
    _, plant, _ = plant_of()
    brick = add_object(plant, "box", name="brick")
    hand = add_hand(plant, "wsg50")
    plant.Finalize()
    geometries = set(plant.GetCollisionGeometriesForBody(brick))
    for feels in (brick, [brick], "brick", ["brick"], brick.model_instance(), brick.body_frame()):
        sensor = TouchSensor(plant, hand, feels=feels, frame=brick.body_frame())
        assert set(sensor._felt_geometries) == geometries
    for option, value in (
        ("feels", 5),
        ("feels", [5]),
        ("feels", "nothing"),
        ("frame", 5),
        ("frame", brick.model_instance()),
        ("X_WE", np.ones(3)),
    ):
        with pytest.raises(InvalidOptionError) as refused:
            TouchSensor(plant, hand, **{option: value})
        assert refused.value.option == option


@pytest.mark.by_default("3", "x")
@pytest.mark.parametrize("value", ["x", 3, np.zeros(3), [], RigidTransform(), object()])
def test_an_option_of_another_kind_is_refused_and_not_passed_to_drake(value: Any) -> None:
    _, plant, _ = plant_of()
    hand, _ = add_hand(plant, "wsg50"), add_object(plant, "box")
    plant.Finalize()
    home = RigidTransform(DOWN, [0.0, 0.0, 0.4])
    makers: dict[str, Any] = {
        "threshold spacing period": lambda **o: TouchSensor(plant, hand, **o),
        "noise frame": lambda **o: TouchSensor(plant, hand, **o),
        "touches probe_speed period": lambda **o: HapticExplorer(hand, SPACE, home=home, **o),
        "noise policy station q_home": lambda **o: HapticExplorer(hand, SPACE, home=home, **o),
        "candidates count": lambda **o: GraspPlanner(hand, **o),
        "prior obstacles": lambda **o: GraspPlanner(hand, **o),
        "noise": lambda **o: SurfaceEstimator(**o),
        "mass friction": lambda **o: add_object(plant_of()[1], "box", **o),
    }
    for options, make in makers.items():
        for option in options.split():
            is_number = option in "threshold spacing period touches probe_speed candidates count"
            if isinstance(value, int) and (is_number or option in ("mass", "friction")):
                continue
            with pytest.raises(InvalidOptionError) as refused:
                make(**{option: value})
            assert refused.value.option == option


def test_poses_of_systems_are_transforms_or_matrices() -> None:
    _, plant, _ = plant_of()
    hand = add_hand(plant, "wsg50")
    plant.Finalize()
    X = RigidTransform(DOWN, [0.0, 0.0, 0.4])
    explorer = HapticExplorer(hand, SPACE, X_WE=np.eye(4), home=X.GetAsMatrix4())
    start = explorer.X_WG.Eval(explorer.CreateDefaultContext())
    assert start.IsNearlyEqualTo(X, 1e-12)
    makers: list[tuple[str, Any]] = [
        ("home", lambda pose: HapticExplorer(hand, SPACE, home=pose)),
        ("X_WE", lambda pose: HapticExplorer(hand, SPACE, home=X, X_WE=pose)),
        ("X_WE", lambda pose: GraspPlanner(hand, X_WE=pose)),
        ("X_WE", lambda pose: SurfaceEstimator(X_WE=pose)),
    ]
    for option, make in makers:
        with pytest.raises(InvalidOptionError) as refused:
            make([0.0, 0.0, 0.4])
        assert refused.value.option == option
