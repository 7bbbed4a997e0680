"""Motions of a hand in a user's Diagram beside known bodies."""

from __future__ import annotations

import numpy as np
import pytest
import worlds
from pydrake.common.value import AbstractValue
from pydrake.geometry import Box
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource

from lis_grasp import Body, Contacts, Hand, Surroundings, shapes
from lis_grasp.arms.station import Station, Table
from lis_grasp.drake import GraspPlanner, HapticExplorer, add_hand, surroundings_of
from lis_grasp.drake._hand_motion import HandMotion
from lis_grasp.drake._movers import FreeMover, OffBodies, transit
from lis_grasp.drake.surface_estimator import Estimate
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import Probe, Workspace
from lis_grasp.exploration.states import NextProbe
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.geometry import inverse_pose, make_pose
from lis_grasp.probing.bodies_beside import BodiesBeside
from lis_grasp.probing.probe_planner import ProbePlanner
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.collision import HandCollisionChecker

WSG50 = Hand.load("wsg50")
# The object's frame E is elsewhere in the world, and turned.
X_WE = RigidTransform(RollPitchYaw(0.0, 0.0, 0.7), [0.4, -0.2, 0.0])
SPACE = Workspace(step=0.03, center=[0.0, 0.0, 0.06], size=0.12, support_height=0.0)
HOME = RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.4, -0.2, 0.5])
# On all sides but one, 0.2 m from the object's middle, and 0.3 m high.
WALLS = Surroundings(
    tuple(
        Body.box(f"wall {k}", sides, place)
        for k, (sides, place) in enumerate(
            [
                ((0.02, 0.44, 0.3), (0.2, 0.0, 0.15)),
                ((0.02, 0.44, 0.3), (-0.2, 0.0, 0.15)),
                ((0.44, 0.02, 0.3), (0.0, 0.2, 0.15)),
            ]
        )
    )
)


def _hits(surroundings: Surroundings, duration: float) -> tuple[int, int]:
    """Return how many of an explorer's commanded poses hit a wall, of how many.

    No touch ever comes, so that the explorer makes its planned motions to their ends.
    """
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.002)
    hand = add_hand(plant, "wsg50")
    plant.Finalize()
    explorer = builder.AddSystem(
        HapticExplorer(hand, SPACE, X_WE=X_WE, home=HOME, touches=9, surroundings=surroundings)
    )
    for port, value in (("contacts", Contacts.empty()), ("estimate", Estimate(Contacts.empty()))):
        source = builder.AddSystem(ConstantValueSource(AbstractValue.Make(value)))
        builder.Connect(source.get_output_port(), explorer.GetInputPort(port))
    in_W = WALLS.in_frame(inverse_pose(X_WE.GetAsMatrix4()))
    checker = HandCollisionChecker(WSG50, obstacles=in_W.mesh)
    simulator = Simulator(builder.Build())
    hits, count, order = 0, 0, np.argsort(hand.actuated)
    while simulator.get_context().get_time() < duration:
        simulator.AdvanceTo(simulator.get_context().get_time() + 0.1)
        context = explorer.GetMyContextFromRoot(simulator.get_context())
        X_WH = explorer.X_WG.Eval(context).GetAsMatrix4() @ WSG50.X_LH
        state = explorer.GetOutputPort("joint_state").Eval(context)
        q = state[: len(state) // 2][order]
        hits += int(checker.hit_obstacle(X_WH[None, None], q[None])[0])
        count += 1
    return hits, count


@pytest.mark.slow
def test_an_explorer_keeps_off_known_bodies_and_else_hits_them() -> None:
    in_W = WALLS.in_frame(inverse_pose(X_WE.GetAsMatrix4()))
    hits, count = _hits(in_W, 30.0)
    assert (hits, count) == (0, 300)
    assert _hits(Surroundings(), 30.0)[0] > 0


def test_a_transit_leads_over_a_wall_and_not_into_a_body() -> None:
    down = RotationMatrix.MakeXRotation(np.pi).matrix()
    X, Y = (make_pose(down, [x, 0.0, 0.25]) for x in (0.5, 0.2))
    q = next(iter(WSG50.probe_postures.values())).joint_positions
    points = ProbePlanner(WSG50).points(q)

    def beside(body: Body) -> OffBodies:
        return OffBodies(BodiesBeside(WSG50, Surroundings((body,))), q[None])

    low = Body.box("low", (0.02, 2.0, 0.22), (0.35, 0.0, 0.11))
    straight = transit(X, Y, points, SPACE)
    over = transit(X, Y, points, SPACE, beside(low))
    assert straight is not None
    assert len(straight) == 2
    assert over is not None
    assert max(pose[2, 3] for pose in over) > 0.25
    around = Body.box("around", (0.3, 0.3, 0.4), (0.2, 0.0, 0.25))
    assert transit(X, Y, points, SPACE, beside(around)) is None


@pytest.mark.slow
def test_a_free_hand_goes_into_a_shelf_and_out_of_it() -> None:
    shelf = worlds.shelf()
    planner = ProbePlanner(WSG50, known=shelf)
    q = next(iter(WSG50.probe_postures.values())).joint_positions
    above = RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, 0.8])
    mover = FreeMover(WSG50, planner, RigidTransform(), (above, q), 0.03)
    obstacles = ObstacleModel(SPACE, Contacts.empty(), None)
    checker = HandCollisionChecker(WSG50, obstacles=shelf.mesh)
    motion = mover.home()
    for direction in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]):
        probe = Probe(np.array([0.0, 0.0, 0.08]), np.array(direction), 0.1, 0.02)
        there = mover.out(NextProbe(probe, obstacles), motion)
        assert isinstance(there, HandMotion)
        motion = mover.back(there, there.duration)
        for moving in (there, motion):
            for time in np.arange(0.0, moving.duration, 0.1):
                X_WH = moving.X_WG(time).GetAsMatrix4() @ WSG50.X_LH
                q_now = moving.joints.value(min(time, moving.joints.end_time()))[:, 0]
                assert not checker.hit_obstacle(X_WH[None, None], q_now[None])[0]


@pytest.mark.slow
def test_a_planner_avoids_known_bodies_of_the_plant() -> None:
    """A board close above the box leaves no grasp from above."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.002)
    hand = add_hand(plant, "wsg50")
    board = plant.AddModelInstance("board")
    friction = CoulombFriction(0.5, 0.5)
    body = plant.AddRigidBody("board", board)
    plant.RegisterCollisionGeometry(body, RigidTransform(), Box(1, 1, 0.02), "b", friction)
    plant.WeldFrames(plant.world_frame(), body.body_frame(), RigidTransform([0.4, -0.2, 0.16]))
    plant.Finalize()
    context = plant.GetMyContextFromRoot(builder.Build().CreateDefaultContext())
    known = surroundings_of(plant, scene_graph, context, without=[hand.instance])
    assert [each.name for each in known] == ["board"]

    mesh = shapes.find("box").mesh.copy()
    mesh.apply_translation([0.0, 0.0, -mesh.bounds[0, 2]])
    directions = []
    for surroundings in (Surroundings(), known):
        planner = GraspPlanner(
            hand, X_WE=X_WE, table=0.0, count=3, candidates=60, surroundings=surroundings
        )
        rng = np.random.default_rng(0)
        found = planner._sampler.sample(mesh, rng=rng, support_height=0.0, count=3)
        directions.append([grasp.X_OH[2, 2] for grasp in found])
    assert min(directions[0]) < -0.9  # straight down
    assert all(z > -0.9 for z in directions[1])


def test_bodies_beside_an_arm_need_its_table() -> None:
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.002)
    hand = add_hand(plant, "wsg50")
    plant.Finalize()
    arm = Arm.load("iiwa14")
    X_WA = make_pose(np.eye(3), [-0.6, 0.0, 0.0])
    station = Station.make(arm, hand.hand, X_WA)
    with pytest.raises(InvalidOptionError) as refused:
        HapticExplorer(hand, SPACE, station=station, surroundings=WALLS)
    assert refused.value.option == "surroundings"
    station = Station.make(arm, hand.hand, X_WA, table=Table(0.0))
    HapticExplorer(hand, SPACE, station=station, surroundings=WALLS)
