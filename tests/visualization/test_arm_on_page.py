"""The arm on a scene page: in the picture, and rigid with the hand on its way to a touch."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scenes
import trimesh
from numpy.testing import assert_allclose
from stations import station_with

from lis_grasp import pipeline
from lis_grasp.contacts import Contacts
from lis_grasp.exploration import LoggedProbe, Observation, Probe, ProbeOutcome
from lis_grasp.exploration.planar_motion import PoseBelief
from lis_grasp.exploration.probe import HandPose
from lis_grasp.exploration.touch_log import read_log
from lis_grasp.results import page as run_scene
from lis_grasp.visualization import Scene

STATION = station_with("wsg50")
BOX = trimesh.creation.box(extents=[0.06, 0.06, 0.12]).apply_translation([0.0, 0.0, 0.06])
DOWN = np.array([0.0, 0.0, -1.0])


def facts() -> dict:
    """Return what the page of two touches from above has."""
    hand = STATION.hand
    X_OH = STATION.palm_poses(STATION.arm.home)
    posture = next(iter(hand.probe_postures.values()))
    touches = []
    for x in (0.0, 0.02):
        moved = X_OH.copy()
        moved[:3, 3] = x, 0.0, 0.3
        touch = ProbeOutcome(
            Probe(np.array([x, 0.0, 0.12]), DOWN, 0.03, 0.02),
            "touched",
            Contacts(np.array([[x, 0.0, 0.12]]), -DOWN[None]),
            hand_pose=HandPose(moved, posture.joint_positions),
        )
        touches.append(touch)
    contacts = touches[0].contacts.append(touches[1].contacts)
    scene = Scene(
        truth=BOX,
        contacts=contacts,
        touches=touches,
        hand=hand,
        station=STATION,
        support_height=0.0,
    )
    return scenes.facts_of(scene.html())


def pose(numbers: list[float]) -> np.ndarray:
    return np.array(numbers).reshape(4, 4).T


def test_the_arm_carries_the_hand_all_along_the_approach() -> None:
    hand, arm = STATION.hand, STATION.arm
    flange, base = arm.links.index(arm.flange), hand.links.index(hand.base_link)
    for touch in facts()["touches"]:
        frames = touch["arm"]
        assert len(frames) == 4
        for place, frame in zip(np.linspace(0.0, touch["distance"], 4), frames, strict=True):
            expected = pose(touch["links"][base])
            expected[:3, 3] -= place * np.array(touch["direction"])
            carried = pose(frame[flange]) @ arm.X_LF @ STATION.mount.X_FB
            assert_allclose(carried, expected, atol=1e-3)


def test_the_picture_contains_the_arm_and_its_foot() -> None:
    camera = facts()["camera"]
    points = np.array(camera["arm"])
    low, high = points.min(axis=0), points.max(axis=0)
    assert (low[:2] <= STATION.X_WA[:2, 3]).all()
    assert (high[:2] >= STATION.X_WA[:2, 3]).all()
    assert low[2] <= 0.0
    links = arm_heights()
    assert high[2] >= max(links)


@pytest.mark.slow
def test_a_growing_exploration_shows_its_arm_where_the_object_moved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = {"prober": "kinematic", "touches": 5}
    config = pipeline.RunConfig("box", hand="wsg50", arm="iiwa14", **options)
    scenario, _ = pipeline.explore_object(config, tmp_path)
    (tmp_path / "contacts.ply").unlink()
    header, probes = read_log(tmp_path / "touches.jsonl")
    moved = replace(PoseBelief.start(), X_WE=scenes.pose(0.02, -0.01, 0.0))
    probes = tuple(LoggedProbe(Observation(p.observation.outcome, moved)) for p in probes)
    monkeypatch.setattr(run_scene, "read_touches", lambda path: (header, probes))
    scene = run_scene.scene_of(tmp_path)
    assert [count for count, _ in scene.growth] == [3, 4]
    base = scenario.agent.station.X_WA[:3, 3] - [0.02, -0.01, 0.0]
    assert_allclose(scene.station.X_WA[:3, 3], base, atol=1e-12)


def arm_heights() -> list[float]:
    arm = STATION.arm
    links = arm.forward_kinematics(STATION.X_WA, arm.home)
    return [float(X[2, 3]) for X in links.values()]
