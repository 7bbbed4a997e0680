"""The next touch of an object: a probe that the hand can begin, away from the contacts."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

import lis_grasp
from lis_grasp import Contacts, Hand, pipeline, shapes
from lis_grasp.cli.main import main
from lis_grasp.exceptions import EstimationError, InvalidOptionError
from lis_grasp.exploration import Exploration, Probe, Region, Workspace
from lis_grasp.exploration.planar_motion import PoseBelief
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.io import provenance
from lis_grasp.probing.probe_planner import ProbePlanner
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.next_touch import ObjectPlace, next_touch


@pytest.fixture(scope="module")
def explored() -> Exploration:
    config = pipeline.RunConfig(prober="kinematic", touches=7)
    return pipeline.touch(pipeline.Scenario.from_config(config, shapes.build("mallet")))


def known(hand: Hand, space: Workspace | Region) -> pipeline.Known:
    return Agent.of(pipeline.RunConfig(), 0.0, hand=hand).placed(space)


@pytest.mark.by_default("wsg50")
@pytest.mark.parametrize("name", ["allegro", "wsg50"])
def test_the_hand_is_at_the_start_of_the_probe(name: str, explored: Exploration) -> None:
    hand, contacts = Hand.load(name), explored.contacts
    space = ObjectPlace(held=True).space(contacts)
    found = next_touch(known(hand, space), Contacts.empty(), explored.observations)
    posture, probe = found.approach.posture, found.probe
    X_OL = hand.forward_kinematics(found.approach.X_OH, posture.joint_positions)[posture.link]
    center = X_OL[:3, :3] @ posture.center_L + X_OL[:3, 3]
    assert center + posture.radius * probe.direction == pytest.approx(probe.start, abs=1e-9)
    nearest = np.linalg.norm(contacts.points - probe.target, axis=1).min()
    assert found.distance == pytest.approx(nearest)
    assert nearest > 0.5 * contacts.spacing
    again = next_touch(known(hand, space), Contacts.empty(), explored.observations)
    assert again.facts(hand) == found.facts(hand)


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["spread", pytest.param("random", marks=pytest.mark.slow)])
def test_the_next_touch_is_that_of_the_exploration(policy: str) -> None:
    placed = {"pose": "stable", "region": (0.3, 0.3, 0.3), "policy": policy, "seed": 1}
    config = pipeline.RunConfig("box", prober="kinematic", estimator="gpis", touches=12, **placed)
    scenario = pipeline.Scenario.from_config(config)
    exploration, sought = pipeline.touch(scenario), []
    outcomes = exploration.outcomes
    for made in range(len(outcomes)):
        touch = next_touch(scenario.agent, Contacts.empty(), exploration.observations[:made])
        following = outcomes[made + touch.blocked]
        assert all(o.status == "blocked" for o in outcomes[made : made + touch.blocked])
        for name in ("target", "direction", "start"):
            expected = getattr(following.probe, name)
            np.testing.assert_allclose(getattr(touch.probe, name), expected, rtol=0, atol=1e-12)
        # A motion ends at the table; the prober of an exploration stops there by itself.
        assert touch.probe.overshoot <= following.probe.overshoot
        assert touch.sought in touch.why()
        sought.append(touch.sought)
    assert sought[0] == sought[-1] == ""  # before the first contact, and after the ends are found
    assert any(sought)


@pytest.mark.parametrize("seed", [0, 1])
def test_no_motion_of_the_hand_leads_below_the_table(seed: int) -> None:
    points = np.array([[0.03, 0.0, 0.02], [-0.03, 0.0, 0.05], [0.0, 0.02, 0.04], [0.0, 0, 0.08]])
    normals = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
    hand, contacts = Hand.load("wsg50"), Contacts(points, normals)
    agent = Agent.of(pipeline.RunConfig(seed=seed, policy="random"), 0.0, hand=hand)
    found = next_touch(agent.placed(ObjectPlace(support=0.0).space(contacts)), contacts)
    X_OH = found.approach.X_OH.copy()
    X_OH[:3, 3] += found.probe.end - found.probe.start
    checker = HandCollisionChecker(hand)
    poses = X_OH @ checker.poses_in_hand(found.approach.posture.joint_positions)
    assert checker.lowest(poses) >= -1e-9
    assert found.probe.end[2] >= -1e-9


@pytest.mark.parametrize(("standoff", "overshoot"), [(0.05, 0.03), (0.05, 0.2), (0.15, 0.05)])
def test_a_motion_down_ends_with_the_hand_at_the_table(standoff: float, overshoot: float) -> None:
    hand, space = Hand.load("wsg50"), Workspace(0.02, np.array([0, 0, 0.1]), 0.2, 0.0)
    obstacles, planner = ObstacleModel(space, Contacts.empty(), None), ProbePlanner(hand)
    along = np.array([0.6, 0.0, -0.8])
    probe = Probe(np.array([0.0, 0.0, 0.1]) + standoff * along, along, standoff, overshoot)
    approach = next(planner.starts(probe))
    ended = planner.ended_before(approach, probe, obstacles)
    planned = probe.standoff + probe.overshoot
    length = min(planned, planner.above_table(approach, probe, obstacles))
    assert ended.start == pytest.approx(probe.start, abs=1e-12)
    assert ended.standoff + ended.overshoot == pytest.approx(length, abs=1e-12)
    assert (ended is probe) == (length == planned)


def test_what_was_before_a_loss_does_not_count(explored: Exploration) -> None:
    contacts, hand = explored.contacts, Hand.load("allegro")
    lost = replace(PoseBelief.start(), trust="lost")
    lost = replace(explored.observations[-1], belief=lost)
    space, others = ObjectPlace(held=True).space(contacts), explored.observations[::-1]
    found = next_touch(known(hand, space), Contacts.empty(), [*others, lost])
    again = next_touch(known(hand, space), contacts, [*explored.observations, lost])
    assert again.facts(hand) == found.facts(hand)


@pytest.mark.slow
def test_without_contacts_the_size_is_needed() -> None:
    at_one_place = Contacts([[0.0, 0.0, 0.1]], [[0.0, 0.0, 1.0]])
    for known_contacts in (Contacts.empty(), at_one_place):
        with pytest.raises(InvalidOptionError) as error:
            ObjectPlace(held=True).space(known_contacts)
        assert error.value.option == "size"
    with pytest.raises(InvalidOptionError) as error:
        ObjectPlace(size=0.1).space(Contacts.empty())
    assert error.value.option == "support"
    space = ObjectPlace(size=0.1, held=True).space(Contacts.empty())
    found = next_touch(known(Hand.load("allegro"), space), Contacts.empty())
    assert found.distance is None
    assert "no contacts" in found.why()
    for seed in range(5):  # on a table, the first touch is above it
        standing = ObjectPlace(size=0.1, support=0.3).space(Contacts.empty())
        config = pipeline.RunConfig(seed=seed)
        first = Agent.of(config, 0.0, hand=Hand.load("allegro")).placed(standing)
        probe = next_touch(first, Contacts.empty()).probe
        assert min(probe.start[2], probe.target[2]) > 0.3


def test_a_place_that_cannot_be_approached_is_one_sentence(explored: Exploration) -> None:
    contacts = explored.contacts
    buried = Workspace(0.03, contacts.bounds.mean(axis=0), 0.12, support_height=1.0)
    with pytest.raises(EstimationError, match="`support`"):
        next_touch(known(Hand.load("allegro"), buried), contacts)


def test_the_command_writes_the_touch(explored: Exploration, tmp_path: Path) -> None:
    path = tmp_path / "contacts.ply"
    explored.contacts.save(path)
    assert main(["next", str(path), "--hand", "wsg50"]) == 0
    written = json.loads((tmp_path / "next.json").read_text())
    hand, space = Hand.load("wsg50"), ObjectPlace().space(explored.contacts)
    found = next_touch(known(hand, space), explored.contacts)
    assert written == json.loads(json.dumps(found.facts(hand)))
    assert main(["next", str(path), "--size", "0"]) == 2


@pytest.mark.parametrize("free", [False, True])
def test_slides_are_proposed_unless_the_object_is_free(
    free: bool, explored: Exploration, tmp_path: Path
) -> None:
    path, low = tmp_path / "contacts.ply", float(explored.contacts.bounds[0, 2])
    explored.contacts.save(path, header=provenance.describe(support_height=low, free=free))
    assert main(["next", str(path), "--hand", "wsg50", "--slide", "0.02"]) == 0
    slides = json.loads((tmp_path / "next.json").read_text()).get("slides", [])
    assert bool(slides) is not free
    assert [np.linalg.norm(slide) for slide in slides] == pytest.approx([0.02] * len(slides))


@pytest.mark.slow
def test_the_command_reads_contacts_as_an_estimate_does(
    explored: Exploration, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def target(points: np.ndarray, normals: np.ndarray, *options: str) -> list[float]:
        path = tmp_path / "touched.csv"
        Contacts(points, normals).save(path)
        assert main(["next", str(path), "--hand", "wsg50", *options]) == 0
        return json.loads((tmp_path / "next.json").read_text())["target"]

    points, normals = explored.contacts.points, explored.contacts.normals
    expected = pytest.approx(target(points, normals), abs=1e-9)
    assert target(1e3 * points, normals, "--units", "mm") == expected
    assert target(points, -normals, "--normals", "inward") == expected
    centers = points + 0.01 * normals
    assert target(centers, normals, "--fingertip-radius", "0.01") == expected
    assert main(["next", "touched.csv", "--units", "mm", "--serve"]) == 2
    assert "write contacts.ply by lis-grasp estimate with --units" in capsys.readouterr().err


def test_in_a_region_the_first_touch_is_a_search(tmp_path: Path) -> None:
    assert main(["next", "--region", "0.4", "0.4", "0.3", "--output", str(tmp_path)]) == 0
    written = json.loads((tmp_path / "next.json").read_text())
    start, end = np.array(written["start"]), np.array(written["end"])
    assert np.linalg.norm(end - start) >= 0.4
    assert start[2] == end[2] > 0.0
    assert "no contacts" in written["why"]


@pytest.mark.slow
def test_the_command_uses_the_region_and_the_table_that_a_file_records(
    explored: Exploration, tmp_path: Path
) -> None:
    contacts, hand = explored.contacts, Hand.load("wsg50")
    path, low = tmp_path / "contacts.ply", float(contacts.bounds[0, 2])

    def written(header: dict[str, object], *options: str) -> object:
        contacts.save(path, header=provenance.describe(hand="wsg50", **header))
        assert main(["next", str(path), *options]) == 0
        return json.loads((tmp_path / "next.json").read_text())

    def expected(space: Workspace | Region) -> object:
        return json.loads(json.dumps(next_touch(known(hand, space), contacts).facts(hand)))

    table = expected(ObjectPlace(support=low).space(contacts))
    assert written({"support_height": low}) == table
    assert written({"support_height": low - 1.0}, "--support", str(low)) == table
    lengths = [0.4, 0.4, 0.3]
    placed = {"support_height": 0.0, "region": lengths, "pose": "stable"}
    assert written(placed) == expected(Region(lengths))
    assert written(placed, "--support", str(low)) == table


@pytest.mark.slow
def test_without_a_table_the_hand_stays_above_the_lowest_contact(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # A mug on z = 0, touched at its side: the palm went below z = 0.
    hand, heights = Hand.load("allegro"), [0.02, 0.05, 0.08]
    angles = np.linspace(0.0, 5.0, 12)
    normals = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(12)])
    points = 0.04 * normals + np.column_stack([np.zeros((12, 2)), np.tile(heights, 4)])
    path = tmp_path / "mug.ply"
    Contacts(points, normals).save(path)
    for seed in range(3):
        assert main(["next", str(path), "--seed", str(seed)]) == 0
        assert "z = 20.0 mm" in capsys.readouterr().out
        written = json.loads((tmp_path / "next.json").read_text())
        q = np.array(written["joint_positions"])
        for name in ("X_OH_outside", "X_OH"):
            links = hand.forward_kinematics(np.array(written[name]), q)
            lowest = min(
                float((g.mesh.vertices @ X[2, :3] + X[2, 3]).min())
                for g in hand.link_geometries
                for X in [links[g.link] @ g.X_LG]
            )
            # Points of the hand are at most 15 mm apart.
            assert lowest > 0.02 - 0.0075
    assert main(["next", str(path), "--support", "none"]) == 0
    assert "no table" not in capsys.readouterr().out


@pytest.mark.parametrize("name", [pytest.param("allegro", marks=pytest.mark.slow), "wsg50"])
def test_the_hand_keeps_off_obstacles_on_its_approach_and_motion(
    name: str, explored: Exploration, tmp_path: Path
) -> None:
    # A wall 2 cm behind the object: some touches from there, the others not.
    hand, contacts = Hand.load(name), explored.contacts
    wall = trimesh.creation.box(extents=[0.01, 2.0, 2.0])
    face = float(contacts.bounds[0, 0]) - 0.02
    wall.apply_translation([face - 0.005, 0.0, 0.0])
    wall.export(tmp_path / "wall.stl")
    space, hits = ObjectPlace(held=True).space(contacts), 0
    for seed in range(3):
        for obstacles in (None, str(tmp_path / "wall.stl")):
            config = pipeline.RunConfig(policy="random", seed=seed, obstacles=obstacles)
            found = next_touch(Agent.of(config, 0.0, hand=hand).placed(space), contacts)
            end, path = np.array(found.approach.X_OH), [found.approach.X_OH_outside]
            end[:3, 3] += found.probe.end - found.probe.start
            lowest = np.inf
            for X_OH in (*path, found.approach.X_OH, end):
                links = hand.forward_kinematics(X_OH, found.approach.posture.joint_positions)
                for g in hand.link_geometries:
                    points = trimesh.transform_points(g.mesh.vertices, links[g.link] @ g.X_LG)
                    lowest = min(lowest, float(points[:, 0].min()))
            if obstacles is None:
                hits += lowest < face
            else:
                assert lowest >= face - 1e-4
    assert hits > 0


@pytest.mark.parametrize("policy", ["spread", pytest.param("uncertainty", marks=pytest.mark.slow)])
def test_a_target_on_a_held_object_is_on_the_mesh_of_its_estimate(policy: str) -> None:
    # The lower half of the walls of a flat box was not touched: the estimate goes on downwards.
    x, y = np.linspace(-0.06, 0.06, 4), np.linspace(-0.05, 0.05, 4)
    walls = [([0.07 * s, b, z], [s, 0, 0]) for s in (-1, 1) for b in y for z in (0.04, 0.06)]
    walls += [([a, 0.06 * s, z], [0, s, 0]) for s in (-1, 1) for a in x for z in (0.04, 0.06)]
    top = [([a, b, 0.07], [0, 0, 1]) for a in x for b in y]
    contacts = Contacts(*map(np.array, zip(*walls, *top, strict=True)))
    target = lis_grasp.next_touch(contacts, "wsg50", held=True, policy=policy).probe.target
    mesh = lis_grasp.extract_mesh(lis_grasp.estimate(contacts))
    (distance,) = distances_to_mesh(target[None], mesh)[0]
    assert distance < 0.001  # half a cell of the mesh, at most
    beyond = lis_grasp.next_touch(contacts, "wsg50", held=True, policy=policy, size=0.3)
    assert beyond.probe.target[2] < mesh.bounds[0, 2]  # the size says that there is more
