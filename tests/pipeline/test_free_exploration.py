"""Exploration of a free object: it resumes where it was interrupted, and uses no true pose."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lis_grasp import pipeline
from lis_grasp.contacts import HALF_SPACE
from lis_grasp.exploration import Exploration, Probe, ProbeOutcome
from lis_grasp.exploration.touch_log import read_log
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.pipeline.names_of_2 import UNKNOWN
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.results.exploring import explore_into
from lis_grasp.simulation.drake.dynamic_prober import DynamicProber

# A ball of 50 g that rolls at every touch.
CONFIG = pipeline.RunConfig(object="sphere", free=True, mass=0.05, friction=0.5, touches=6)
SCENARIO = pipeline.Scenario.from_config(CONFIG)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Exploration, bytes]:
    path = tmp_path_factory.mktemp("whole") / "touches.jsonl"
    _, exploration = explore_into(path.parent, SCENARIO)
    return exploration, path.read_bytes()


@pytest.mark.slow
def test_the_object_moves_from_probe_to_probe(
    whole: tuple[Exploration, bytes], tmp_path: Path
) -> None:
    path = tmp_path / "touches.jsonl"
    path.write_bytes(whole[1])
    poses = np.array([probe.X_EO for probe in read_log(path)[1]])
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert np.sum(steps > 1e-5) >= 4


@pytest.mark.slow
def test_an_interrupted_exploration_resumes_with_the_same_bytes(
    whole: tuple[Exploration, bytes], tmp_path: Path
) -> None:
    lines = whole[1].splitlines(keepends=True)
    path = tmp_path / "touches.jsonl"
    path.write_bytes(b"".join(lines[:5]))  # the header and four probes
    explore_into(path.parent, SCENARIO)
    assert path.read_bytes() == whole[1]


@pytest.mark.slow
def test_a_lie_about_the_true_pose_changes_no_contact(
    whole: tuple[Exploration, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    honest = DynamicProber.probe

    def lying(
        self: DynamicProber, probe: Probe, obstacles: ObstacleModel | None = None
    ) -> ProbeOutcome:
        return replace(honest(self, probe, obstacles), moved=1.0)

    monkeypatch.setattr(DynamicProber, "probe", lying)
    monkeypatch.setattr(DynamicProber, "X_EO", np.diag([-1.0, 1.0, -1.0, 1.0]))
    exploration = pipeline.touch(SCENARIO)
    np.testing.assert_array_equal(exploration.contacts.points, whole[0].contacts.points)
    np.testing.assert_array_equal(exploration.contacts.normals, whole[0].contacts.normals)


@pytest.mark.slow
def test_an_ended_exploration_is_not_continued(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = pipeline.RunConfig(prober="kinematic", touches=14, until_success=0.5)
    scenario = pipeline.Scenario.from_config(config)
    _, first = explore_into(tmp_path, scenario)
    assert first.ended.startswith("with a probability")
    monkeypatch.setattr(KinematicProber, "probe", None)
    _, again = explore_into(tmp_path, scenario)
    assert again.ended == first.ended
    np.testing.assert_array_equal(again.contacts.points, first.contacts.points)


@pytest.mark.slow
def test_an_ended_exploration_keeps_the_space_beyond_its_ends(tmp_path: Path) -> None:
    config = pipeline.RunConfig(**{**UNKNOWN, "free": False}, prober="kinematic", touches=8)
    first, again = (
        explore_into(tmp_path, pipeline.Scenario.from_config(config))[1].contacts for _ in range(2)
    )
    assert np.any(first.free_radii == HALF_SPACE)
    np.testing.assert_array_equal(again.free_points, first.free_points)
