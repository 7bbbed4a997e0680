"""Bodies beside the object in Drake: they rest, push back, are felt, and stay where pushed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
import worlds
from pydrake.math import RigidTransform
from scipy.spatial.transform import Rotation

from lis_grasp import shapes
from lis_grasp.exploration import Probe
from lis_grasp.geometry import apply_pose, inverse_pose, make_pose
from lis_grasp.pipeline import Scenario
from lis_grasp.probing.approach_planner import NO_FREE_START
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.robot_model import Inertial, LinkGeometry
from lis_grasp.shapes.object_mass import GRAVITY, USUAL_FRICTION, uniform_inertia
from lis_grasp.simulation.drake import _probe_carriers, dynamic_prober
from lis_grasp.simulation.drake._plant_scene import PlantScene
from lis_grasp.simulation.drake._probing_scene import ProbingScene
from lis_grasp.simulation.drake.dynamic_prober import DynamicProber
from lis_grasp.simulation.drake.hand_plant import add_hand_model
from lis_grasp.simulation.drake.object_plant import FreeObject, add_object_body, add_support
from lis_grasp.stages.touch import touch_steps
from lis_grasp.task.task import Task
from lis_grasp.world import ALONE, Body, Surroundings

MESH = shapes.find("box").mesh  # 84 x 60 x 120 mm about the origin
TABLE = float(MESH.bounds[0, 2])
ON_TABLE = FreeObject(TABLE, mass=0.2, friction=0.5)
LEFT, DOWN = np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def wsg50() -> Hand:
    return Hand.load("wsg50")


def scene_with(surroundings: Surroundings, hand: Hand, time_step: float) -> PlantScene:
    """Return a scene at rest, with the hand far above."""
    scene = PlantScene(
        time_step, surroundings=surroundings, contact_model="hydroelastic_with_fallback"
    )
    plant = scene.plant
    added = add_hand_model(plant, hand)
    far = RigidTransform([0.0, 0.0, 0.5])
    plant.WeldFrames(plant.world_frame(), added.base.body_frame(), far)
    obj = add_object_body(plant, MESH, mass=0.2, friction=0.5)
    support = add_support(plant, TABLE, 0.5, under=MESH, mass=0.2)
    scene.finalize(added, obj, support=support)
    state = np.zeros(2 * len(hand.joint_names))
    plant.get_desired_state_input_port(added.instance).FixValue(scene.context, state)
    scene.restart()
    return scene


def ground_forces(scene: PlantScene) -> dict[str, float]:
    """Return the size of each ground's force [N]."""
    assert scene.surroundings is not None
    results = scene.plant.get_contact_results_output_port().Eval(scene.context)
    forces = {}
    for i in range(results.num_hydroelastic_contacts()):
        info = results.hydroelastic_contact_info(i)
        pair = {info.contact_surface().id_M(), info.contact_surface().id_N()}
        for name, ground in scene.surroundings.grounds.items():
            if ground in pair:
                forces[name] = float(np.linalg.norm(info.F_Ac_W().translational()))
    return forces


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mass", "time_step"),
    [
        pytest.param(0.3, 0.005, id="lift"),
        pytest.param(0.3, 0.002, id="touch", marks=pytest.mark.slow),
        pytest.param(0.05, 0.002, id="light", marks=pytest.mark.slow),
        pytest.param(0.05, 0.005, id="light in lift", marks=pytest.mark.slow),
    ],
)
def test_free_blocks_rest_still_for_a_second_and_press_with_their_weight(
    wsg50: Hand, mass: float, time_step: float
) -> None:
    scene = scene_with(worlds.blocks(mass=mass, table=TABLE), wsg50, time_step)
    assert scene.surroundings is not None
    before = scene.surroundings.poses(scene.context)
    for _ in range(round(1.0 / time_step)):
        scene.step(of="rest")
    for name, now in scene.surroundings.poses(scene.context).items():
        assert np.linalg.norm(now[:3, 3] - before[name][:3, 3]) < 1e-4
    forces = ground_forces(scene)
    assert set(forces) == {"block_east", "block_west"}
    # At rest to the last micrometre a second.
    assert list(forces.values()) == pytest.approx([mass * GRAVITY] * 2, rel=1e-3)
    assert scene.pushes == {}


def standing(mesh: trimesh.Trimesh, *, tilt: float) -> Body:
    """Return a free mesh of 0.2 kg at x = 0.2 m on the table, tilted by an angle [rad]."""
    X_EB = make_pose(Rotation.from_rotvec([0.6 * tilt, 0.8 * tilt, 0.0]).as_matrix())
    lowest = apply_pose(X_EB, np.asarray(mesh.vertices))[:, 2].min()
    X_EB[:3, 3] = [0.2, 0.0, TABLE - lowest]
    inertial = Inertial(0.2, np.array(mesh.center_mass), uniform_inertia(mesh, 0.2))
    return Body("mesh", (LinkGeometry("mesh", np.eye(4), "mesh", (), mesh),), X_EB, inertial)


ROOF = np.array([(x, y, 0.056 * (y < 0.0)) for x in (-0.05, 0.05) for y in (-0.025, 0.025)])
SHAPES = {
    "roof": trimesh.convex.convex_hull(np.vstack([ROOF, ROOF * [1.0, 1.0, 0.0]])),
    **{name: shapes.find(name).mesh for name in ("half_cylinder", "pentagon")},
}


@pytest.mark.by_default("pentagon")
@pytest.mark.parametrize("name", SHAPES)
def test_a_free_mesh_does_not_move_before_it_is_touched(wsg50: Hand, name: str) -> None:
    body = standing(SHAPES[name], tilt=2e-4)
    scene = scene_with(Surroundings((body,)), wsg50, 0.005)
    scene.place_surroundings({})
    for _ in range(100):
        scene.step(of="rest")
    assert scene.surroundings is not None
    assert body.displacement(scene.surroundings.poses(scene.context)["mesh"]) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("time_step", [0.005, pytest.param(0.002, marks=pytest.mark.slow)])
def test_a_pushed_mesh_comes_to_rest(wsg50: Hand, name: str, time_step: float) -> None:
    body = standing(SHAPES[name], tilt=2e-3)
    scene = scene_with(Surroundings((body,)), wsg50, time_step)  # it is not locked
    poses = []
    for seconds in (0.5, 2.0):
        while scene.steps * time_step < seconds:
            scene.step(of="rest")
        assert scene.surroundings is not None
        poses.append(scene.surroundings.poses(scene.context)["mesh"])
    # As a second of rest may move a block.
    assert replace(body, X_EB=poses[0]).displacement(poses[1]) < 1e-4


def test_a_wall_pushes_back_by_the_law_of_the_rail_that_pushes(wsg50: Hand) -> None:
    wall = worlds.block(0.1, mass=None, table=TABLE)  # up to x = 202 mm
    scene = ProbingScene(wsg50, MESH, 0.05, surroundings=wall)
    prober = KinematicProber(wsg50, MESH, surroundings=wall)
    outcome = prober.probe(Probe(np.array([0.202, 0.0, 0.0]), LEFT, 0.05, 0.02))
    assert outcome.hand_pose is not None
    q = outcome.hand_pose.joint_positions
    base = wsg50.forward_kinematics(outcome.hand_pose.X_OH, q)[wsg50.base_link]
    scene.place(q, base, LEFT, np.eye(4))
    scene.start_motion(0.0, 0.0)
    before, commanded = scene.X_WH, 3e-3
    for _ in range(500):
        scene.step(commanded, 0.0)
    moved = float((scene.X_WH - before)[:3, 3] @ LEFT)
    force = scene._scene.forces_beside["block_east", "hand"]
    # At rest the rail's spring balances the part along the motion; friction adds one across.
    along = _probe_carriers._STIFFNESS * (commanded - moved)
    assert along > 1.0
    assert 0.999 * along < force < np.hypot(1.0, USUAL_FRICTION) * along


@pytest.mark.slow
def test_both_probers_meet_the_same_body_first(wsg50: Hand) -> None:
    beside = Surroundings(
        (*worlds.blocks(0.05, mass=None, table=TABLE), *worlds.walls(0.6, 0.1, table=TABLE))
    )
    simulated = DynamicProber(wsg50, MESH, surroundings=beside)
    by_geometry = KinematicProber(wsg50, MESH, surroundings=beside)
    rng, met, statuses = np.random.default_rng(5), [], []
    for _ in range(20):
        start = np.array([*rng.uniform(-0.25, 0.25, 2), rng.uniform(0.08, 0.14)])
        end = np.array([*rng.uniform(-0.2, 0.2, 2), rng.uniform(-0.03, 0.03)])
        length = float(np.linalg.norm(end - start))
        probe = Probe(end, (end - start) / length, length, 0.01)
        outcomes, names = [], []
        for prober in (simulated, by_geometry):
            before = dict(prober.disturbance.contacts)
            outcomes.append(prober.probe(probe))
            after = prober.disturbance.contacts
            names.append({n for n in after if after[n] > before.get(n, 0)})
        first, second = outcomes
        assert (first.status == "touched") == (second.status == "touched")
        statuses.append(first.status)
        if first.status == "touched":
            # Simulated, a second body may be met within a step of 0.2 mm.
            assert names[1] <= names[0]
            met += names[1] or {"object"}
            assert first.hand_pose is not None
            assert second.hand_pose is not None
            palms = [outcome.hand_pose.X_OH[:3, 3] for outcome in outcomes]
            # A light graze goes on up to here.
            assert np.linalg.norm(palms[0] - palms[1]) < dynamic_prober._BEYOND
    assert {"block_east", "block_west", "object"} <= set(met)
    assert statuses.count("touched") >= 10


def test_a_body_far_away_changes_no_touch(wsg50: Hand) -> None:
    far = Surroundings((Body.box("far", (0.1, 0.1, 0.1), (1.0, 1.0, 0.0)),))
    probe = Probe(np.array([-0.042, 0.01, 0.02]), -LEFT, 0.05, 0.02)
    alone, beside = (
        DynamicProber(wsg50, MESH, free=ON_TABLE, surroundings=world).probe(probe)
        for world in (ALONE, far)
    )
    assert alone.contacts.points.tobytes() == beside.contacts.points.tobytes()
    assert np.array_equal(alone.contacts.forces, beside.contacts.forces)
    assert alone.moved == beside.moved


def test_a_pushed_block_stays_where_a_touch_leaves_it_and_is_met_there(wsg50: Hand) -> None:
    world = worlds.block(0.1, mass=0.05, table=TABLE)
    # 0.05 kg slide at 0.4 N: the block moves before the hand feels it.
    prober = DynamicProber(wsg50, MESH, force_threshold=2.0, surroundings=world, known=world)
    probe = Probe(np.array([0.202, 0.0, -0.03]), LEFT, 0.05, 0.02)
    assert prober.probe(probe).status == "blocked"
    moved = prober.surroundings.bodies[0].X_EB[:3, 3] - world.bodies[0].X_EB[:3, 3]
    assert moved[0] < -5e-3
    assert np.abs(moved[1:]).max() < 1e-3
    assert np.array_equal(
        prober.disturbance.poses["block_east"], prober.surroundings.bodies[0].X_EB
    )
    seen = KinematicProber(wsg50, MESH, surroundings=prober.surroundings).probe(probe)
    assert seen.contacts.points[0, 0] == pytest.approx(0.202 + moved[0], abs=1e-4)


def test_bodies_stay_in_the_world_when_the_frame_of_the_probes_moves(wsg50: Hand) -> None:
    world = worlds.blocks(0.1, ("east",), table=TABLE)
    probe = Probe(np.array([0.202, 0.005, -0.03]), LEFT, 0.05, 0.02)
    first = DynamicProber(wsg50, MESH, free=ON_TABLE, surroundings=world, known=world)
    X_EF = make_pose(Rotation.from_rotvec([0.0, 0.0, 0.3]).as_matrix(), [0.02, -0.01, 0.0])
    moved = DynamicProber(wsg50, MESH, free=ON_TABLE, surroundings=world, known=world)
    moved.move_frame(X_EF)
    X_FE = inverse_pose(X_EF)
    there = Probe(apply_pose(X_FE, probe.target), X_FE[:3, :3] @ probe.direction, 0.05, 0.02)
    here, elsewhere = first.probe(probe), moved.probe(there)
    assert here.status == elsewhere.status == "touched"
    # The hand may roll about the probe otherwise, and touches by another part of the tip.
    assert apply_pose(X_EF, elsewhere.contacts.points)[0, 0] == pytest.approx(0.202, abs=2e-4)
    now = moved.surroundings.bodies[0].X_EB
    assert np.allclose(X_EF @ now, world.bodies[0].X_EB, atol=1e-4)


def test_a_hand_that_would_start_in_a_body_is_blocked_and_the_body_named(wsg50: Hand) -> None:
    world = worlds.block(0.05, mass=None, table=TABLE)
    probe = Probe(np.array([0.12, 0.0, -0.03]), LEFT, 0.0, 0.02)
    for prober in (
        DynamicProber(wsg50, MESH, surroundings=world),
        KinematicProber(wsg50, MESH, surroundings=world),
    ):
        outcome = prober.probe(probe)
        assert outcome.status == "blocked"
        assert outcome.reason.startswith(NO_FREE_START)
        assert "block_east" in outcome.reason


def tray() -> Body:
    """Return a tray of one mesh with its floor as high as the table, and its rim 90 mm higher."""
    outer = trimesh.creation.box((0.4, 0.4, 0.1))
    inner = trimesh.creation.box((0.36, 0.36, 0.1))
    inner.apply_translation((0.0, 0.0, 0.01))
    mesh = trimesh.boolean.difference([outer, inner], engine="manifold")
    return Body.of_mesh("tray", mesh.apply_translation((0.0, 0.0, TABLE + 0.05 - 0.01)))


def test_an_object_that_slides_in_a_concave_mesh_is_stopped_by_its_wall(wsg50: Hand) -> None:
    scene = scene_with(Surroundings((tray(),)), wsg50, 0.005)
    scene.place_surroundings({})
    assert scene.forces_beside == {}
    # It has 138 mm to slide to the wall, and would slide 0.4 m: v^2 / (2 mu g).
    speed = np.array([2.0, 0.0, 0.0])
    scene.object_joint.set_translational_velocity(scene.context, speed)
    for _ in range(100):
        scene.step(of="sliding")
    X_WO = scene.object_joint.GetPose(scene.context).GetAsMatrix4()
    assert apply_pose(X_WO, MESH.vertices)[:, 0].max() < 0.18 + 1e-3
    assert scene.pushes.keys() == {("tray", "object")}


def test_a_concave_mesh_is_felt_inside_and_does_not_press_on_what_is_in_it(wsg50: Hand) -> None:
    world = Surroundings((tray(),))
    prober = DynamicProber(wsg50, MESH, free=ON_TABLE, surroundings=world, known=world)
    outcome = prober.probe(Probe(np.array([0.12, 0.1, TABLE]), DOWN, 0.04, 0.02))
    assert outcome.contacts.points[0, 2] == pytest.approx(TABLE, abs=5e-4)
    assert outcome.contacts.normals[0] == pytest.approx([0.0, 0.0, 1.0], abs=0.02)
    assert dict(prober.disturbance.contacts) == {"tray": 1}
    assert outcome.moved < 1e-4
    assert prober.disturbance.forces["tray"] < 2.0


def test_a_fixed_object_may_touch_a_wall(wsg50: Hand) -> None:
    wall = Body.box("wall", (0.02, 0.3, 0.1), (0.051, 0.0, 0.0))  # 1 mm inside of it
    prober = DynamicProber(wsg50, MESH, surroundings=Surroundings((wall,)))
    outcome = prober.probe(Probe(np.array([-0.042, 0.0, 0.0]), -LEFT, 0.04, 0.02))
    assert outcome.contacts.points[0, 0] == pytest.approx(-0.042, abs=5e-4)


@pytest.mark.slow
def test_twenty_touches_in_a_bin_press_no_wall(wsg50: Hand, tmp_path) -> None:
    pose = tmp_path / "pose.txt"
    np.savetxt(pose, make_pose(np.eye(3), [0.0, 0.0, -TABLE]))
    task = Task.of("box", hand="wsg50", pose=str(pose), region=(0.2, 0.2, 0.2), touches=20)
    scenario = Scenario.from_config(task)
    world, truth = worlds.bin_(), scenario.truth
    prober = DynamicProber(
        scenario.agent.hand,
        truth.shape.mesh,
        free=FreeObject(0.0, truth.mass, truth.friction),
        force_threshold=scenario.agent.robot.sensor.force_threshold,
        surroundings=world,
        known=world,
    )
    for state in touch_steps(scenario, prober):
        made = state.made
    assert made == 20
    assert max(prober.disturbance.forces.values(), default=0.0) < 2.0


def test_a_pushed_ball_rolls_to_rest(wsg50: Hand) -> None:
    radius, mass = 0.04, 0.3
    inertia = 0.4 * mass * radius**2 * np.eye(3)
    center = np.array([0.2, 0.0, TABLE + radius])
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    ball = Body(
        "ball",
        (LinkGeometry("ball", np.eye(4), "sphere", (radius,), mesh),),
        make_pose(np.eye(3), center),
        Inertial(mass, np.zeros(3), inertia),
    )
    world = Surroundings((ball,))
    prober = DynamicProber(wsg50, MESH, free=ON_TABLE, surroundings=world, known=world)
    target = center + [radius, 0.0, 0.0]
    assert prober.probe(Probe(target, LEFT, 0.04, 0.02)).status == "touched"
    (now,) = prober.surroundings.free
    # Rolling resistance of a lever of 1 % of the radius stops 0.03 m/s within 7 mm.
    assert abs(float((now.X_EB[:3, 3] - center) @ LEFT)) < 7e-3
    before = now.X_EB
    prober.probe(Probe(np.array([0.0, 0.0, 0.06]), DOWN, 0.04, 0.02))  # while another is touched
    assert prober.surroundings.free[0].displacement(before) < 1e-4
