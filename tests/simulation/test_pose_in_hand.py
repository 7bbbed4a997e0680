"""The pose of a held object by touch: closed forms of boxes and cylinders, and lifts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from lis_grasp import Contacts, PoseInHand, locate_in_hand, pipeline
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.geometry import apply_pose, inverse_pose, make_pose
from lis_grasp.lifting.contact_odometry import ContactOdometry
from lis_grasp.lifting.outcome import LiftOptions
from lis_grasp.lifting.scene import HandContact
from lis_grasp.motion import OBJECT
from lis_grasp.stages.lift import lift_object
from lis_grasp.stages.scenario import Scenario
from lis_grasp.task import Task
from lis_grasp.typing import FloatArray

DEGREE = np.pi / 180.0
SIDE = 0.06  # of the box [m]
TURN, MOTION = 0.15, 0.003  # prior deviations [rad, m]


def wide(X_HO: FloatArray | None = None) -> PoseInHand:
    spread = np.diag([TURN**2] * 3 + [MOTION**2] * 3)
    X = np.eye(4) if X_HO is None else X_HO
    return PoseInHand.normal(X, np.zeros(3), spread, rng=np.random.default_rng(1))


def jaws() -> Contacts:
    """Return contacts of two pads on the sides of a box, along x."""
    normals = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    return Contacts(0.5 * SIDE * normals, normals)


def located(prior: PoseInHand, contacts: Contacts, mesh: trimesh.Trimesh) -> PoseInHand:
    return locate_in_hand(prior, contacts, mesh, rng=np.random.default_rng(2))


def box() -> trimesh.Trimesh:
    return trimesh.creation.box((SIDE, SIDE, SIDE))


def test_parallel_jaws_show_three_directions_of_a_box_and_leave_the_others_to_the_prior() -> None:
    held = located(wide(), jaws(), box())
    deviations = np.sqrt(np.diag(held.covariance))
    # Two independent contacts: of deviation 1 mm along x, and of normals of 0.2 rad about y and z.
    along = (2.0 / 0.001**2 + 1.0 / MOTION**2) ** -0.5
    tilt = (2.0 / 0.2**2 + 1.0 / TURN**2) ** -0.5
    # A slide of 3 mm times a tilt of 0.1 rad adds 0.3 mm to 0.7 mm; draws leave 3 to 5 %.
    closed = [TURN, tilt, tilt, along, MOTION, MOTION]
    np.testing.assert_allclose(deviations, closed, rtol=0.2)


def test_three_orthogonal_faces_show_the_place_of_a_displaced_box() -> None:
    true = make_pose(np.eye(3), (0.003, -0.002, 0.002))
    normals = np.vstack([np.eye(3), -np.eye(3)])
    contacts = Contacts(apply_pose(true, 0.5 * SIDE * normals), normals)
    held = located(wide(), contacts, box())
    moved, turned = held.errors(true)
    assert moved < held.position_band < 0.003
    assert turned < held.angle_band


def test_an_uncertain_surface_gives_a_contact_less_weight() -> None:
    mesh = box()
    mesh.vertex_attributes["uncertainty"] = np.full(len(mesh.vertices), 0.003)
    deviation = np.sqrt(located(wide(), jaws(), mesh).covariance[3, 3])
    expected = (2.0 / (0.003**2 + 0.001**2) + 1.0 / MOTION**2) ** -0.5
    assert deviation == pytest.approx(expected, rel=0.2)


def test_without_contacts_the_prior_stays() -> None:
    prior = wide()
    assert located(prior, Contacts.empty(), box()) is prior


def test_equal_random_streams_give_equal_poses() -> None:
    first, second = (located(wide(), jaws(), box()) for _ in range(2))
    np.testing.assert_array_equal(first.draws, second.draws)
    np.testing.assert_array_equal(first.X_HO, second.X_HO)


def test_a_rigid_motion_of_hand_and_world_moves_the_pose_alike() -> None:
    X = make_pose(Rotation.from_rotvec((0.3, -0.2, 0.9)).as_matrix(), (0.1, 0.2, 0.3))
    still, contacts = located(wide(), jaws(), box()), jaws()
    turned = Contacts(apply_pose(X, contacts.points), contacts.normals @ X[:3, :3].T)
    moved = located(wide(X), turned, box())
    # The draws differ: three of their deviations, 1 mm and 0.1 rad over the root of 500 weights.
    errors = moved.errors(X @ still.X_HO)
    assert errors[0] < 3.0 * MOTION / np.sqrt(50)
    assert errors[1] < 3.0 * TURN / np.sqrt(50)


@pytest.mark.parametrize("covariance", [np.eye(3), -np.eye(6), np.full((6, 6), np.nan)])
def test_what_is_no_covariance_is_refused(covariance: FloatArray) -> None:
    with pytest.raises(InvalidOptionError) as caught:
        PoseInHand.normal(np.eye(4), np.zeros(3), covariance, rng=np.random.default_rng(0))
    assert caught.value.option == "covariance"


Links = Callable[[float], dict[str, FloatArray]]


def followed(links: Links, contacts: Callable[[float], list[HandContact]]) -> FloatArray:
    """Return where links carry an object from the identity between the times 0 and 1."""
    odometry = ContactOdometry(np.eye(4), np.eye(4), np.zeros(3))
    for time in np.linspace(0.0, 1.0, 101):
        poses = links(float(time))
        odometry.update(np.eye(4), poses.__getitem__, contacts(float(time)), stands=False)
    return odometry.X_HO


def contact(link: str, point: FloatArray, normal: FloatArray) -> HandContact:
    return HandContact(link, point, normal, -5.0 * normal)


def test_links_that_move_together_carry_the_object_along() -> None:
    way = np.array([0.02, -0.1, 0.3, 0.004, 0.006, -0.002])  # rotation vector, translation
    directions = np.array([[1.0, 0.0, 0.0], [-0.5, 0.8, 0.0], [-0.5, -0.8, 0.3]])

    def pose(time: float) -> FloatArray:
        return make_pose(Rotation.from_rotvec(time * way[:3]).as_matrix(), time * way[3:])

    def contacts(time: float) -> list[HandContact]:
        X = pose(time)
        units = directions / np.linalg.norm(directions, axis=1)[:, None]
        return [
            contact(str(i), apply_pose(X, 0.03 * n), X[:3, :3] @ n) for i, n in enumerate(units)
        ]

    reached = followed(lambda time: dict.fromkeys("012", pose(time)), contacts)
    # By itself the object stays, with a weight of 1e-4 of the links', and of 2e-3 for turns.
    np.testing.assert_allclose(reached[:3, 3], way[3:], atol=1e-4)
    angle = Rotation.from_matrix(reached[:3, :3] @ pose(1.0)[:3, :3].T).magnitude()
    assert angle < 0.01 * np.linalg.norm(way[:3])


def test_a_cylinder_between_plates_that_move_oppositely_rolls_by_their_way_over_its_radius() -> (
    None
):
    radius, way = 0.02, 0.005
    up, x, y = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])

    def links(time: float) -> dict[str, FloatArray]:
        return {
            "upper": make_pose(np.eye(3), time * way * x),
            "lower": make_pose(np.eye(3), -time * way * x),
        }

    def contacts(time: float) -> list[HandContact]:
        return [
            contact(link, sign * radius * up + side * y, sign * up)
            for link, sign in (("upper", 1.0), ("lower", -1.0))
            for side in (-0.03, 0.03)
        ]

    turned = Rotation.from_matrix(followed(links, contacts)[:3, :3]).as_rotvec()
    np.testing.assert_allclose(turned, way / radius * y, atol=0.01 * way / radius)


def test_an_object_that_nothing_touches_stays_on_its_table_while_the_palm_rises() -> None:
    odometry = ContactOdometry(np.eye(4), np.eye(4), np.zeros(3))
    raised = make_pose(np.eye(3), (0.0, 0.0, 0.1))
    odometry.update(raised, {}.__getitem__, [], stands=True)
    np.testing.assert_allclose(odometry.X_HO, inverse_pose(raised))


def test_one_point_on_each_jaw_leaves_the_turn_about_their_line_free() -> None:
    odometry = ContactOdometry(np.eye(4), np.eye(4), np.zeros(3))
    x = np.array([1.0, 0.0, 0.0])
    touching = [
        contact(link, sign * 0.03 * x, sign * x) for link, sign in (("l", -1.0), ("r", 1.0))
    ]
    odometry.update(np.eye(4), lambda link: np.eye(4), touching, stands=False)
    about = np.sqrt(np.diag(odometry.covariance())[:3])
    # About y and z: two points at 3 cm of deviation 0.6 mm across.
    across = (2.0 * (0.03 / 0.0006) ** 2 + 1.0 / 0.08**2) ** -0.5
    np.testing.assert_allclose(about, [0.08, across, across], rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("simulator", ["drake", "cenic"])
@pytest.mark.parametrize("hand", ["wsg50", "allegro"])
def test_the_felt_pose_is_within_its_bands_of_the_true_one(hand: str, simulator: str) -> None:
    """The object stands aside from where it is known; the simulator's pose is the oracle."""
    scenario = Scenario.from_config(Task.of("box", hand=hand, grasps=1, simulator=simulator))
    mesh = scenario.truth.shape.mesh
    grasp = pipeline.plan(scenario.agent, mesh).best
    aside = make_pose(Rotation.from_euler("z", 2.0 * DEGREE).as_matrix(), (0.003, -0.002, 0.0))
    options = LiftOptions(place_deviations=(0.003, 2.0 * DEGREE))
    outcome = lift_object(scenario.moved(aside), grasp, estimate=mesh, options=options)
    pose, poses = outcome.pose_in_hand, outcome.motion.poses
    assert outcome.held
    assert pose is not None
    # The estimate is the true mesh in O, which stood aside: its true pose in the palm at the end.
    X_WH = poses[scenario.agent.hand.base_link][-1] @ scenario.agent.hand.X_LH
    moved, turned = pose.errors(inverse_pose(X_WH) @ poses[OBJECT][-1])
    assert moved < pose.position_band
    assert turned < pose.angle_band
    # As planned, it would be off by the motion, 3.6 mm.
    planned = PoseInHand(inverse_pose(grasp.X_OH), pose.center, pose.draws)
    assert moved < planned.errors(inverse_pose(X_WH) @ poses[OBJECT][-1])[0] + 0.001
