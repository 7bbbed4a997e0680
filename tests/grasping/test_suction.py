"""Suction cups: closed forms of seals, a ring of point contacts as oracle, and planned grasps."""

from __future__ import annotations

import doctest
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.optimize import linprog

from lis_grasp import ForceClosureSampler, Hand, shapes
from lis_grasp.exceptions import InvalidHandError, InvalidOptionError
from lis_grasp.grasping import samplers, seals, suction
from lis_grasp.grasping.cup_wrenches import CupWrenches
from lis_grasp.grasping.grasps import LoadPrior
from lis_grasp.grasping.samplers import sampler_of
from lis_grasp.grasping.seals import press_cups
from lis_grasp.grasping.suction import SuctionSampler, cup_epsilon
from lis_grasp.robots.shipped_models import model_path
from lis_grasp.shapes.mesh_distance import MeshTree
from lis_grasp.typing import FloatArray

HAND = Hand.load("cup")
CUP = HAND.pads[0].cup
assert CUP is not None
UP = np.array([[0.0, 0.0, 1.0]])
FRICTION = 0.5
POLYGON = np.cos(np.pi / 8)  # a regular octagon's inner radius


def seals_at(mesh: trimesh.Trimesh, point: FloatArray, axis: FloatArray) -> bool:
    return bool(press_cups(MeshTree(mesh), point[None], axis[None], CUP).sealed[0])


@pytest.mark.parametrize(("beyond", "sealed"), [(-0.0005, True), (0.0015, False)])
def test_a_lip_beyond_an_edge_does_not_seal(beyond: float, sealed: bool) -> None:
    box = trimesh.creation.box([0.06] * 3)
    off = 0.03 - CUP.radius + beyond
    assert seals_at(box, np.array([off, 0.0, 0.03]), UP[0]) is sealed


@pytest.mark.parametrize(("radius", "sealed"), [(0.044, False), (0.058, True)])
def test_a_lip_across_a_cylinder_is_off_by_a_quarter_of_its_square_by_the_radius(
    radius: float, sealed: bool
) -> None:
    """Heights ``-R^2 cos^2 / 2 r`` have the median ``-R^2 / 4 r``, half a millimetre at 50 mm."""
    mesh = trimesh.creation.cylinder(radius, 0.1, sections=400)
    assert seals_at(mesh, np.array([radius, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])) is sealed


@pytest.mark.parametrize(("degrees", "sealed"), [(12.0, True), (17.0, False)])
def test_a_lip_tilts_as_far_as_its_cup(degrees: float, sealed: bool) -> None:
    box, angle = trimesh.creation.box([0.1] * 3), np.deg2rad(degrees)
    axis = np.array([np.sin(angle), 0.0, np.cos(angle)])
    pressed = press_cups(MeshTree(box), np.array([[0.0, 0.0, 0.05]]), axis[None], CUP)
    assert pressed.sealed[0] == sealed
    if sealed:
        assert np.arccos(pressed.axes[0, 2]) < 0.05  # 0.5 mm of gap over the lip's radius


def largest(direction: FloatArray, moment: FloatArray) -> float:
    """Return how many times a cup at the origin carries a force and a moment about its lip."""
    at_lip = CupWrenches.of(CUP, FRICTION, np.zeros((1, 3)), UP, origin=np.zeros(3))
    rates = at_lip.rows[0] @ np.concatenate([direction, moment])
    return float((at_lip.limits[0][rates > 1e-12] / rates[rates > 1e-12]).min())


def test_a_cup_carries_its_pull_its_friction_and_the_moment_over_its_edge() -> None:
    angle = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi)
    side, none = np.array([np.cos(angle), np.sin(angle), 0.0]), np.zeros(3)
    assert CUP.pull == pytest.approx(70e3 * np.pi * 1e-4)
    assert largest(UP[0], none) == pytest.approx(CUP.pull)
    shear = largest(side, none) / (FRICTION * CUP.pull)
    bend = largest(none, side) / (CUP.radius * CUP.pull)
    twist = largest(none, UP[0]) / (FRICTION * CUP.radius * CUP.pull)
    for limit in (shear, bend, twist):
        assert POLYGON - 1e-9 <= limit <= 1.0 + 1e-9


def test_a_load_beside_the_lip_bends_it() -> None:
    """A weight at an arm below a cup on a wall: ``m g d <= R V``, and friction ``m g <= mu V``."""
    arm = 0.05
    wall = CupWrenches.of(
        CUP, 5.0, np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]]), origin=np.array([-arm, 0.0, 0.0])
    )
    largest = CUP.pull * CUP.radius / arm
    spare = wall.spare_forces(np.array([0.9 * POLYGON, 1.01]) * largest)[:, 0]
    assert spare[0] > 0.0 == spare[1]


def ring_carries(force: FloatArray, moment: FloatArray) -> bool:
    """Return whether point contacts on the lip, and the vacuum, apply a force and a moment."""
    around, edges = 48, 16
    angles, turns = (2.0 * np.pi * np.arange(n) / n for n in (around, edges))
    points = CUP.radius * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    cone = np.stack([np.cos(turns), np.sin(turns), 0.0 * turns], axis=1)
    cone = FRICTION / np.cos(np.pi / edges) * cone - UP  # contains the round cone
    wrenches = np.concatenate(
        [np.broadcast_to(cone, (around, edges, 3)), np.cross(points[:, None], cone) / CUP.radius],
        axis=-1,
    ).reshape(-1, 6)
    wanted = np.concatenate([force - CUP.pull * UP[0], moment / CUP.radius])
    solved = linprog(np.zeros(len(wrenches)), A_eq=wrenches.T, b_eq=wanted, method="highs")
    return bool(solved.status == 0)


def test_what_a_cup_is_said_to_carry_a_ring_of_points_with_friction_carries() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        center = np.append(rng.uniform(-0.04, 0.04, size=2), -rng.uniform(0.0, 0.08))
        cup = CupWrenches.of(CUP, FRICTION, np.zeros((1, 3)), UP, origin=center)
        way = rng.normal(size=3)
        rates = cup.rows[0, :, :3] @ way
        force = 0.999 * float((cup.limits[0][rates > 0.0] / rates[rates > 0.0]).min()) * way
        assert ring_carries(force, np.cross(center, force))
        assert not ring_carries(2.0 * force, np.cross(center, 2.0 * force))


def test_grasps_seal_on_the_mesh_press_along_the_axis_and_are_the_same_for_a_seed() -> None:
    box = shapes.find("box").mesh
    height = float(box.bounds[0, 2])
    sampler = sampler_of(HAND, LoadPrior(friction=0.8), candidates=100)
    assert isinstance(sampler, SuctionSampler)
    found, again = (sampler.sample(box, rng=7, support_height=height, count=5) for _ in range(2))
    assert found == again
    assert len(found) == 5
    for grasp in found:
        (point,), (normal,) = grasp.contact_points, grasp.contact_normals
        assert seals_at(box, point, normal)
        np.testing.assert_allclose(grasp.approach_O, -normal, atol=1e-12)
        centers = HAND.pad_centers(grasp.X_OH, grasp.joint_positions)
        np.testing.assert_allclose(centers[0], point, atol=1e-12)
    ranks = [grasp.success_probability for grasp in found]
    assert ranks == sorted(ranks, reverse=True)
    assert found.rejections["no_seal"] > 0


def test_an_uncertain_face_is_not_chosen() -> None:
    """A slope of the height by a few degrees over the correlation length leaks."""
    box = trimesh.creation.box([0.08, 0.08, 0.08]).subdivide_to_size(0.01)
    uncertain = np.where(box.vertices[:, 2] > 0.0399, 0.006, 0.0002)
    box.vertex_attributes["uncertainty"] = uncertain
    found = SuctionSampler(HAND, candidates=100).sample(box, count=40)
    on_top = np.array([grasp.contact_normals[0, 2] > 0.9 for grasp in found])
    closure = np.array([grasp.quality["closure_probability"] for grasp in found])
    assert not on_top[:5].any()
    assert closure[~on_top].max() > 0.9
    assert closure[on_top].max(initial=0.0) < 0.8


def test_a_bar_narrower_than_the_lip_has_no_seal() -> None:
    bar = trimesh.creation.box([0.1, 0.012, 0.012])
    found = SuctionSampler(HAND, candidates=300).sample(bar)
    assert not len(found)
    assert found.rejections == {"no_seal": 300}
    top = np.array([[0.0, 0.0, 0.006]])
    assert cup_epsilon(bar, CUP, top, UP, friction=FRICTION)[0] == 0.0


def test_a_hand_goes_to_its_own_sampler() -> None:
    jaw = Hand.load("wsg50")
    assert isinstance(sampler_of(jaw), ForceClosureSampler)
    with pytest.raises(InvalidOptionError):
        SuctionSampler(jaw)
    with pytest.raises(InvalidOptionError):
        ForceClosureSampler(HAND)


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("kind: suction_cup", "kind: multi_finger", "cups"),
        ("cups:", "pads:", "pads.cup.half_angle"),
        ("vacuum: 70000", "vacuum: 200000", "cups.cup.vacuum"),
        ("radius: 0.01,", "radius: 0.01, colour: 3,", "cups.cup.colour"),
        ("link: lip,", "link: lips,", "cups.cup.link"),
    ],
)
def test_a_wrong_cup_names_its_key(old: str, new: str, key: str, tmp_path: object) -> None:
    folder = model_path("hands/cup")
    text = (
        (folder / "cup.yaml")
        .read_text(encoding="utf-8")
        .replace("urdf: cup", f"urdf: {folder}/cup")
    )
    path = tmp_path / "cup.yaml"  # type: ignore[operator]
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InvalidHandError) as error:
        Hand.load(path)
    assert error.value.key == key


@pytest.mark.slow
@pytest.mark.parametrize("module", [samplers, seals, suction])
def test_the_examples_run(module: object) -> None:
    space = {"Hand": Hand, "shapes": shapes, "np": np, "MeshTree": MeshTree, "replace": replace}
    report = doctest.testmod(module, extraglobs=space)  # type: ignore[arg-type]
    assert report.attempted
    assert not report.failed
