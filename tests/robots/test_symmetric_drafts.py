"""Drafts of hands with equal fingers: openings, palm frame and postures have their symmetry."""

from functools import cache
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from ring_gripper import joint, link, three_fingers
from scipy.spatial.transform import Rotation

from lis_grasp.robots.draft._symmetry import alike, symmetry_axis
from lis_grasp.robots.draft.pipeline import draft_hand
from lis_grasp.robots.hand import Hand


def jaw(most: float) -> str:
    """Return two jaws that slide apart along x, closed at 0, each by a stroke [m]."""
    parts = [link("body", '<box size="0.12 0.06 0.08"/>')]
    for side, sign in (("left", 1), ("right", -1)):
        limit = f'<limit lower="0" upper="{most}" effort="40" velocity="0.1"/>'
        moves = f'<axis xyz="{sign} 0 0"/>{limit}'
        at = f'xyz="{sign * 0.006} 0 0.04"'
        parts += [
            link(side, '<box size="0.012 0.02 0.06"/>', 0.03),
            joint(f"{side}_slide", "body", side, "prismatic", at, more=moves),
        ]
    return f'<robot name="jaw">{"".join(parts)}</robot>'


@cache
def drafted(description: str) -> Hand:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "hand.urdf"
        path.write_text(description)
        return draft_hand(path, name="hand", rng=np.random.default_rng(0)).hand


def test_the_widest_pregrasp_of_fingers_with_one_motor_is_the_limit_to_which_they_open() -> None:
    wide, *others = drafted(three_fingers()).pregrasps.values()
    np.testing.assert_array_equal(wide, 0.0)
    assert all((after > before).all() for before, after in pairwise((wide, *others)))


def test_fingers_that_fold_back_beyond_a_ball_are_not_drafted_at_that_limit() -> None:
    wide = next(iter(drafted(three_fingers((-1.4, 0.6))).pregrasps.values()))
    assert (wide > -1.0).all()


def test_the_palm_frame_of_three_equal_fingers_is_on_the_axis_of_their_ring() -> None:
    hand = drafted(three_fingers())
    np.testing.assert_allclose(hand.X_LH[:3, 2], [0, 0, 1], atol=1e-3)
    np.testing.assert_allclose(hand.X_LH[:3, 3], [0, 0, 0.02], atol=1e-3)
    assert 0.0 < hand.X_LH[2, 3] < 0.12  # behind the pads


@pytest.mark.parametrize("description", [three_fingers(), jaw(0.045), jaw(4.5)])
def test_equal_fingers_are_bent_alike_in_every_pregrasp(description: str) -> None:
    for q in drafted(description).pregrasps.values():
        assert np.ptp(q) == 0.0


def test_pads_have_the_axis_of_a_ring_only_while_all_are_bent_alike() -> None:
    hand = drafted(three_fingers())
    X_HL = np.linalg.inv(hand.X_LH)
    found = symmetry_axis(hand, np.full(3, 0.3))
    assert found is not None
    point, axis = found
    np.testing.assert_allclose(np.cross(axis, X_HL[:3, 2]), 0.0, atol=1e-3)
    np.testing.assert_allclose(np.cross(point - X_HL[:3, 3], X_HL[:3, 2]), 0.0, atol=1e-4)
    assert symmetry_axis(hand, np.array([0.3, 0.3, 0.35])) is None


@pytest.mark.parametrize("name", ["allegro", "barrett"])
def test_fingers_with_other_limits_or_a_shared_joint_are_not_evened(name: str) -> None:
    hand = Hand.load(name)
    q = next(iter(hand.pregrasps.values()))
    assert alike(hand, q) is None
    assert symmetry_axis(hand, q) is None


def test_pads_of_a_ring_reach_walls_30_degrees_beside_their_motion() -> None:
    """Two fingers are so on the sides of a box if the third one is on its end."""
    hand = drafted(three_fingers())
    axes = hand.pad_axes(np.eye(4), hand.pregrasps["medium"])
    motion = axes - np.outer(axes @ hand.approach_H, hand.approach_H)
    motion /= np.linalg.norm(motion, axis=1, keepdims=True)
    for sign in (-1.0, 1.0):
        turn = Rotation.from_rotvec(sign * np.pi / 6.0 * hand.approach_H)
        cosines = (turn.apply(motion) * axes).sum(axis=1)
        assert (np.arccos(cosines) < [pad.half_angle for pad in hand.pads]).all()
