"""Checks of a hand for touching and grasping: masses, collisions, pads, postures, forces."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from types import MappingProxyType

import numpy as np
from scipy.spatial import ConvexHull

from lis_grasp.geometry import apply_pose, hull_crossing, rotate
from lis_grasp.io.yaml_files import word
from lis_grasp.robots._build_model import fitting_words
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.inertias import RULE, impossible_inertias
from lis_grasp.robots.link_bodies import points_of_bodies
from lis_grasp.robots.robot_model import Pad, ProbePosture, RobotModel
from lis_grasp.robots.schema import FEW_DIGITS
from lis_grasp.typing import FloatArray

# A pad counts as covered by its link where the link is further out by more than this [m].
_PAD_COVERED = 0.002
# Largest effort of a hand's joint: N m of one that turns, N of one that slides.
_MOST_EFFORT = {"revolute": 100.0, "continuous": 100.0, "prismatic": 2000.0}
# Farthest that a hand's joint turns [rad] or slides [m], and usual slides.
_TURN, _SLIDE, _USUAL_SLIDE = 2.0 * np.pi, 0.5, (0.005, 0.2)
# Largest distance of the palm frame from the box about the hand's bodies [m], and least cosine
# between the approach and the way from the base's bodies to the pads.
_BESIDE_PALM, _BACKWARDS = 0.2, -0.5
# Postures sampled between the joints' limits; a fixed seed, as no result depends on the draw much.
_POSTURES, _SEED = 4000, 0
_OPPOSED = np.pi / 3  # largest angle between the axes of pads that face each other [rad]
# Shares (W, 3) of three pads in the force that holds an object, in eighths.
_WEIGHTS = np.array([w for w in product(range(1, 7), repeat=3) if sum(w) == 8]) / 8.0
# Smallest useful lead of a probing tip over the rest of the hand [m].
_LEAD = 0.02


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one check."""

    fine: bool  #: whether it passed
    text: str  #: the observation, and what to change if the check failed


def hand_findings(hand: Hand) -> list[Finding]:
    """Return the findings on a hand, in the order in which to fix what failed."""
    return [finding for check in HAND_CHECKS.values() for finding in check(hand)]


def body_findings(model: RobotModel, *, also: str = "") -> Iterator[Finding]:
    """Find impossible inertias of links, and links without collision bodies.

    `also` is another remedy of the inertias, in words that follow the first.
    """
    faults = impossible_inertias(model.inertials, model.link_geometries)
    if faults:
        yield Finding(
            False,
            f"the inertia of {', '.join(faults)} is impossible: {RULE}. Add `repair: true` to the"
            f" YAML{also}",
        )
    if model.hulls_of_visuals:
        yield Finding(
            True,
            "without collision bodies, so the convex hulls of their visual meshes are used:"
            f" {', '.join(model.hulls_of_visuals)}",
        )


def _masses(hand: Hand) -> Iterator[Finding]:
    also = ", or write a corrected copy of the description with `lis-grasp doctor --repair`"
    yield from body_findings(hand, also=also)
    fine = 0.05 <= hand.mass <= 10.0
    advice = "" if fine else ": masses must be in kg, 0.05 to 10 in all"
    yield Finding(fine, f"the hand weighs {hand.mass:.2f} kg{advice}")


def _self_collisions(hand: Hand) -> Iterator[Finding]:
    checker = HandCollisionChecker(hand)
    postures = {f"pregrasp {name}": q for name, q in hand.pregrasps.items()}
    postures |= {f"probe posture {f}": p.joint_positions for f, p in hand.probe_postures.items()}
    hits = {name: checker.self_collisions(q) for name, q in postures.items()}
    pairs = sorted(set().union(*hits.values()))
    if not pairs:
        yield Finding(True, f"no links collide in {len(postures)} postures")
        return
    where = ", ".join(name for name, found in hits.items() if found)
    lines = "\n".join(exclusion_lines(pairs))
    yield Finding(
        False,
        f"links collide in {where}: change the positions or, where links may touch, paste below"
        f" self_collision_exclusions:\n{lines}",
    )


def _efforts(hand: Hand) -> Iterator[Finding]:
    kinds = {joint.index: joint.kind for joint in hand.joints if joint.is_actuated}
    absurd = [
        f"{name} {hand.effort_limits[j]:g} {'N m' if kinds[j] == 'revolute' else 'N'}"
        for j, name in enumerate(hand.joint_names)
        if not is_plausible_effort(kinds[j], float(hand.effort_limits[j]))
    ]
    if absurd:
        yield Finding(
            False,
            f"no joint of a hand has an effort limit as large as {', '.join(absurd)}: give its own"
            " under effort_limits in the YAML",
        )


def is_plausible_effort(kind: str, effort: float | None) -> bool:
    """Return whether an effort [N m or N] is plausible for a hand's joint of this kind."""
    return effort is not None and 0.0 < effort <= _MOST_EFFORT[kind]


def _joint_limits(hand: Hand) -> Iterator[Finding]:
    """Find limits that are in degrees, or in another unit of length."""
    for joint in (joint for joint in hand.joints if joint.is_actuated):
        farthest = float(max(abs(hand.lower[joint.index]), abs(hand.upper[joint.index])))
        if joint.kind == "revolute" and farthest > _TURN + FEW_DIGITS:
            yield Finding(
                False,
                f"joint {joint.name} must turn by one turn at most; its limit is {farthest:g} rad:"
                f" limits are in rad, and {farthest:g} degrees are {np.radians(farthest):.3g} rad",
            )
        elif joint.kind == "prismatic" and farthest > _SLIDE:
            yield Finding(
                False,
                f"joint {joint.name} must slide by {_SLIDE:g} m at most; its limit is {farthest:g}"
                f" m: limits are in m, and {fitting_words(farthest, *_USUAL_SLIDE)}",
            )


def _palm_frame(hand: Hand) -> Iterator[Finding]:
    """Find a palm frame far from the hand, and an approach away from the pads."""
    points, ways = [], []
    for q in hand.pregrasps.values():
        links = hand.forward_kinematics(np.eye(4), q)
        bodies = {
            link: apply_pose(links[link], points_of_bodies(hand.link_geometries, link))
            for link in hand.links
        }
        points.append(np.vstack(list(bodies.values())))
        palm = bodies[hand.base_link] if len(bodies[hand.base_link]) else points[-1]
        way = hand.pad_centers(np.eye(4), q).mean(axis=0) - palm.mean(axis=0)
        ways.append(float(way @ hand.approach_H) / max(float(np.linalg.norm(way)), 1e-9))
    low, high = np.min(np.vstack(points), axis=0), np.max(np.vstack(points), axis=0)
    away = float(np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0)))
    if away > _BESIDE_PALM:
        yield Finding(
            False,
            f"palm_frame must be within {_BESIDE_PALM:g} m of the hand's bodies; it is {away:.3g} m"
            " away: its translation is in m, in the base link's frame",
        )
    if max(ways) < _BACKWARDS:
        yield Finding(
            False,
            "approach must be from the palm towards the pads; it is the other way: turn its sign,"
            " or turn palm_frame",
        )


def _pads(hand: Hand) -> Iterator[Finding]:
    q = next(iter(hand.pregrasps.values()))
    links = hand.forward_kinematics(np.eye(4), q)
    for pad in hand.pads:
        X_HL = links[pad.link]
        axis = rotate(X_HL, pad.axis_L)
        face = float(apply_pose(X_HL, pad.center_L) @ axis) + pad.radius
        depth = 1e3 * (_extent_along(hand, links, axis, _body_link(hand, pad)) - face)  # [mm]
        if depth > 1e3 * _PAD_COVERED:
            depth = 1e3 * (_height_over(hand, links, pad, axis) - face)
        fine = -2e3 * _PAD_COVERED <= depth <= 1e3 * _PAD_COVERED
        if fine:
            place = f"on the surface of {pad.link}"
        elif depth > 0.0:
            place = (
                f"{depth:.0f} mm below its link's surface: move its center or enlarge its radius"
            )
        else:
            place = f"{-depth:.0f} mm outside of its link: grasps will stop so far from the object"
        yield Finding(fine, f"pad {pad.finger} is {place}")


def _opposition(hand: Hand) -> Iterator[Finding]:
    if hand.cup is not None:
        text = f"the cup holds {hand.cup.pull:.0f} N where it seals, less beside its middle"
        yield Finding(True, text)
        return
    if not len(_facing_gaps(hand, np.array(list(hand.pregrasps.values())))):
        yield Finding(
            False,
            "no two or three pads face each other in any pregrasp, so nothing can be held between"
            " them: open the hand with a thumb opposite to the fingers, or fingers around",
        )
        return
    low, high = 1e3 * np.array(opening_range(hand))
    apart = f"{low:.0f} to {high:.0f} mm apart"
    yield Finding(True, f"pads face each other {apart}: no other widths fit between them")


def opening_range(hand: Hand) -> tuple[float, float]:
    """Return the least and the largest gap between two pads that face each other [m].

    Over random postures between the joints' limits, and the pregrasps: bounds from within, close to
    the true values for few joints. The least gap is that of a gripper, and 0 of other hands. Both
    are 0 if no two pads ever face each other.
    """
    rng = np.random.default_rng(_SEED)
    low, high = hand.lower, hand.upper
    postures = low + (high - low) * rng.random((_POSTURES, len(low)))
    gaps = _facing_gaps(hand, np.vstack([postures, low, high, *hand.pregrasps.values()]))
    least = float(gaps.min()) if len(gaps) and hand.kind == "parallel_jaw" else 0.0
    return least, float(gaps.max(initial=0.0))


def _facing_gaps(hand: Hand, q: FloatArray) -> FloatArray:
    """Return the gaps (K,) [m] between pads that face each other, over postures (B, J).

    Two pads do whose axes are opposite up to both half angles, and at most `_OPPOSED`; three do
    between which forces balance, turned from the axes by as much: then the gap is the width of the
    ball between them.
    """
    centers, axes = hand.pad_centers(np.eye(4), q), hand.pad_axes(np.eye(4), q)  # (B, F, 3)
    between = centers[:, None] - centers[:, :, None]  # (B, F, F, 3), from the first pad
    halves, radii = np.array([(pad.half_angle, pad.radius) for pad in hand.pads]).T
    turned = np.minimum(halves[:, None] + halves, _OPPOSED)
    facing = np.einsum("bik,bjk->bij", axes, axes) < -np.cos(turned)
    facing &= np.einsum("bik,bijk->bij", axes, between) > 0.0
    gaps = np.linalg.norm(between, axis=-1) - (radii[:, None] + radii)
    found = [gaps[facing]]
    for three in map(list, combinations(range(len(radii)), 3)):
        inward = centers[:, three].mean(axis=1, keepdims=True) - centers[:, three]  # (B, 3, 3)
        around = np.all(np.sum(inward * axes[:, three], axis=-1) > 0.0, axis=1)
        left = np.linalg.norm(_WEIGHTS @ axes[:, three], axis=-1).min(axis=1)
        around &= left <= np.sin(0.5 * turned[np.ix_(three, three)].min())
        widths = np.linalg.norm(inward, axis=-1).mean(axis=1) - radii[three].mean()
        found.append(2.0 * widths[around])
    return np.maximum(np.concatenate(found), 0.0)


def _probe_postures(hand: Hand) -> Iterator[Finding]:
    for finger, posture in hand.probe_postures.items():
        lead, rival = _lead(hand, posture)
        # Another fingertip beside it may touch first.
        own = hand.link_fingers.get(rival) == finger or rival in hand.fingertip_links
        if lead < -FEW_DIGITS:
            text = (
                f"{rival} is {-1e3 * lead:.0f} mm ahead of the tip's sphere: change direction,"
                " positions or tip"
            )
        elif not own and lead < _LEAD:
            text = (
                f"the tip is only {1e3 * lead:.0f} mm ahead of {rival}, which will touch flat"
                " objects first: fold the other fingers away"
            )
        else:
            text = f"the tip is {1e3 * lead:.0f} mm ahead of {rival}"
        fine = lead >= (-FEW_DIGITS if own else _LEAD)
        yield Finding(fine, f"in probe posture {finger}, {text}")


def _forces(hand: Hand) -> Iterator[Finding]:
    """Compare the force limit with the pad forces that the motors can hold: |J^T f| <= effort."""
    if hand.cup is not None:
        return  # the wrist presses it
    held = forces_along_pads(hand)
    weakest = int(np.argmin(held))
    fine = hand.max_contact_force <= 2.0 * held[weakest]
    text = (
        f"motors hold {held[weakest]:.1f} N along the axis of pad {hand.pads[weakest].finger};"
        f" max_contact_force is {hand.max_contact_force:g} N"
    )
    yield Finding(fine, text if fine else f"{text}: lower it, or check the URDF's effort limits")


def forces_along_pads(hand: Hand) -> FloatArray:
    """Return the force along each pad's axis that the motors hold, (F,) [N].

    In the mean pregrasp: the largest f with ``|J^T f| <= effort``.
    """
    mean = np.mean(list(hand.pregrasps.values()), axis=0)
    _, axes, jacobian, _ = hand.pad_jacobians(np.eye(4), mean)  # (F, 3, 6 + J)
    levers = np.abs(np.einsum("fkj,fk->fj", jacobian[:, :, 6:], axes))
    with np.errstate(divide="ignore", over="ignore"):
        return np.asarray((hand.effort_limits / levers).min(axis=1))


def _lead(hand: Hand, posture: ProbePosture) -> tuple[float, str]:
    """Return the lead of the tip's sphere over the foremost other link [m], and that link."""
    links = hand.forward_kinematics(np.eye(4), posture.joint_positions)
    tip = apply_pose(links[posture.link], posture.center_L)
    front = float(tip @ posture.direction_H) + posture.radius
    ahead = {
        link: _extent_along(hand, links, posture.direction_H, link)
        for link in hand.links
        if link != posture.link
    }
    # Links of the tip's own finger are normally just behind it: they count only if ahead of it.
    own = {link for link in ahead if hand.link_fingers.get(link) == posture.finger}
    others = [link for link in ahead if link not in own]
    rival = max(others or ahead, key=lambda link: ahead[link])
    worst_own = max(own, key=lambda link: ahead[link], default=rival)
    if ahead[worst_own] > front + FEW_DIGITS:
        rival = worst_own
    return front - ahead[rival], rival


def _extent_along(hand: Hand, links: dict[str, FloatArray], axis: FloatArray, link: str) -> float:
    """Return the largest coordinate of a link's bodies along an axis of H [m]."""
    points = apply_pose(links[link], points_of_bodies(hand.link_geometries, link))
    return float((points @ axis).max(initial=-np.inf))


def _height_over(hand: Hand, links: dict[str, FloatArray], pad: Pad, axis: FloatArray) -> float:
    """Return the largest coordinate of a pad's link along its axis [m], but for what is behind.

    Counted are bodies that the axis crosses, and bodies mainly ahead of the pad: a foot behind the
    pad, as on an angular finger, may be further out.
    """
    link = _body_link(hand, pad)
    middle = apply_pose(links[pad.link], pad.center_L)
    bodies = [
        apply_pose(links[link] @ g.X_LG, np.asarray(g.mesh.vertices))
        for g in hand.link_geometries
        if g.link == link
    ]

    def counts(points: FloatArray) -> bool:
        enters, leaves = hull_crossing(ConvexHull(points).equations, middle, axis)
        return bool((points.mean(axis=0) - middle) @ hand.approach_H > 0.0 or enters <= leaves)

    counted = [points for points in bodies if counts(points)] or bodies
    return max((float((points @ axis).max()) for points in counted), default=-np.inf)


def _body_link(hand: Hand, pad: Pad) -> str:
    """Return the pad's link, or the nearest link with a body that it is fixed to."""
    bodies = {geometry.link for geometry in hand.link_geometries}
    link = pad.link
    parents = {joint.child: joint for joint in hand.joints}
    while link not in bodies and link in parents and parents[link].kind == "fixed":
        link = parents[link].parent
    return link


def exclusion_lines(pairs: Sequence[tuple[str, str]]) -> Iterator[str]:
    """Yield pairs of links as items of ``self_collision_exclusions``."""
    yield from (f"  - [{word(first)}, {word(second)}]" for first, second in pairs)


HAND_CHECKS: Mapping[str, Callable[[Hand], Iterator[Finding]]] = MappingProxyType(
    {
        "masses": _masses,
        "efforts": _efforts,
        "joint_limits": _joint_limits,
        "palm_frame": _palm_frame,
        "self_collisions": _self_collisions,
        "pads": _pads,
        "opposition": _opposition,
        "probe_postures": _probe_postures,
        "forces": _forces,
    }
)
"""The checks of a hand by name, in the order in which to fix what failed."""
