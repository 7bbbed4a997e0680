"""Systems in the user's own Diagram: exploration, estimate and grasps, and how they are wired."""

from __future__ import annotations

import warnings
from threading import Thread
from typing import Any

import numpy as np
import pytest
import trimesh
from diagrams import OwnDiagram
from numpy.testing import assert_allclose
from pydrake.geometry import Meshcat, Role
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from lis_grasp import Contacts
from lis_grasp.drake import (
    GraspPlanner,
    HapticExplorer,
    SurfaceEstimator,
    TouchSensor,
    add_hand,
    add_object,
)
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import (
    ExplorationStrategy,
    TactilePerception,
    TactileSensor,
    Workspace,
    begin,
    choose,
)
from lis_grasp.robots.shipped_models import HAND_NAMES, model_path
from lis_grasp.simulation import DynamicProber
from lis_grasp.simulation.drake.hand_plant import PROBING_SKIN
from lis_grasp.stages.estimate import Perception, estimate
from lis_grasp.stages.touch import make_policy
from lis_grasp.surfaces.contact_checks import doubt_of_side

BOX = trimesh.creation.box([0.06, 0.08, 0.12])
TOUCHES = 2
AXES = np.vstack([np.eye(3), -np.eye(3)])
SIX = Contacts(0.03 * AXES, AXES)


def explored(**options: Any) -> OwnDiagram:
    """Return a Diagram of a user after its exploration."""
    own = OwnDiagram(obj=BOX, explorer={"touches": TOUCHES}, **options)
    simulator = own.build()
    while not own.value(own.explorer.GetOutputPort("done"))[0]:
        simulator.AdvanceTo(simulator.get_context().get_time() + 0.5)
        assert simulator.get_context().get_time() < 60.0
    return own


@pytest.fixture(scope="module")
def own() -> OwnDiagram:
    return explored()


def test_each_touch_is_the_next_probe_of_the_exploration_and_that_of_the_prober(
    own: OwnDiagram,
) -> None:
    exploration = own.value(own.explorer.exploration)
    outcomes, sensor = exploration.outcomes, TactileSensor()
    assert exploration.ended == f"{TOUCHES} contacts made"
    perception = TactilePerception(Perception(sensor=sensor).make, sensor=sensor)
    policy = make_policy("spread", own.space, sensor)
    strategy = ExplorationStrategy(policy, TOUCHES, space=own.space)
    true_mesh = BOX.copy().apply_translation(own.center)
    prober, rng = DynamicProber(own.in_plant.hand, true_mesh), np.random.default_rng(0)
    for k, outcome in enumerate(outcomes):
        state = begin(perception, strategy, exploration.observations[:k])
        chosen = choose(strategy, state, rng=rng.spawn(1)[0])
        for name in ("target", "direction", "standoff", "overshoot"):
            np.testing.assert_array_equal(getattr(chosen.probe, name), getattr(outcome.probe, name))
        same = prober.probe(chosen.probe, chosen.obstacles)
        assert same.status == outcome.status == "touched"
        assert same.contacts.fingers[0] == outcome.contacts.fingers[0]
        apart = np.linalg.norm(same.contacts.points[0] - outcome.contacts.points[0])
        assert apart < 1.5e-3  # the wrist lags by 1.5 mm and bends at a touch
        cosine = same.contacts.normals[0] @ outcome.contacts.normals[0]
        assert cosine > np.cos(np.deg2rad(1.0))


def test_the_estimate_is_that_of_the_contacts(own: OwnDiagram) -> None:
    contacts = own.value(own.sensor.contacts)
    expected = estimate(contacts, "blend", support_height=0.0)
    points = np.random.default_rng(0).uniform(-0.06, 0.12, (200, 3))
    surface = own.value(own.estimator.estimate).surface
    np.testing.assert_array_equal(surface.evaluate(points), expected.evaluate(points))
    assert len(contacts.free_points)  # the explorer's sweeps carve the estimate


@pytest.mark.slow
def test_the_same_diagram_and_a_clone_in_mid_flight_give_the_same_bytes() -> None:
    felt, positions = [], []
    first, own = (OwnDiagram(obj=BOX, free=True, explorer={"touches": 2}) for _ in range(2))
    first.build().AdvanceTo(2.0)
    own.build().AdvanceTo(3.5)
    clone = Simulator(first.diagram, first.simulator.get_context().Clone())
    clone.Initialize()
    clone.AdvanceTo(3.5)
    first.simulator.AdvanceTo(3.5)
    for diagram, root in (
        (first, first.simulator.get_context()),
        (first, clone.get_context()),
        (own, own.simulator.get_context()),
    ):
        contacts = diagram.sensor.contacts.Eval(diagram.sensor.GetMyContextFromRoot(root))
        felt.append(contacts.points.tobytes() + contacts.free_points.tobytes())
        positions.append(diagram.plant.GetPositions(diagram.plant.GetMyContextFromRoot(root)))
    assert len(contacts)
    assert felt[0] == felt[1] == felt[2]
    np.testing.assert_array_equal(positions[0], positions[1])
    np.testing.assert_array_equal(positions[0], positions[2])


@pytest.mark.slow
def test_touches_are_the_same_in_a_moved_and_turned_frame(own: OwnDiagram) -> None:
    X_WE = RigidTransform(RollPitchYaw(0.0, 0.0, 0.8), [0.3, -0.2, 0.0])
    moved, expected = explored(X_WE=X_WE), own.value(own.sensor.contacts)
    contacts = moved.value(moved.sensor.contacts)
    # The contact of a dome of 6 mm on a flat face; what rounding changes is far smaller.
    assert_allclose(contacts.points, expected.points, atol=1e-5)
    assert_allclose(contacts.normals, expected.normals, atol=1e-6)


def test_a_hundred_publishes_without_a_contact_estimate_once(own: OwnDiagram) -> None:
    calls = []

    def counted(contacts: Contacts) -> Any:
        calls.append(len(contacts))
        return estimate(contacts, "gpis")

    simulator = own.simulator
    estimator, builder = SurfaceEstimator(counted), DiagramBuilder()
    felt = own.value(own.sensor.contacts)
    builder.AddSystem(estimator)
    builder.ExportInput(estimator.get_input_port(), "contacts")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    for _ in range(100):
        simulator.AdvanceTo(simulator.get_context().get_time() + 0.002)
        assert own.value(own.sensor.contacts) is felt
        diagram.GetInputPort("contacts").FixValue(context, own.value(own.sensor.contacts))
        diagram.ForcedPublish(context)
        made = estimator.estimate.Eval(estimator.GetMyContextFromRoot(context))
        assert made.surface is not None
    assert calls == [len(felt)]


def test_a_value_of_the_wrong_kind_names_system_port_and_cure() -> None:
    estimator = SurfaceEstimator()
    estimator.set_name("blend")
    context = estimator.CreateDefaultContext()
    estimator.GetInputPort("contacts").FixValue(context, "contacts.ply")
    with pytest.raises(TypeError, match="'contacts' of .*'blend'.*TouchSensor"):
        estimator.estimate.Eval(context)
    with pytest.raises(InvalidOptionError) as error:
        SurfaceEstimator("best")
    assert error.value.option == "estimator"
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.002)
    hand, space = add_hand(plant, "wsg50"), Workspace(0.03, np.zeros(3), 0.1)
    plant.Finalize()
    with pytest.raises(InvalidOptionError) as error:
        HapticExplorer(hand, space)
    assert error.value.option == "home"
    with pytest.raises(InvalidOptionError) as error:
        HapticExplorer(hand, space, home=RigidTransform(), touches=0)
    assert error.value.option == "touches"


def test_a_grasp_is_a_cost_and_a_pose_and_infinite_without_a_mesh() -> None:
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.002)
    hand = add_hand(plant, "wsg50")
    plant.Finalize()
    estimator = SurfaceEstimator("gpis")
    planner = GraspPlanner(hand, count=1, candidates=40)
    for contacts in (Contacts.empty(), SIX):
        of_estimate, context = estimator.CreateDefaultContext(), planner.CreateDefaultContext()
        estimator.get_input_port().FixValue(of_estimate, contacts)
        value = estimator.estimate.Eval(of_estimate)
        planner.get_input_port().FixValue(context, value)
        cost, X_WG = planner.grasp.Eval(context)
        search = planner.plan.Eval(context)
        efforts = planner.GetOutputPort("squeeze_efforts").Eval(context)
        if not len(contacts):
            assert (cost, len(search)) == (np.inf, 0)
            assert X_WG.IsExactlyIdentity()
            continue
        X_EG = search.best.X_OH @ np.linalg.inv(hand.hand.X_LH)
        assert_allclose(X_WG.GetAsMatrix4(), X_EG, atol=1e-12)
        assert cost == 1.0 - search.best.quality["success_probability"]
        # Both jaws press: the planned normal forces, by the principle of virtual work.
        pressed = -np.einsum("ck,ck->c", search.best.contact_forces, search.best.contact_normals)
        assert_allclose(np.abs(efforts), pressed, rtol=0.05)
        assert planner.plan.Eval(context) is search


@pytest.mark.slow
def test_meshcat_shows_contacts_estimate_and_grasps_drawn_once_from_its_thread() -> None:
    meshcat = Meshcat()
    estimator = SurfaceEstimator("gpis", meshcat=meshcat, path="own/estimate", replay=True)
    context = estimator.CreateDefaultContext()
    meshcat.StartRecording()
    for n, contacts in enumerate((SIX[:3], SIX[:3], SIX), start=1):
        context.SetTime(float(n))
        estimator.get_input_port().FixValue(context, contacts)
        estimator.ForcedPublish(context)
    assert [meshcat.HasPath(f"own/estimate/{n}/contacts") for n in (1, 2, 3)] == [True, True, False]
    assert meshcat.HasPath("own/estimate/2/mesh")
    meshcat.PublishRecording()
    assert len(meshcat.StaticHtml()) > 100_000
    # Another thread, in which Meshcat would end the program, draws nothing.
    estimator.get_input_port().FixValue(context, SIX[:5])
    thread = Thread(target=estimator.ForcedPublish, args=[context])
    thread.start()
    thread.join()
    assert not meshcat.HasPath("own/estimate/3")
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.002)
    hand = add_hand(plant, "wsg50")
    plant.Finalize()
    planner = GraspPlanner(hand, count=2, candidates=40, meshcat=meshcat, path="own/grasps")
    of_planner = planner.CreateDefaultContext()
    estimator.get_input_port().FixValue(context, SIX)
    planner.get_input_port().FixValue(of_planner, estimator.estimate.Eval(context))
    count = len(planner.plan.Eval(of_planner))
    drawn = [meshcat.HasPath(f"own/grasps/1/{k}") for k in range(3)]
    assert drawn == [True] * count + [False] * (3 - count)


@pytest.mark.by_default("wsg50")
@pytest.mark.parametrize("name", HAND_NAMES)
def test_the_packages_own_hand_from_a_parser_is_the_one_that_is_added(name: str) -> None:
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.002)
    (instance,) = Parser(plant).AddModels(str(model_path(f"hands/{name}/{name}.urdf")))
    added = add_hand(plant, name, name="added")
    found = add_hand(plant, name, instance=instance)  # a link without skin would warn
    inspector = scene_graph.model_inspector()
    np.testing.assert_array_equal(found.actuated, added.actuated)
    for first, second in zip(found.joints, added.joints, strict=True):
        one, two = (
            plant.GetJointActuatorByName(joint.name(), joint.model_instance())
            for joint in (first, second)
        )
        assert one.effort_limit() == two.effort_limit()
        assert one.get_controller_gains().p == two.get_controller_gains().p
        assert one.get_controller_gains().d == two.get_controller_gains().d
    links = [*found.link_of_geometry]
    assert sorted(found.link_of_geometry.values()) == sorted(added.link_of_geometry.values())
    assert all(inspector.CollisionFiltered(links[0], other) for other in links[1:])
    for hand in (found, added):
        for geometry in hand.link_of_geometry:
            contact = inspector.GetProximityProperties(geometry)
            modulus = contact.GetProperty("hydroelastic", "hydroelastic_modulus")
            assert modulus == PROBING_SKIN


def test_what_a_hand_in_a_plant_lacks_is_named() -> None:
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.002)
    left = add_hand(plant, "wsg50", name="left", parent=plant.world_frame())
    with pytest.raises(InvalidOptionError, match="link palm, "):
        add_hand(plant, "allegro", instance=left.instance)
    urdf = model_path("hands/wsg50/wsg50.urdf").read_text(encoding="utf-8")
    (bare,) = Parser(plant).AddModelsFromString(
        urdf.replace("<drake:compliant_hydroelastic/>", ""), "urdf"
    )
    with pytest.warns(UserWarning, match=r"links body, .* of 'wsg50' have no hydroelastic"):
        add_hand(plant, "wsg50", instance=bare)


def test_of_two_hands_in_one_plant_only_the_one_that_touches_feels() -> None:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.002)
    body = add_object(plant, BOX, name="brick")
    plant.WeldFrames(plant.world_frame(), body.body_frame())
    sensors = {}
    for name, height in (("left", 0.5), ("right", -0.125)):  # the right one reaches into the box
        X_WG = RigidTransform([0.0, 0.0, height])
        hand = add_hand(plant, "wsg50", name=name, parent=plant.world_frame(), X_PG=X_WG)
        sensors[name] = hand
    plant.Finalize()
    for name, hand in sensors.items():
        sensors[name] = builder.AddSystem(TouchSensor(plant, hand, feels=[body]))
        port = plant.get_contact_results_output_port()
        builder.Connect(port, sensors[name].GetInputPort("contact_results"))
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    for name in sensors:
        instance = plant.GetModelInstanceByName(name)
        plant.get_desired_state_input_port(instance).FixValue(context, np.zeros(4))
    simulator.AdvanceTo(0.01)
    felt = {
        name: sensor.contacts.Eval(sensor.GetMyContextFromRoot(simulator.get_context()))
        for name, sensor in sensors.items()
    }
    assert len(felt["left"]) == 0
    assert len(felt["right"]) >= 1
    assert plant.GetModelInstanceName(body.model_instance()) == "brick"


def test_what_is_added_is_seen_and_ready_for_contact() -> None:
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.002)
    hand = add_hand(plant, "allegro")
    mesh = BOX.subdivide().subdivide()
    body = add_object(plant, mesh)
    inspector = scene_graph.model_inspector()
    for each in (hand.base, body):
        assert plant.GetVisualGeometriesForBody(each)
        assert plant.GetCollisionGeometriesForBody(each)
    (geometry,) = plant.GetCollisionGeometriesForBody(body)
    assert inspector.GetProximityProperties(geometry).HasGroup("hydroelastic")
    links = list(hand.link_of_geometry)
    assert all(inspector.CollisionFiltered(links[0], other) for other in links[1:])
    assert inspector.NumGeometriesWithRole(Role.kIllustration) > len(hand.hand.links) // 2


def test_a_plant_to_which_nothing_can_be_added_is_refused_in_one_sentence() -> None:
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.002)
    add_object(plant, "box")
    with pytest.raises(InvalidOptionError) as error:
        add_object(plant, "box")
    assert error.value.option == "name"
    with pytest.raises(InvalidOptionError) as error:
        add_hand(MultibodyPlant(0.002), "wsg50")
    assert error.value.option == "plant"
    plant.Finalize()
    with pytest.raises(InvalidOptionError) as error:
        add_hand(plant, "wsg50")
    assert error.value.option == "plant"


def test_contacts_with_inward_normals_are_warned_of_once() -> None:
    axes = np.vstack([np.eye(3), -np.eye(3)])
    system = SurfaceEstimator("gpis")
    context = system.CreateDefaultContext()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        for sign, size in ((1.0, 0.03), (-1.0, 0.03), (-1.0, 0.04)):
            contacts = Contacts(size * axes, sign * axes)
            system.GetInputPort("contacts").FixValue(context, contacts)
            assert system.estimate.Eval(context).contacts == contacts
    assert [str(w.message) for w in told] == [doubt_of_side(Contacts(0.03 * axes, -axes))]
