"""Touches of a free object: it stays, slides, rolls or topples, and remains where it is."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import Probe, Workspace
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.pipeline.names_of_2 import RunConfig
from lis_grasp.probing.guarded_motion import AT_TABLE
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import build
from lis_grasp.simulation.drake import _probing_scene, dynamic_prober
from lis_grasp.simulation.drake.dynamic_prober import DynamicProber
from lis_grasp.simulation.drake.object_plant import FreeObject

BALL = trimesh.creation.icosphere(subdivisions=4, radius=0.04)
FROM_THE_SIDE = Probe([-0.03, 0.0, 0.0], [1.0, 0.0, 0.0], 0.02, 0.02)


def touched(
    mesh: trimesh.Trimesh,
    *,
    mass: float,
    friction: float,
    probe: Probe = FROM_THE_SIDE,
    threshold: float | None = None,
):
    free = FreeObject(float(mesh.bounds[0, 2]), mass, friction)
    prober = DynamicProber(Hand.load("allegro"), mesh, free=free, force_threshold=threshold)
    return prober.probe(probe), prober


def cube() -> trimesh.Trimesh:
    return trimesh.creation.box(extents=[0.06, 0.06, 0.06])


def test_a_touch_weaker_than_friction_moves_nothing() -> None:
    # 0.5 x 0.5 kg x g = 2.5 N of friction, and a touch of 0.2 N detected 0.06 mm late at most.
    outcome, _ = touched(cube(), mass=0.5, friction=0.5)
    assert outcome.status == "touched"
    assert outcome.moved < 2e-4
    np.testing.assert_allclose(outcome.contacts.points[0], [-0.03, 0.0, 0.0], atol=1e-3)


def test_a_sliding_object_stays_where_a_touch_leaves_it() -> None:
    # 0.02 x 0.05 kg x g = 0.01 N of friction: it slides away from a finger that feels 1 N only.
    outcome, prober = touched(cube(), mass=0.05, friction=0.02, threshold=1.0)
    moved = prober.X_EO[0, 3]
    assert moved > 5e-3
    assert outcome.moved == pytest.approx(moved, rel=0.05)
    # The next probe finds its top where nothing was before.
    beyond = 0.03 + 0.5 * moved
    down = Probe([beyond, 0.0, 0.03], [0.0, 0.0, -1.0], 0.02, 0.005)
    above = prober.probe(down)
    assert above.status == "touched"
    np.testing.assert_allclose(above.contacts.points[0, 2], 0.03, atol=1e-3)
    assert above.contacts.points[0, 0] > 0.03


@pytest.mark.slow
def test_the_hand_waits_for_the_object_to_rest_where_its_motion_began(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Behind the start nothing was swept: a hand that goes on meets a handle, or an opposite wall.
    monkeypatch.setattr(_probing_scene, "_STILL", 0.0)
    outcome, prober = touched(cube(), mass=0.5, friction=0.5)
    assert outcome.hand_pose is not None
    back = outcome.hand_pose.X_OH[:3, 3] - prober._scene.X_WH[:3, 3]
    np.testing.assert_allclose(back, FROM_THE_SIDE.standoff * FROM_THE_SIDE.direction, atol=5e-4)


def test_a_contact_is_measured_by_the_hand_wherever_the_object_is() -> None:
    _, prober = touched(cube(), mass=0.5, friction=0.5)
    X_EO = np.eye(4)
    X_EO[:2, :2] = [[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]]
    X_EO[:2, 3] = 0.004, -0.002
    prober.place_object(X_EO)
    contacts = prober.probe(Probe([-0.03, 0.0, 0.0], [1.0, 0.0, 0.0], 0.02, 0.03)).contacts
    # On the face of the turned cube, to the accuracy of a touch of 0.05 N on a body of 0.5 kg.
    in_object = trimesh.transform_points(contacts.points, np.linalg.inv(X_EO))
    np.testing.assert_allclose(in_object[0, 0], -0.03, atol=2e-4)
    np.testing.assert_allclose(contacts.normals[0], -X_EO[:3, 0], atol=2e-3)


@pytest.mark.slow
def test_a_touch_that_topples_the_object_leaves_it_toppled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # It yields at 0.005 N and returns with the finger, which stops after 10 mm. Pushed by 50 mm at
    # a height of 180 mm it tilts beyond its foot of 20 mm.
    monkeypatch.setattr(dynamic_prober, "_BEYOND", 0.05)
    stick = trimesh.creation.box(extents=[0.02, 0.02, 0.2])
    probe = Probe([-0.01, 0.0, 0.08], [1.0, 0.0, 0.0], 0.02, 0.06)
    _, prober = touched(stick, mass=0.01, friction=0.8, probe=probe)
    assert prober.X_EO[2, 2] < 0.1  # it lies
    where_it_stood = prober.probe(Probe([0.0, 0.0, 0.1], [0.0, 0.0, -1.0], 0.02, 0.05))
    assert where_it_stood.status == "missed"


@pytest.mark.slow
def test_a_light_ball_touched_gently_rolls_by_less_than_six_millimetres() -> None:
    # Rolling resistance stops a ball of speed v after 0.7 v^2 / (0.01 g): 6 mm from 30 mm/s, the
    # hand's speed. 10 ms after a force of 0.05 N on 0.05 kg it has a part of it.
    ball = build("sphere", None).mesh
    radius = -float(ball.bounds[0, 2])
    probe = Probe([-radius, 0.0, 0.0], [1.0, 0.0, 0.0], 0.02, 0.02)
    outcome, _ = touched(ball, mass=0.05, friction=0.5, probe=probe)
    assert outcome.status == "touched"
    assert 0.0 < outcome.moved < 0.006


@pytest.mark.slow
@pytest.mark.parametrize(("mesh", "resists"), [(cube(), True), (BALL, False)], ids=["cube", "ball"])
def test_a_hand_that_rests_feels_a_cube_and_no_more_a_ball_that_rolls_away(
    mesh: trimesh.Trimesh, resists: bool
) -> None:
    # Friction holds the cube up to 0.8 x 0.2 kg x g = 1.6 N. A ball that was pushed for 10 ms at
    # 0.03 m/s has left the finger after 50 ms.
    half = float(mesh.bounds[1, 0])
    probe = Probe([-half, 0.0, 0.0], [1.0, 0.0, 0.0], 0.02, 0.02, pace="tested")
    outcome, _ = touched(mesh, mass=0.2, friction=0.8, probe=probe)
    assert outcome.resisted is resists
    assert (
        touched(mesh, mass=0.2, friction=0.8, probe=replace(probe, pace="gentle"))[0].resisted
        is None
    )


@pytest.mark.parametrize(("known", "topples"), [(0, True), (1, False)])
def test_what_a_search_topples_stays_upright_after_the_first_contact(
    known: int, topples: bool
) -> None:
    # Half the foot is 4 mm. At the height of the centre of mass, 30 mm, a push at 0.1 m/s topples
    # feet below 5.5 mm, at 0.03 m/s below 1.7 mm: v sqrt(h / g).
    rod = trimesh.creation.cylinder(radius=0.004, height=0.06)
    space = Workspace(0.03, np.zeros(3), 0.1, -0.03)
    prober = DynamicProber(Hand.load("allegro"), rod, free=FreeObject(-0.03))
    top = Contacts([[0.0, 0.0, 0.03]], [[0.0, 0.0, 1.0]]).subset(np.arange(known))
    probe = Probe([-0.004, 0.0, 0.0], [1.0, 0.0, 0.0], 0.03, 0.02)
    outcome = prober.probe(probe, ObstacleModel(space, top, None))
    assert outcome.status == "touched"
    assert prober.X_EO is not None
    assert bool(prober.X_EO[2, 2] < 0.5) is topples


def test_no_approach_goes_through_the_table() -> None:
    mesh = cube()
    space = Workspace(0.015, np.zeros(3), 0.06, float(mesh.bounds[0, 2]))
    prober = DynamicProber(Hand.load("allegro"), mesh, free=FreeObject(space.support_height))
    obstacles = ObstacleModel(space, Contacts.empty(), None)
    from_below = prober.probe(Probe([0.0, 0.0, -0.03], [0.0, 0.0, 1.0], 0.02, 0.02), obstacles)
    assert from_below.status == "blocked"
    assert prober.probe(FROM_THE_SIDE, obstacles).status == "touched"


@pytest.mark.parametrize(
    ("beside", "depth", "status"),
    [(0.05, 0.0, "missed"), (0.05, 0.08, "blocked"), (0.0, 0.0, "touched")],
)
def test_a_hand_stops_at_the_table_and_clears_no_space_below(
    beside: float, depth: float, status: str
) -> None:
    # Down by 10 cm from 2 cm above the top of a cube of 6 cm, beside it or on it. The target is at
    # the height of the top, or below the table.
    mesh = cube()
    space = Workspace(0.015, np.zeros(3), 0.06, -0.03)
    prober = DynamicProber(Hand.load("allegro"), mesh, free=FreeObject(space.support_height))
    down = Probe([beside, 0.0, 0.03 - depth], [0.0, 0.0, -1.0], 0.02 + depth, 0.08 - depth)
    outcome = prober.probe(down, ObstacleModel(space, Contacts.empty(), None))
    assert outcome.status == status
    assert outcome.reason == (AT_TABLE if status == "blocked" else "")
    if status != "touched":
        # The tip's ball comes down to the table, and no ball goes below it.
        lowest = (outcome.free_points[:, 2] - outcome.free_radii).min()
        assert lowest == pytest.approx(space.support_height, abs=1e-6)


@pytest.mark.parametrize(("option", "value"), [("mass", 0.0), ("friction", np.nan)])
def test_an_invalid_free_object_is_refused(option: str, value: float) -> None:
    with pytest.raises(InvalidOptionError) as error:
        FreeObject(**({"support_height": 0.0} | {option: value}))
    assert error.value.option == option


def test_a_free_object_needs_dynamics() -> None:
    with pytest.raises(InvalidOptionError) as error:
        RunConfig(free=True, prober="kinematic")
    assert error.value.option == "free"
