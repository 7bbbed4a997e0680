"""Bodies beside the object on the page of a run: where touches left them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lis_grasp.exploration import LoggedProbe, Observation, Probe, ProbeOutcome
from lis_grasp.exploration.disturbance import Disturbance
from lis_grasp.exploration.planar_motion import PoseBelief
from lis_grasp.geometry import make_pose
from lis_grasp.motion import OBJECT, Motion, beside_body
from lis_grasp.results.page import _beside
from lis_grasp.robots.hand import Hand
from lis_grasp.visualization._drawing import Canvas
from lis_grasp.visualization._object_layers import free_body_node
from lis_grasp.visualization.hand_layers import draw_motion
from lis_grasp.world import ALONE, Body, Surroundings

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


def test_a_free_body_moves_in_the_player_as_in_the_lift() -> None:
    hand = Hand.load("wsg50")
    free = Body.box("crate", (0.06, 0.06, 0.1), (0.2, 0.0, 0.05), mass=0.3)
    wall = Body.box("wall", (0.02, 0.4, 0.2), (0.3, 0.0, 0.1))
    still = np.repeat(np.eye(4)[None], 2, axis=0)
    X_WB = np.repeat(free.X_EB[None], 2, axis=0)
    X_WB[1, :3, 3] += [0.0, 0.03, 0.0]
    motion = Motion(np.array([0.0, 1.0]), {OBJECT: still, beside_body("crate"): X_WB})
    canvases = []
    for surroundings in (ALONE, Surroundings((wall, free))):
        canvas = Canvas()
        draw_motion(canvas, motion, hand, surroundings=surroundings)
        canvases.append(canvas)
    alone, beside = (canvas.commands[-1] for canvas in canvases)
    assert free_body_node(0).encode() not in alone
    assert free_body_node(0).encode() in beside
