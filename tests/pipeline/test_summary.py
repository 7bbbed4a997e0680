"""Reasons and summaries in words."""

from typing import Any, get_args

import numpy as np
import pytest
import trimesh

from lis_grasp import shapes
from lis_grasp.grasping.hand_capacity import narrowest_width
from lis_grasp.grasping.sampler import ForceClosureSampler
from lis_grasp.lifting.outcome import Reason
from lis_grasp.results.summary import (
    LIFT_REASONS,
    REJECTIONS,
    exploration_lines,
    headline,
    run_lines,
)
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import opening_range


def facts(**changed: Any) -> dict[str, Any]:
    return {
        "asked": 40,
        "contacts": 40,
        "probes": 44,
        "ended": "40 contacts made",
        "covered_radius": 0.025,
        "reachable_coverage": 0.97,
        "estimate_coverage": 1.0,
    } | changed


def report(*, iou: float, reason: str) -> dict[str, Any]:
    return {
        "exploration": facts(),
        "surface": {"edge_rmsd": None, "rmsd": 0.001, "iou": iou},
        "grasps": {"number": 0, "rejections": {"steep": 70, "out_of_reach": 30}},
        "attempts": [{"reason": reason}],
        "lift": {"lifted": False, "held": False, "reason": reason},
    }


def test_every_reason_of_a_lift_has_a_sentence() -> None:
    assert set(LIFT_REASONS) == {*get_args(Reason), "no_grasp"}


@pytest.mark.slow
def test_every_reason_of_a_rejection_has_a_sentence() -> None:
    mesh = shapes.build("torus").mesh
    for hand in ("allegro", "wsg50"):
        search = ForceClosureSampler(Hand.load(hand), candidates=200).sample(
            mesh, rng=np.random.default_rng(0), support_height=float(mesh.bounds[0, 2])
        )
        assert len(search.rejections) > 3
        assert set(search.rejections) <= set(REJECTIONS)


def test_missing_contacts_are_named_with_the_cause() -> None:
    text = "\n".join(exploration_lines(facts(contacts=17, ended="180 probes made")))
    assert "17 of 40" in text
    assert "180 probes made" in text
    assert "180 probes made" not in "\n".join(exploration_lines(facts()))


def test_the_coverage_of_the_truth_is_beside_that_of_the_estimate() -> None:
    (line,) = (line for line in exploration_lines(facts()) if "97 %" in line)
    assert "100 %" in line
    assert "25 mm" in line


def test_a_low_overlap_of_volumes_is_named_and_a_high_one_is_not() -> None:
    assert "0.32" in "\n".join(run_lines(report(iou=0.32, reason="no_grasp")))
    assert "0.95" not in "\n".join(run_lines(report(iou=0.95, reason="no_grasp")))


@pytest.mark.parametrize("reason", [reason for reason in LIFT_REASONS if reason != "held"])
def test_a_lift_that_failed_ends_in_a_sentence_without_its_code(reason: str) -> None:
    last = run_lines(report(iou=0.9, reason=reason))[-1]
    assert LIFT_REASONS[reason] in last
    assert "_" not in last
    made = report(iou=0.9, reason=reason) | {"touches": 9}
    made["attempts"][-1]["success_probability"] = None
    assert headline(made)[0][1] == "not held"


def test_without_a_grasp_the_most_frequent_rejection_is_named() -> None:
    last = run_lines(report(iou=0.9, reason="no_grasp"))[-1]
    assert "70 %" in last
    assert last.endswith(REJECTIONS["steep"])


def test_the_grippers_opening_is_its_stroke() -> None:
    # Two pads, each moved by up to 55 mm from the middle.
    assert opening_range(Hand.load("wsg50"))[1] == pytest.approx(0.11)


def test_the_width_of_a_turned_plate_is_its_thickness() -> None:

    plate = trimesh.creation.box((0.4, 0.3, 0.02))
    plate.apply_transform(trimesh.transformations.euler_matrix(0.5, -0.8, 0.3))
    assert narrowest_width(plate) == pytest.approx(0.02, rel=1e-4)  # directions to 6 digits
    assert narrowest_width(shapes.build("sphere", 1.8).mesh) == pytest.approx(1.8, rel=2e-3)


def test_a_run_with_an_arm_says_what_was_demanded_of_it() -> None:
    use = {"effort": 0.36, "speed": 0.5, "contacts": {}}
    shakes = [
        {"direction": "x", "asked": 10.0, "by_motion": 4.0},
        {"direction": "y", "asked": 10.0, "by_motion": 10.0},
    ]
    made = report(iou=1.0, reason="dropped") | {
        "arm": {"name": "iiwa14", "touches": use | {"contact_force": 0.31}}
    }
    made["lift"] = made["lift"] | {"arm": use | {"effort": 0.42, "shakes": shakes}}
    (line,) = (line for line in run_lines(made) if line.startswith("arm "))
    assert "42 % of its efforts" in line
    assert "0.3 N" in line
    assert "unwanted contacts: none" in line
    assert "along x by 4.0 of 10.0 m/s^2" in line
    assert not any(line.startswith("arm ") for line in run_lines(report(iou=1.0, reason="dropped")))


def test_the_summary_says_what_each_attempt_taught_and_the_margin_of_the_grip() -> None:
    made = report(iou=1.0, reason="dropped")
    lesson = {"felt": 3, "touched": 4, "probes": 9, "moved": 0.021, "lost": False}
    lost = lesson | {"lost": True, "touched": 20}
    first = {"reason": "not_lifted", "lesson": lesson}
    made["attempts"] = [first, {"reason": "turned", "lesson": lost}, {"reason": "dropped"}]
    made["lift"] = made["lift"] | {"weighed": 0.6, "grip_margin": 0.43}
    lines = run_lines(made)
    one, two = (line for line in lines if line.startswith("grasp"))
    found = "3 contacts felt; found 21 mm away; 9 probes, 4 new contacts"
    assert one == f"grasp 1 not lifted; then {found}"
    assert "turned" in two
    assert "explored anew, 20 contacts" in two
    (weighed,) = (line for line in lines if line.startswith("weighed"))
    assert "0.6 kg" in weighed
    assert "0.4 times" in weighed


def test_a_violation_is_said_plainly() -> None:
    fine = {"effort": 0.36, "speed": 0.5, "contacts": {}, "steps": 10}
    bad = {
        "effort": 1.0,
        "effort_joint": "joint_2",
        "speed": 1.2,
        "speed_joint": "joint_4",
        "contacts": {"palm with table": 1, "arm's link_5 with object": 7},
        "forces": {"palm with table": 0.25},
        "steps": 20,
    }
    made = report(iou=1.0, reason="dropped")
    # A grasp that was given up counts as the last one does.
    made["attempts"] = [{"reason": "aborted", "arm": bad}, {"reason": "dropped", "arm": fine}]
    made["arm"] = {"name": "iiwa14", "touches": fine | {"contact_force": 0.31}}
    made["lift"] = made["lift"] | {"arm": fine | {"shakes": []}}
    (line,) = (line for line in run_lines(made) if line.startswith("arm "))
    assert "unwanted contacts or limits (of 40 steps) while lifting: " in line
    assert "palm with table in 1 step with up to 0.25 N" in line
    assert "while touching" not in line
    assert "arm's link_5 with object in 7 steps" in line
    assert "joint_2 at its largest effort" in line
    assert "joint_4 at 120 % of its speed" in line
