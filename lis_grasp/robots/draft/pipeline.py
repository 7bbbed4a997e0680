"""Draft of a hand from its URDF or SDF: fingers, pads, palm frame, postures, exclusions."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import yourdfpy

from lis_grasp.exceptions import InvalidHandError
from lis_grasp.records import fields_of, read_only
from lis_grasp.robots._build_model import build_model, link_inertial
from lis_grasp.robots._description import DescriptionEdits, apply_edits, parse_description
from lis_grasp.robots.collision import checker_of
from lis_grasp.robots.draft._flat_pads import face_areas
from lis_grasp.robots.draft._pads import fit_pads
from lis_grasp.robots.draft._pregrasps import MOST_TURNED, Opening, find_palm_frame, find_pregrasps
from lis_grasp.robots.draft._probe_postures import find_probe_postures
from lis_grasp.robots.draft._structure import (
    Finger,
    find_exclusions,
    find_fingers,
    find_hand_bases,
    rigid_groups,
    shared_joints,
)
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import forces_along_pads, is_plausible_effort
from lis_grasp.robots.robot_model import RobotModel

# Joints before all fingers that are locked, as of a wrist; more are an arm, which is left out.
_WRIST = 2
_PREGRASPS = ("wide", "medium", "narrow", "tight")
_OTHER_TILTS = ((0.25,), (0.0,))  # of pads that are tried next [rad]
_TURNED = 0.95  # error of a pad's axis that is accepted at last (chord)
# Parts replace a gripper's hulls if their faces are so many times the hulls', and this [m^2].
_HIDDEN, _LEAST_FACE = 2.0, 3e-5
_LISTED = 4  # links, or pairs of them, in a note
# Of many hands' joints [N m or N].
_USUAL_EFFORT = {"revolute": 1.0, "continuous": 1.0, "prismatic": 40.0}
_USED = 0.9  # fraction of an effort that a finger's force may need
# Of one finger [N]: files often give more than a robot uses.
_LEAST_FORCE, _MOST_FORCE = 1.0, {"multi_finger": 10.0, "parallel_jaw": 40.0}


@dataclass(frozen=True, slots=True, eq=False)
class HandDraft:
    """A drafted hand, and what its YAML says besides."""

    hand: Hand
    edits: DescriptionEdits
    notes: tuple[str, ...]  # what was decided, and what is missing


def draft_hand(
    path: Path,
    *,
    name: str,
    base_link: str | None = None,
    tips: Sequence[str] = (),
    rng: np.random.Generator,
) -> HandDraft:
    """Return the draft of a hand.

    Parameters
    ----------
    path
        URDF or SDF of the hand, or of a robot with it.
    name
        Of the hand.
    base_link
        The root of the hand, if the file has more; by default an arm before all fingers is left
        out, and a wrist is locked.
    tips
        Links of the fingertips; by default the leaves of the tree of links.
    rng
        For the samples of postures.

    Raises
    ------
    InvalidFileError, InvalidHandError
        If the description cannot be read, has no fingers, or no posture with opposed pads exists.
    """
    notes: list[str] = []
    robot = parse_description(path)
    edits = _edits(deepcopy(robot), base_link, notes)
    model = build_model(deepcopy(robot), path, edits)
    if base_link is None and not tips:
        edits = _without_robot(model, edits, path.name, notes)
        if edits.base_link is not None:
            edits = _pruned(edits, apply_edits(deepcopy(robot), edits))
            model = build_model(deepcopy(robot), path, edits)
    fingers = find_fingers(model, tips)
    wrist = shared_joints(model, fingers)
    if wrist:
        if len(wrist) > _WRIST:
            edits = replace(edits, base_link=rigid_groups(model)[wrist[-1].child])
            notes.append(f"{len(wrist)} joints before the fingers are left out, by base_link")
        else:
            positions = {
                j.name: float(np.clip(0.0, model.lower[j.index], model.upper[j.index]))
                for j in wrist
                if j.is_actuated
            }
            edits = replace(edits, locked_joints=MappingProxyType(positions))
            notes.append(f"joints of the wrist are locked: {', '.join(positions)}")
        edits = _pruned(edits, apply_edits(deepcopy(robot), edits))
        model = build_model(deepcopy(robot), path, edits)
        fingers = find_fingers(model, tips)
    if len(fingers) == 2:
        split = _split_fingers(model, fingers, edits)
        parts = build_model(deepcopy(robot), path, split)
        fingers_of_parts = find_fingers(parts, tips)
        if _hulls_hide_faces(model, fingers, parts, fingers_of_parts):
            edits, model, fingers = split, parts, fingers_of_parts
            notes.append("the fingers are concave and collide as several bodies, by convex_parts")
    repaired = _repaired_links(robot, model, edits)
    edits = replace(edits, repair=bool(repaired))
    if repaired:
        links = _listed(repaired)
        notes.append(f"impossible inertias or missing masses of {links} are replaced, by repair")
    hand, openings = _with_openings(model, name, fingers, rng)
    if not openings:
        raise InvalidHandError(
            f"{path.name}: no posture was found in which the pads of {', '.join(hand.fingers)} face"
            " each other: name the fingertips' links with --tips, or write the pads by hand"
        )
    by_design = hand.self_collision_exclusions - _joined_pairs(model)
    if by_design:
        listed = _listed(["-".join(pair) for pair in sorted(by_design)])
        notes.append(
            "collisions of these links with each other are ignored, by self_collision_exclusions,"
            f" as they occur in many postures: {listed}"
        )
    chosen = _chosen(openings)
    middle = chosen[len(chosen) // 2]
    hand = replace(
        hand,
        X_LH=read_only(find_palm_frame(hand, middle)),
        pregrasps=MappingProxyType(
            {label: read_only(o.q) for label, o in zip(_PREGRASPS, chosen, strict=False)}
        ),
    )
    if hand.kind == "parallel_jaw":
        hand, edits = _strong_enough(hand, edits)
    postures = find_probe_postures(hand, checker_of(hand), rng=rng)
    silent = [finger for finger in hand.fingers if finger not in postures]
    if silent:
        notes.append(f"no probe posture was found for {', '.join(silent)}")
    held = _USED * float(forces_along_pads(hand).min())
    force = float(np.clip(held, _LEAST_FORCE, _MOST_FORCE[hand.kind]))
    hand = replace(
        hand,
        probe_postures=MappingProxyType(postures),
        max_contact_force=float(f"{force:.2g}"),
    )
    return HandDraft(hand, edits, tuple(notes))


def _with_openings(
    model: RobotModel, name: str, fingers: Sequence[Finger], rng: np.random.Generator
) -> tuple[Hand, list[Opening]]:
    """Return a hand with pads, and its openings, the widest first.

    If pads cannot face each other where they fit the fingertips best, others are tried, and at last
    pads that are turned by more: a hand with one motor cannot turn them as it closes.
    """
    hand = _without_postures(model, name, fit_pads(model, fingers))
    checker = checker_of(hand)
    exclusions = hand.self_collision_exclusions | find_exclusions(hand, checker, rng=rng)
    hand = replace(hand, self_collision_exclusions=exclusions)
    checker = checker_of(hand)
    openings = find_pregrasps(hand, checker, rng=rng)
    if openings or hand.kind == "parallel_jaw":
        return hand, openings
    for most_turned in (MOST_TURNED, _TURNED):
        for tilts in _OTHER_TILTS:
            hand = replace(hand, pads=fit_pads(model, fingers, tilts))
            openings = find_pregrasps(hand, checker, most_turned=most_turned, rng=rng)
            if openings:
                return hand, openings
    return hand, []


def _split_fingers(
    model: RobotModel, fingers: Sequence[Finger], edits: DescriptionEdits
) -> DescriptionEdits:
    """Return edits by which the fingers' tips collide as several convex parts."""
    links = {body.link for finger in fingers for body in finger.bodies}
    return replace(edits, convex_parts=tuple(link for link in model.links if link in links))


def _hulls_hide_faces(
    model: RobotModel, fingers: Sequence[Finger], parts: RobotModel, of_parts: Sequence[Finger]
) -> bool:
    """Return whether the flat faces of a gripper are inside the hulls of its fingers.

    An angular finger has its face behind the hull over its foot and its tip.
    """
    hidden = np.maximum(_HIDDEN * face_areas(model, fingers), _LEAST_FACE)
    return bool((face_areas(parts, of_parts) > hidden).all())


def _edits(robot: yourdfpy.Robot, base_link: str | None, notes: list[str]) -> DescriptionEdits:
    """Return edits that let a file be read: a base, and usual efforts for missing ones."""
    edits = DescriptionEdits(base_link=base_link, repair=True)
    robot = apply_edits(robot, edits)
    efforts = {}
    for joint in robot.joints:
        if joint.type in ("revolute", "continuous", "prismatic") and joint.mimic is None:
            effort = None if joint.limit is None else joint.limit.effort
            if not is_plausible_effort(joint.type, effort):
                efforts[joint.name] = _USUAL_EFFORT[joint.type]
    if efforts:
        notes.append(f"efforts are missing or absurd, so usual ones are set: {', '.join(efforts)}")
    return replace(edits, effort_limits=MappingProxyType(efforts))


def _without_robot(
    model: RobotModel, edits: DescriptionEdits, file: str, notes: list[str]
) -> DescriptionEdits:
    """Return edits that leave out all of a robot but its hand; edits of a hand stay as they are."""
    bases = find_hand_bases(model)
    if len(bases) > 1:
        raise InvalidHandError(
            f"{file}: a description must have one hand; this robot's hands may begin at"
            f" {', '.join(bases)}: name one with --base"
        )
    if not bases:
        return edits
    notes.append(f"the hand begins at {bases[0]}; all else of the robot is left out, by base_link")
    return replace(edits, base_link=bases[0])


def _strong_enough(hand: Hand, edits: DescriptionEdits) -> tuple[Hand, DescriptionEdits]:
    """Set the usual efforts of a gripper so that both fingers push with the usual force at once."""
    q = np.array(list(hand.pregrasps.values()))
    _, axes, jacobian, _ = hand.pad_jacobians(np.eye(4), q)  # (G, F, 3, 6 + J)
    levers = np.abs(np.einsum("gfkj,gfk->gfj", jacobian[..., 6:], axes)).sum(axis=1).max(axis=0)
    efforts, limits = dict(edits.effort_limits), hand.effort_limits.copy()
    for j, name in enumerate(hand.joint_names):
        if name in efforts:
            needed = float(f"{_MOST_FORCE[hand.kind] * levers[j] / _USED:.2g}")
            limits[j] = efforts[name] = max(efforts[name], needed)
    edits = replace(edits, effort_limits=MappingProxyType(efforts))
    return replace(hand, effort_limits=read_only(limits)), edits


def _pruned(edits: DescriptionEdits, robot: yourdfpy.Robot) -> DescriptionEdits:
    """Leave out efforts of joints that are locked or cut off."""
    moving = {joint.name for joint in robot.joints if joint.type != "fixed"}
    efforts = {name: effort for name, effort in edits.effort_limits.items() if name in moving}
    return replace(edits, effort_limits=MappingProxyType(efforts))


def _repaired_links(robot: yourdfpy.Robot, model: RobotModel, edits: DescriptionEdits) -> list[str]:
    """Return the links of a repaired model whose inertia is not that of the file."""
    own = {link.name: link_inertial(link) for link in apply_edits(deepcopy(robot), edits).links}
    return [
        name
        for name in model.links
        if not np.array_equal(own[name].inertia_L, model.inertials[name].inertia_L)
    ]


def _listed(names: Sequence[str]) -> str:
    rest = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + rest


def _joined_pairs(model: RobotModel) -> frozenset[tuple[str, str]]:
    """Return the pairs of links that a joint joins."""
    return frozenset((min(j.parent, j.child), max(j.parent, j.child)) for j in model.joints)


def _without_postures(model: RobotModel, name: str, pads: tuple) -> Hand:
    middle = read_only(0.5 * (model.lower + model.upper))
    return Hand(
        **fields_of(model),
        name=name,
        kind="parallel_jaw" if len(pads) == 2 else "multi_finger",
        pads=pads,
        X_LH=read_only(np.eye(4)),
        approach_H=read_only(np.array([0.0, 0.0, 1.0])),
        pregrasps=MappingProxyType({"middle": middle}),
        probe_postures=MappingProxyType({}),
        self_collision_exclusions=_joined_pairs(model),
        max_contact_force=1.0,
    )


def _chosen(openings: Sequence[Opening]) -> list[Opening]:
    """Return at most four openings, evenly spread from the widest to the narrowest."""
    count = min(len(openings), len(_PREGRASPS))
    rows = np.unique(np.linspace(0, len(openings) - 1, count).round().astype(int))
    return [openings[row] for row in rows]
