"""Strays in explorations: later touches contradict them, and their places are probed again."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from lis_grasp.exploration import Exploration, Probe, ProbeOutcome, Prober, TouchLog
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.pipeline import RunConfig, Scenario, touch
from lis_grasp.stages.touch import make_prober

CONFIG = RunConfig("mallet", hand="wsg50", prober="kinematic", touches=30, estimator="gpis")


@dataclass
class Stumbling:
    """A prober whose contacts of one touch are half an object outside of where they are."""

    prober: Prober
    at: int
    height: float
    made: int = 0

    def probe(self, probe: Probe, obstacles: ObstacleModel | None = None) -> ProbeOutcome:
        outcome = self.prober.probe(probe, obstacles)
        self.made += len(outcome.contacts) > 0
        if self.made != self.at or not len(outcome.contacts):
            return outcome
        self.made += 1
        raised = outcome.contacts.points + self.height * outcome.contacts.normals
        return replace(outcome, contacts=replace(outcome.contacts, points=raised))


@pytest.mark.slow
def test_a_stray_is_dropped_and_its_place_probed_again(tmp_path: Path) -> None:
    scenario = Scenario.from_config(CONFIG)
    prober = Stumbling(make_prober(scenario), 12, 0.5 * scenario.truth.shape.size)
    found = touch(scenario, prober=prober)
    (stray,) = np.vstack([observation.dropped for observation in found.observations])
    assert np.linalg.norm(found.contacts.points - stray, axis=1).min() > 1e-3
    assert len(found.contacts) == CONFIG.touches == len(found.touches)
    assert np.linalg.norm(scenario.truth.shape.mesh.nearest.on_surface([stray])[1]) > 0.02
    log = TouchLog(tmp_path / "touches.jsonl", {})
    for observation in found.observations:
        log.append(observation)
    again = Exploration.replay(log.read().observations, touches=CONFIG.touches)
    np.testing.assert_array_equal(again.contacts.points, found.contacts.points)


@pytest.mark.slow
def test_believing_all_keeps_the_stray() -> None:
    scenario = Scenario.from_config(replace(CONFIG, keep_all=True))
    prober = Stumbling(make_prober(scenario), 12, 0.5 * scenario.truth.shape.size)
    found = touch(scenario, prober=prober)
    assert not any(len(observation.dropped) for observation in found.observations)
