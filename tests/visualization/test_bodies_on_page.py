"""Bodies beside the object on the page of a run: where touches left them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lis_grasp.exploration import LoggedProbe, Observation, Probe, ProbeOutcome
from lis_grasp.exploration.disturbance import Disturbance
from lis_grasp.exploration.planar_motion import PoseBelief
from lis_grasp.geometry import make_pose
from lis_grasp.results.page import _beside

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_world" / "bin.dmd.yaml"


def test_a_pushed_body_is_shown_where_it_is_in_the_frame_of_the_contacts() -> None:
    facts = {"world": str(EXAMPLE), "at": "middle", "support_height": 0.0}
    X_WE = make_pose(np.eye(3), [0.004, 0.0, 0.0])
    X_WB = make_pose(np.eye(3), [0.08, 0.09, 0.04])
    outcome = ProbeOutcome(Probe(np.zeros(3), np.array([0.0, 0.0, -1.0]), 0.03, 0.03), "missed")
    belief = PoseBelief(X_WE, np.zeros((1, 3)), np.eye(3)[None], np.zeros(1))
    probes = (
        LoggedProbe(Observation(outcome), None, Disturbance(poses={"carton": X_WB})),
        LoggedProbe(Observation(outcome, belief), None, None),
    )
    bodies = {body.name: body.X_EB for body in _beside(facts, probes)}
    np.testing.assert_allclose(X_WE @ bodies["carton"], X_WB, atol=1e-12)
    np.testing.assert_allclose(X_WE @ bodies["bin"], np.eye(4), atol=1e-12)
    at_first = {body.name: body.X_EB for body in _beside(facts, None)}
    np.testing.assert_allclose(at_first["carton"][:3, 3], [0.11, 0.11, 0.04], atol=1e-12)
    # A finished run has the pose of the frame in its facts.
    finished = {body.name: body.X_EB for body in _beside(facts | {"X_WE": X_WE.tolist()}, None)}
    np.testing.assert_allclose(X_WE @ finished["carton"], at_first["carton"], atol=1e-12)
