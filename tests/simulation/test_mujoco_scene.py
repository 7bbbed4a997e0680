"""MuJoCo's scene of a lift: masses, kinematics and contact forces are those of the package."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from made_grasps import jaw_grasp

from lis_grasp.grasping.grasps import Grasp
from lis_grasp.lifting.outcome import LiftOptions
from lis_grasp.lifting.setup import LiftSetup, finger_gains
from lis_grasp.lifting.wrist_path import shake_about
from lis_grasp.motion import OBJECT
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.inertias import LEAST_MASS
from lis_grasp.robots.shipped_models import HAND_NAMES

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: bootstrap.sh mujoco")
pytest.importorskip("coacd", reason="CoACD is not installed: bootstrap.sh mujoco")

from lis_grasp.simulation.mujoco._mjcf import HAND, WRIST_JOINTS, scene_mjcf  # noqa: E402
from lis_grasp.simulation.mujoco.convex_pieces import convex_pieces  # noqa: E402
from lis_grasp.simulation.mujoco.lift import MujocoScene  # noqa: E402

# A box off its frame's origin and oblique, so that every entry of its inertia is tested.
BOX = trimesh.creation.box((0.04, 0.06, 0.1))
BOX.apply_transform(trimesh.transformations.euler_matrix(0.3, 0.4, 0.5))
BOX.apply_translation((0.01, 0.02, 0.03))


def any_grasp(hand: Hand, rng: np.random.Generator) -> Grasp:
    """Return a grasp with a random palm pose and posture, far from the object."""
    q = rng.uniform(hand.lower, hand.upper)
    X_OH = trimesh.transformations.random_rotation_matrix(rng.random(3))
    X_OH[:3, 3] = [0.5, 0.6, 0.7]
    return Grasp(
        hand=hand.name,
        X_OH=X_OH,
        joint_names=hand.joint_names,
        joint_positions=q,
        pregrasp_positions=q,
        approach_O=[0.0, 0.0, -1.0],
        contact_points=np.empty((0, 3)),
        contact_normals=np.empty((0, 3)),
        contact_fingers=(),
        contact_forces=np.empty((0, 3)),
        quality={"epsilon": 0.0},
        accepted="random",
    )


def setup_of(hand: Hand, rng: np.random.Generator) -> LiftSetup:
    X_WO = trimesh.transformations.random_rotation_matrix(rng.random(3))
    return LiftSetup(BOX, hand, any_grasp(hand, rng), -0.2, 0.3, 0.7, LiftOptions(), X_WO)


@pytest.fixture(params=HAND_NAMES)
def hand(request: pytest.FixtureRequest) -> Hand:
    return Hand.load(request.param)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def full_inertia(model: mujoco.MjModel, body: int) -> np.ndarray:
    """Return the inertia of a body about its centre of mass, along the axes of its frame."""
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, model.body_iquat[body])
    R = R.reshape(3, 3)
    return R @ np.diag(model.body_inertia[body]) @ R.T


def test_masses_centres_and_inertias_are_those_of_the_hand_and_the_mesh(
    hand: Hand, rng: np.random.Generator
) -> None:
    setup = setup_of(hand, rng)
    model = mujoco.MjModel.from_xml_string(scene_mjcf(setup, convex_pieces(BOX)))
    for link in hand.links:
        body, given = model.body(HAND + link).id, hand.inertials[link]
        assert model.body_mass[body] == pytest.approx(max(given.mass, LEAST_MASS), rel=1e-12)
        if given.mass >= LEAST_MASS:
            assert model.body_ipos[body] == pytest.approx(given.center_L, abs=1e-12)
            assert full_inertia(model, body) == pytest.approx(given.inertia_L, rel=1e-6, abs=1e-12)
    body = model.body(OBJECT).id
    assert model.body_mass[body] == pytest.approx(0.3)
    principal = 0.3 / 12.0 * np.array([0.06**2 + 0.1**2, 0.04**2 + 0.1**2, 0.04**2 + 0.06**2])
    assert np.sort(model.body_inertia[body]) == pytest.approx(np.sort(principal), rel=1e-6)
    expected = BOX.moment_inertia * (0.3 / BOX.volume)
    assert full_inertia(model, body) == pytest.approx(expected, rel=1e-6, abs=1e-10)


def test_poses_are_those_of_the_hand_s_kinematics(hand: Hand, rng: np.random.Generator) -> None:
    setup = setup_of(hand, rng)
    scene = MujocoScene(setup, convex_pieces(BOX))
    q, moved = rng.uniform(hand.lower, hand.upper), np.array([0.01, -0.02, 0.03])
    scene.place_hand(np.append(moved, np.zeros(3)), q)
    X_WH = setup.grasp.X_OH.copy()
    X_WH[:3, 3] += moved
    assert pytest.approx(X_WH, abs=1e-12) == scene.X_WH
    assert scene.joint_positions == pytest.approx(q)
    for link, X_WL in hand.forward_kinematics(X_WH, q).items():
        assert scene.X_WL(link) == pytest.approx(X_WL, abs=1e-9)
    assert pytest.approx(setup.X_WO, abs=1e-12) == scene.X_WO


def test_jacobians_are_those_of_the_hand_s_kinematics(hand: Hand, rng: np.random.Generator) -> None:
    setup = setup_of(hand, rng)
    scene = MujocoScene(setup, convex_pieces(BOX))
    q = rng.uniform(hand.lower, hand.upper)
    scene.place_hand(np.zeros(6), q)
    _, _, expected, _ = hand.pad_jacobians(setup.grasp.X_OH, q)  # (F, 3, 6 + J)
    for pad, jacobian in zip(hand.pads, expected, strict=True):
        assert scene.jacobian(pad.link, pad.center_L) == pytest.approx(jacobian[:, 6:], abs=1e-9)


def test_collision_bodies_are_where_the_hand_has_them(hand: Hand, rng: np.random.Generator) -> None:
    scene_text = scene_mjcf(setup_of(hand, rng), convex_pieces(BOX))
    model = mujoco.MjModel.from_xml_string(scene_text)
    for number, geometry in enumerate(hand.link_geometries):
        geom = model.geom(f"{HAND}{geometry.link}_{number}")
        # MuJoCo's radius of the ball about a body's centre, against the farthest point of ours.
        farthest = np.linalg.norm(geometry.mesh.vertices, axis=1).max()
        assert geom.rbound[0] == pytest.approx(farthest, rel=0.01)
        assert geom.pos == pytest.approx(geometry.X_LG[:3, 3], abs=1e-9)


def test_the_hand_carries_the_object_s_weight(rng: np.random.Generator) -> None:
    """At rest the forces of the jaws on the object add up to its weight (Newton's second law)."""
    jaws = Hand.load("wsg50")
    box = trimesh.creation.box((0.05, 0.05, 0.08))
    grasp = jaw_grasp(jaws, np.zeros(3), 0.05)
    setup = LiftSetup(box, jaws, grasp, -0.5, 0.3, 0.8, LiftOptions(), np.eye(4))
    scene = MujocoScene(setup, convex_pieces(box))
    scene.place_hand(np.zeros(6), np.full(2, 0.025))
    scene.rest_object()
    efforts = np.array([-10.0, -10.0])  # towards each other [N]
    for _ in range(200):
        scene.command_fingers(np.full(2, 0.025), efforts)
        scene.step()
    forces = np.array([contact.force for contact in scene.contacts()])
    assert forces.sum(axis=0) == pytest.approx([0.0, 0.0, 0.3 * 9.81], abs=0.05)
    # Each jaw is at rest under its motor, its spring and the box.
    stiffness, _ = finger_gains(jaws, grasp)
    pushed = -efforts - stiffness * (np.full(2, 0.025) - scene.joint_positions)
    side = np.sign([contact.normal[0] for contact in scene.contacts()])
    inwards = [-forces[side == s, 0].sum() * s for s in (1.0, -1.0)]
    assert inwards == pytest.approx(pushed, abs=0.05)


def test_a_concave_object_s_pieces_hold_its_surface_and_keep_its_groove() -> None:
    groove = trimesh.creation.box((0.02, 0.2, 0.02))
    profile = trimesh.creation.box((0.06, 0.1, 0.04)).difference(
        groove.apply_translation((0.0, 0.0, 0.015))
    )
    pieces = convex_pieces(profile)
    assert len(convex_pieces(BOX)) == 1
    points, _ = trimesh.sample.sample_surface(profile, 500, seed=0)
    depth = np.array(
        [((points[:, None] - p.triangles[:, 0]) * p.face_normals).sum(-1).max(1) for p in pieces]
    )  # (P, 500): signed distance to the planes of each piece
    # CoACD writes single precision, and cuts 0.1 mm beside a face.
    assert np.abs(depth.min(axis=0)).max() < 5e-4
    assert len(pieces) > 1
    assert convex_pieces(profile.copy()) is pieces  # kept, as cutting takes seconds
    assert convex_pieces(profile.copy().apply_scale(2.0)) is not pieces


def test_coupled_joints_keep_their_ratio_under_load() -> None:
    hand = Hand.load("barrett")
    setup = setup_of(hand, np.random.default_rng(1))
    model = mujoco.MjModel.from_xml_string(scene_mjcf(setup, convex_pieces(BOX)))
    data = mujoco.MjData(model)
    q = 0.5 * (hand.lower + hand.upper)
    joints = [joint for joint in hand.joints if joint.kind != "fixed"]
    for joint in joints:
        data.joint(HAND + joint.name).qpos[0] = joint.position(q)
    data.ctrl[6:] = q
    followers = [joint for joint in joints if joint.follows]
    for joint in followers:
        data.joint(HAND + joint.name).qfrc_applied[0] = 0.3  # [N m], 3 N at a fingertip
    mujoco.mj_step(model, data, 300)
    leaders = np.array([data.joint(HAND + name).qpos[0] for name in hand.joint_names])
    for joint in followers:
        off = data.joint(HAND + joint.name).qpos[0] - joint.position(leaders)
        assert abs(off) < 1e-3


def test_a_shaken_palm_accelerates_like_its_path(
    hand: Hand, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    setup = setup_of(hand, rng)
    scene = MujocoScene(setup, [BOX])
    scene.place_hand(np.zeros(6), setup.grasp.joint_positions)
    accelerations, advance = [], mujoco.mj_step

    def observed(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        advance(model, data)
        accelerations.append(data.qacc[model.joint(WRIST_JOINTS[1]).dofadr[0]])

    monkeypatch.setattr(mujoco, "mj_step", observed)
    peak, duration, step = 9.81, 1.5, setup.options.time_step
    shake = shake_about(np.zeros(6), np.eye(6)[1], peak, frequency=4.0, cycles=6)
    motion = scene.carrier.follow(shake, duration)
    for count in range(round(duration / step)):
        motion.command((count + 1) * step)
        scene.step()
    rate = len(accelerations) / duration
    velocities = [shake(k / rate)[1][1] for k in range(len(accelerations))]
    wanted = np.gradient(velocities, 1.0 / rate)
    # The springs of the wrist, and of a cup's bellows, add up to a third; commands that jump once
    # a step would add twice the peak.
    most = 0.3 if hand.cup is None else 0.4
    assert np.abs(accelerations - wanted).max() < most * peak
