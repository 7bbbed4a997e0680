"""One-line representations of the records that people print."""

from __future__ import annotations

from copy import copy, deepcopy

import numpy as np
from made_grasps import jaw_grasp

from lis_grasp import Contacts, GraspSearch, Hand, pipeline, shapes
from lis_grasp.surfaces import ESTIMATORS, carved


def test_records_print_as_one_short_line() -> None:
    axes = np.vstack([np.eye(3), -np.eye(3)])
    contacts, hand = Contacts(0.03 * axes, axes), Hand.load("wsg50")
    surfaces = [make(contacts) for make in ESTIMATORS.values()]
    config = pipeline.RunConfig(hand="wsg50", prober="kinematic", touches=2)
    exploration = pipeline.touch(pipeline.Scenario.from_config(config, shapes.build("box")))
    outcome = exploration.outcomes[0]
    search = GraspSearch((jaw_grasp(hand, np.zeros(3), 0.06),), {"no_solution_of_ik": 19}, 20)
    records = [contacts, hand, *surfaces, carved(surfaces[0], exploration.contacts), exploration]
    records += [outcome, outcome.probe, outcome.hand_pose, search, *search.grasps]
    for record in records:
        text = repr(record)
        assert text.startswith(type(record).__name__)
        assert "\n" not in text
        assert len(text) < 600, text


def test_a_copy_of_a_record_is_the_record() -> None:
    axes = np.vstack([np.eye(3), -np.eye(3)])
    contacts = Contacts(0.03 * axes, axes)
    config = pipeline.RunConfig(hand="wsg50", prober="kinematic", touches=2)
    exploration = pipeline.touch(pipeline.Scenario.from_config(config, shapes.build("box")))
    search = GraspSearch((jaw_grasp(Hand.load("wsg50"), np.zeros(3), 0.06),), {}, 1)
    outcome = exploration.outcomes[0]
    for record in (contacts, exploration, outcome, outcome.probe, search, *search):
        assert deepcopy(record) is copy(record) is record
