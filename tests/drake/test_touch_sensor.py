"""Touch sensor in a Diagram of one's own: contacts, their frames, memory, and the two contacts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from lis_grasp.exceptions import InexactContactWarning, InvalidOptionError
from lis_grasp.exploration import Probe, TactileSensor, Workspace
from lis_grasp.probing.guarded_motion import GuardedMotion
from lis_grasp.robots.hand import Hand
from lis_grasp.simulation.drake._probe_carriers import ProbeRail
from lis_grasp.simulation.drake.dynamic_prober import DynamicProber
from lis_grasp.simulation.drake.hand_plant import add_hand_model
from lis_grasp.simulation.drake.object_plant import add_object_body
from lis_grasp.simulation.drake.touch_sensor import TouchSensor

STEP = 0.002
BOX = trimesh.creation.box([0.06, 0.08, 0.12])
TORUS = trimesh.creation.torus(0.04, 0.015, major_sections=48, minor_sections=24)
TUBE = trimesh.creation.annulus(0.02, 0.035, 0.1)
PROBE = Probe([0.03, 0.003, 0.004], [-1.0, 0.1, -0.05], 0.03, 0.03)


class RailedHand:
    """A hand on a rail that moves along PROBE, in a plant with a fixed or free object."""

    def __init__(
        self, hand: str, mesh: trimesh.Trimesh, *, before: float = 0.0005, **options: Any
    ) -> None:
        model = options.pop("contact_model", "hydroelastic_with_fallback")
        speed, mass = options.pop("speed", 0.1), options.pop("free_mass", None)
        builder = DiagramBuilder()
        config = MultibodyPlantConfig(
            time_step=STEP,
            contact_model=model,
            discrete_contact_approximation="lagged",
            use_sampled_output_ports=False,
        )
        plant, _ = AddMultibodyPlant(config, builder)
        self.plant: MultibodyPlant = plant
        self.hand = add_hand_model(plant, Hand.load(hand))
        rail = ProbeRail(plant, self.hand)
        self.body = add_object_body(plant, mesh, mass=mass or 1.0).body
        if mass is None:
            plant.WeldFrames(plant.world_frame(), self.body.body_frame())
        plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
        plant.Finalize()
        if options.pop("on_body", False):
            options["frame"] = self.body
        self.sensor = TouchSensor(plant, self.hand, feels=[self.body], **options)
        builder.AddSystem(self.sensor)
        course = GuardedMotion(self.hand.hand, mesh).run(PROBE)
        leg, q = course.last, course.joint_positions
        start = max(leg.length - before, 0.0)
        line = PiecewisePolynomial.FirstOrderHold(
            [0.0, 10.0], [[start + STEP * speed, start + (10.0 + STEP) * speed]]
        )
        drive = builder.AddSystem(TrajectorySource(line, output_derivative_order=1))
        fingers = builder.AddSystem(ConstantVectorSource(np.append(q, np.zeros(len(q)))))
        into = plant.get_desired_state_input_port
        builder.Connect(drive.get_output_port(), into(plant.GetModelInstanceByName("arm")))
        builder.Connect(fingers.get_output_port(), into(self.hand.instance))
        for name in ("contact_results", "body_poses"):
            builder.Connect(plant.GetOutputPort(name), self.sensor.GetInputPort(name))
        for name in ("enable", "reset"):
            builder.ExportInput(self.sensor.GetInputPort(name), name)
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        root = self.simulator.get_mutable_context()
        self.context = plant.GetMyMutableContextFromRoot(root)
        self.hand.set_joint_positions(self.context, q)
        rail._context, rail._port = self.context, into(plant.GetModelInstanceByName("arm"))
        X_OB = leg.X_OH @ self.hand.hand.forward_kinematics(np.eye(4), q)[self.hand.hand.base_link]
        rail.place(X_OB, leg.direction, None)
        rail._slider.set_translation(self.context, start)
        rail._slider.set_translation_rate(self.context, speed)
        self.fix("enable", 1.0)

    def fix(self, name: str, value: float) -> None:
        port = self.diagram.GetInputPort(name)
        port.FixValue(self.simulator.get_mutable_context(), [value])

    def felt(self, root: Any = None) -> Any:
        root = self.simulator.get_context() if root is None else root
        return self.sensor.contacts.Eval(self.sensor.GetMyContextFromRoot(root))


_MESHES = {"box": BOX, "torus": TORUS, "tube": TUBE}
_DEFAULT = {("allegro", "box"), ("wsg50", "torus"), ("barrett", "tube")}


@pytest.mark.by_default("wsg50-torus")
@pytest.mark.parametrize(
    ("hand", "mesh"),
    [
        pytest.param(
            hand,
            mesh,
            marks=() if (hand, name) in _DEFAULT else pytest.mark.slow,
            id=f"{hand}-{name}",
        )
        for hand in ("allegro", "wsg50", "barrett")
        for name, mesh in _MESHES.items()
    ],
)
def test_a_sensor_in_a_users_plant_feels_what_the_prober_feels(
    hand: str, mesh: trimesh.Trimesh
) -> None:
    expected = DynamicProber(Hand.load(hand), mesh).probe(PROBE).contacts
    scene = RailedHand(hand, mesh)
    scene.simulator.AdvanceTo(0.03)
    contacts = scene.felt()[: len(expected)]
    assert len(expected)
    assert contacts.fingers == expected.fingers
    assert_allclose(contacts.points, expected.points, atol=1e-12)  # rounding of the commands
    assert_allclose(contacts.normals, expected.normals, atol=1e-12)
    assert_allclose(contacts.forces, expected.forces, atol=1e-10)


def test_contacts_are_the_same_in_another_frame() -> None:
    X_WE = RigidTransform(RollPitchYaw(0.0, 0.0, 0.7), [0.1, -0.2, 0.3])
    world, moved = RailedHand("wsg50", BOX), RailedHand("wsg50", BOX, X_WE=X_WE)
    for scene in (world, moved):
        scene.simulator.AdvanceTo(0.03)
    expected = world.felt().in_frame(X_WE.GetAsMatrix4())
    assert_allclose(moved.felt().points, expected.points, atol=1e-9)
    assert_allclose(moved.felt().normals, expected.normals, atol=1e-9)


def test_contacts_in_a_bodys_frame_are_on_it_although_it_moved() -> None:
    scene = RailedHand("wsg50", BOX, on_body=True, free_mass=0.05)
    scene.simulator.AdvanceTo(0.1)
    X_WO = scene.body.EvalPoseInWorld(scene.context)
    assert np.linalg.norm(X_WO.translation()) > 1e-4
    contacts = scene.felt()
    assert len(contacts)
    assert_allclose(contacts.points[:, 0], 0.03, atol=1e-9)  # the face x = 30 mm


def test_a_touch_is_felt_only_while_enabled_and_a_reset_empties() -> None:
    scene = RailedHand("wsg50", BOX)
    scene.fix("enable", 0.0)
    scene.simulator.AdvanceTo(0.02)
    assert not len(scene.felt())
    scene.fix("enable", 1.0)
    scene.simulator.AdvanceTo(0.03)
    assert len(scene.felt())
    scene.fix("enable", 0.0)
    scene.fix("reset", 1.0)
    scene.simulator.AdvanceTo(0.04)
    assert not len(scene.felt())


def test_two_runs_and_a_clone_in_mid_flight_give_the_same_bytes() -> None:
    noise = TactileSensor(position_noise=1e-4, normal_noise=0.01)
    space = Workspace(0.03, np.zeros(3), 0.12)
    runs = [RailedHand("wsg50", BOX, before=0.02, noise=noise, space=space) for _ in range(2)]
    runs[0].simulator.AdvanceTo(0.1)
    clone = Simulator(runs[0].diagram, runs[0].simulator.get_context().Clone())
    clone.Initialize()
    clone.AdvanceTo(0.25)
    for scene in runs:
        scene.simulator.AdvanceTo(0.25)
    felt = [runs[0].felt(), runs[1].felt(), runs[0].felt(clone.get_context())]
    assert len(felt[0])
    assert len(felt[0].free_points)
    assert (felt[0].position_noise == 1e-4).all()
    for other in felt[1:]:
        for name in ("points", "normals", "forces", "times", "free_points", "free_radii"):
            assert getattr(felt[0], name).tobytes() == getattr(other, name).tobytes()


def test_the_free_space_that_is_swept_is_outside_of_the_object() -> None:
    scene = RailedHand("wsg50", BOX, before=0.025, space=Workspace(0.03, np.zeros(3), 0.12))
    scene.simulator.AdvanceTo(0.3)
    contacts = scene.felt()
    assert len(contacts)
    assert len(contacts.free_points) > 5
    outside = np.abs(contacts.free_points) - BOX.extents / 2.0  # (K, 3)
    gap = np.linalg.norm(np.maximum(outside, 0.0), axis=1)
    assert (gap > contacts.free_radii - 5e-4).all()  # a touch presses the skin in by 0.3 mm


def test_point_contact_is_felt_at_the_same_place_with_one_warning() -> None:
    exact, points = RailedHand("wsg50", BOX), RailedHand("wsg50", BOX, contact_model="point")
    exact.simulator.AdvanceTo(0.03)
    with pytest.warns(InexactContactWarning) as caught:
        points.simulator.AdvanceTo(0.03)
    named = [(w.message.link, w.message.body, w.message.method) for w in caught]
    assert named == [("hand::left_tip", "object::object", "points")]
    first, second = exact.felt(), points.felt()
    assert first.fingers[0] == second.fingers[0]
    # The dome's point touches; hydroelastic contact takes its patch's middle.
    assert_allclose(second.points[0], first.points[0], atol=2e-4)
    assert_allclose(second.normals[0], first.normals[0], atol=1e-6)


def test_a_wrong_plant_or_nothing_to_feel_is_refused_in_one_sentence() -> None:
    scene = RailedHand("wsg50", BOX)
    open_plant = MultibodyPlant(STEP)
    with pytest.raises(InvalidOptionError) as error:
        TouchSensor(open_plant, scene.hand)
    assert error.value.option == "plant"
    open_plant.Finalize()
    with pytest.raises(InvalidOptionError) as error:
        TouchSensor(open_plant, scene.hand)
    assert error.value.option == "hand"
    with pytest.raises(InvalidOptionError) as error:
        TouchSensor(scene.plant, scene.hand, feels=[])
    assert error.value.option == "feels"
    other = open_plant.world_body()
    for wrong in ({"feels": other}, {"feels": [other]}, {"frame": other}):
        with pytest.raises(InvalidOptionError) as error:
            TouchSensor(scene.plant, scene.hand, **wrong)
        assert error.value.option == next(iter(wrong))
    with pytest.raises(InvalidOptionError) as error:
        TouchSensor(scene.plant, "wsg50")
    assert error.value.option == "hand"
