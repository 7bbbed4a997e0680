"""What a hand's files say about it, checked against what touching and grasping need of a hand."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import trimesh

from lis_grasp.hands.collision import HandCollisionChecker
from lis_grasp.hands.hand import Hand
from lis_grasp.hands.hand_parts import Pad, ProbePosture
from lis_grasp.typing import FloatArray

# A pad counts as covered by its own finger where that stands out further than this [m].
_PAD_COVERED = 0.002
# A leading tip should be ahead of the rest by this much, or the rest touches flat things first [m].
_LEAD = 0.02
# Axes of two pads that can hold something between them are more than a right angle apart (cosine).
_OPPOSED = 0.0


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at.

    Parameters
    ----------
    fine
        Whether it is as it should be.
    text
        What was found, and, where it is not fine, what to mend.
    """

    fine: bool
    text: str


def check_hand(hand: Hand) -> list[Finding]:
    """Return what is fine and what is to mend, in the order in which it is worth mending."""
    checks = (_masses, _self_collisions, _pads, _opposition, _probe_postures, _forces)
    return [finding for check in checks for finding in check(hand)]


def _masses(hand: Hand) -> Iterator[Finding]:
    faults = []
    for link, inertial in hand.inertials.items():
        if inertial.mass <= 0.0:
            continue
        moments = np.sort(np.linalg.eigvalsh(inertial.inertia_L))
        if moments[0] <= 0.0 or moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-6):
            faults.append(link)
    if faults:
        yield Finding(
            False,
            f"the inertia of {', '.join(faults)} is that of no body: principal moments must be"
            " positive, and none larger than the other two together",
        )
    weight = 0.05 <= hand.mass <= 10.0
    advice = "" if weight else ": masses are in kg, and a hand has some"
    yield Finding(weight, f"the hand weighs {hand.mass:.2f} kg{advice}")


def _self_collisions(hand: Hand) -> Iterator[Finding]:
    nowhere = trimesh.creation.box(extents=[1e-3] * 3)
    nowhere.apply_translation([0.0, 0.0, 1e3])
    checker = HandCollisionChecker(hand, nowhere)
    postures = {f"pregrasp {name}": q for name, q in hand.pregrasps.items()}
    postures |= {f"probe posture {f}": p.joint_positions for f, p in hand.probe_postures.items()}
    hits = [n for n, q in postures.items() if checker.first_collision(np.eye(4), q) == "self"]
    if hits:
        yield Finding(
            False,
            f"links collide in {', '.join(hits)}: change the positions, or name pairs that touch by"
            " design under self_collision_exclusions",
        )
    else:
        yield Finding(True, f"no links collide in {len(postures)} postures")


def _pads(hand: Hand) -> Iterator[Finding]:
    q = next(iter(hand.pregrasps.values()))
    links = hand.forward_kinematics(np.eye(4), q)
    for pad in hand.pads:
        X_HL = links[pad.link]
        axis = X_HL[:3, :3] @ pad.axis_L
        face = float((X_HL[:3, :3] @ pad.center_L + X_HL[:3, 3]) @ axis) + pad.radius
        reach = _reach_along(hand, links, axis, _rigid_part(hand, pad))
        if reach > face + _PAD_COVERED:
            yield Finding(
                False,
                f"pad {pad.finger} lies {1e3 * (reach - face):.0f} mm below its link's surface:"
                " move its center, or enlarge its radius",
            )
        elif reach < face - 2.0 * _PAD_COVERED:
            yield Finding(
                False,
                f"pad {pad.finger} lies {1e3 * (face - reach):.0f} mm outside of its link: grasps"
                " will stop short of the object by that",
            )
        else:
            yield Finding(True, f"pad {pad.finger} is on the surface of {pad.link}")


def _opposition(hand: Hand) -> Iterator[Finding]:
    spans = []
    for name, q in hand.pregrasps.items():
        axes, centers = hand.pad_axes(np.eye(4), q), hand.pad_centers(np.eye(4), q)
        for i in range(len(hand.pads)):
            for j in range(i):
                apart = centers[j] - centers[i]
                length = float(np.linalg.norm(apart))
                facing = axes[i] @ apart > 0.0 and axes[j] @ apart < 0.0
                if facing and axes[i] @ axes[j] < _OPPOSED:
                    gap = length - hand.pads[i].radius - hand.pads[j].radius
                    spans.append((gap, name))
    if not spans:
        yield Finding(
            False,
            "no two pads face each other in any pregrasp, so nothing can be held between them:"
            " open the hand with a thumb opposite to the fingers",
        )
        return
    low, high = min(spans), max(spans)
    yield Finding(
        True,
        f"opened, pads that face each other are {1e3 * low[0]:.0f} mm ({low[1]}) to"
        f" {1e3 * high[0]:.0f} mm ({high[1]}) apart: objects up to about that can be grasped",
    )


def _probe_postures(hand: Hand) -> Iterator[Finding]:
    for finger, posture in hand.probe_postures.items():
        lead, rival = _lead(hand, posture)
        own = hand.link_fingers.get(rival) == finger
        if lead < 0.0:
            yield Finding(
                False,
                f"in probe posture {finger}, {rival} is {-1e3 * lead:.0f} mm ahead of the tip's"
                " sphere: change direction, positions or tip",
            )
        elif not own and lead < _LEAD:
            yield Finding(
                False,
                f"in probe posture {finger}, the tip is only {1e3 * lead:.0f} mm ahead of {rival},"
                " which will touch flat objects first: fold the other fingers away",
            )
        else:
            yield Finding(
                True,
                f"in probe posture {finger}, the tip is {1e3 * lead:.0f} mm ahead of {rival}",
            )
    if not hand.probe_postures:
        yield Finding(False, "there is no probe posture, so the hand cannot touch")


def _forces(hand: Hand) -> Iterator[Finding]:
    """Compare the force limit with what motors hold at the pads: |J^T f| <= effort."""
    q = np.mean(list(hand.pregrasps.values()), axis=0)
    _, axes, jacobian, _ = hand.pad_jacobians(np.eye(4), q)  # (F, 3, 6 + J)
    levers = np.abs(np.einsum("fkj,fk->fj", jacobian[:, :, 6:], axes))
    with np.errstate(divide="ignore", over="ignore"):
        held = (hand.effort_limits / levers).min(axis=1)  # (F,) [N]
    weakest = int(np.argmin(held))
    fine = hand.max_contact_force <= 2.0 * held[weakest]
    text = (
        f"motors hold {held[weakest]:.1f} N along the axis of pad {hand.pads[weakest].finger};"
        f" max_contact_force is {hand.max_contact_force:g} N"
    )
    yield Finding(fine, text if fine else f"{text}: lower it, or check the URDF's effort limits")


def _lead(hand: Hand, posture: ProbePosture) -> tuple[float, str]:
    """Return by how much the tip's sphere is ahead of any other link [m], and of which."""
    links = hand.forward_kinematics(np.eye(4), posture.joint_positions)
    tip = links[posture.link][:3, :3] @ posture.center_L + links[posture.link][:3, 3]
    front = float(tip @ posture.direction_H) + posture.radius
    others = [link for link in hand.links if link != posture.link]
    ahead = {
        link: _reach_along(hand, links, posture.direction_H, frozenset({link})) for link in others
    }
    # The tip's own finger is behind it anyhow; what counts is the rest, unless that is wrong too.
    own = {link for link in others if hand.link_fingers.get(link) == posture.finger}
    rest = {link: reach for link, reach in ahead.items() if link not in own}
    rival = max(rest, key=lambda link: rest[link]) if rest else others[0]
    worst_own = max(own, key=lambda link: ahead[link], default=rival)
    if ahead[worst_own] > front + 1e-6:
        rival = worst_own
    return front - ahead[rival], rival


def _reach_along(
    hand: Hand, links: dict[str, FloatArray], axis: FloatArray, chosen: frozenset[str]
) -> float:
    """Return how far the bodies of some links reach along an axis of H [m]."""
    reach = -np.inf
    for geometry in hand.link_geometries:
        if geometry.link in chosen:
            X_HG = links[geometry.link] @ geometry.X_LG
            points = np.asarray(geometry.mesh.vertices) @ X_HG[:3, :3].T + X_HG[:3, 3]
            reach = max(reach, float((points @ axis).max()))
    return reach


def _rigid_part(hand: Hand, pad: Pad) -> frozenset[str]:
    """Return the pad's link; where that has no body, what it is fixed to."""
    bodies = {geometry.link for geometry in hand.link_geometries}
    link = pad.link
    parents = {joint.child: joint for joint in hand.joints}
    while link not in bodies and link in parents and parents[link].kind == "fixed":
        link = parents[link].parent
    return frozenset({link})
