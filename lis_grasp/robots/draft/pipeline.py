"""Draft of a hand from its URDF, SDF or MJCF: fingers, pads, palm frame, postures, exclusions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import yourdfpy

from lis_grasp.exceptions import InvalidHandError, listed
from lis_grasp.geometry import unit
from lis_grasp.records import fields_of, read_only
from lis_grasp.robots._build_model import build_model, link_inertial
from lis_grasp.robots._description import DescriptionEdits, apply_edits, parse_description
from lis_grasp.robots._urdf import naming
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.draft._flat_pads import face_areas
from lis_grasp.robots.draft._pads import fit_pads
from lis_grasp.robots.draft._palm_frame import find_palm_frame
from lis_grasp.robots.draft._pregrasps import MOST_TURNED, Opening, find_pregrasps
from lis_grasp.robots.draft._probe_postures import find_probe_postures
from lis_grasp.robots.draft._structure import (
    DraftFinger,
    find_exclusions,
    find_fingers,
    find_hand_bases,
    shared_joints,
)
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import forces_along_pads, is_plausible_effort
from lis_grasp.robots.robot_model import RobotModel, rigid_groups

# Largest number of joints before all fingers that are locked, as in a wrist; more are an arm, which
# is left out.
_WRIST = 2
_PREGRASPS = ("wide", "medium", "narrow", "tight")
_OTHER_TILTS = ((0.25,), (0.0,))  # of pads that are tried next [rad]
_TURNED = 0.95  # error of a pad's axis that is accepted at last (chord)
_HIDDEN = 2.0  # ratio of faces, parts to hulls, above which parts replace a gripper's hulls
_ASIDE = 0.5  # sideways part of the approach of a hand with a fixed jaw
# Efforts that many hands' joints have [N m or N].
_USUAL_EFFORT = {"revolute": 1.0, "continuous": 1.0, "prismatic": 40.0}
_USED = 0.9  # fraction of an effort that a finger's force may need
# Largest force of one finger [N]: files often give more than a robot uses.
_MOST_FORCE = {"multi_finger": 10.0, "parallel_jaw": 40.0}


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
    xacro_args: Mapping[str, str] = MappingProxyType({}),
    rng: np.random.Generator,
) -> HandDraft:
    """Return the draft of a hand.

    Parameters
    ----------
    path
        URDF, SDF or MJCF of the hand, or of a robot with it.
    name
        Name of the hand.
    base_link
        The root of the hand, if the file has more; by default an arm before all fingers is left
        out, and a wrist is locked.
    tips
        Links of the fingertips; by default the leaves of the tree of links.
    xacro_args
        Arguments of a xacro file, by name; the YAML keeps them.
    rng
        For the samples of postures.

    Raises
    ------
    InvalidFileError, InvalidHandError
        If the description cannot be read, has no fingers, or no posture with opposed pads exists.
    """
    with naming(path):
        described = _Described(path, tips, base_link, xacro_args)
        described.leave_out_robot(base_link)
        described.lock_wrist()
        described.split_concave_fingers()
        described.note_repairs()
        hand, openings = _with_openings(described.model, name, described.fingers, rng)
        if not openings:
            raise InvalidHandError(
                f"no posture was found in which the pads of {', '.join(hand.fingers)} face"
                " each other: name the fingertips' links by `tips`, or write the pads by hand"
            )
        described.note_exclusions(hand)
        hand = _with_palm(hand, openings)
        edits = described.edits
        if hand.kind == "parallel_jaw":
            hand, edits = _strong_enough(hand, edits)
        postures = find_probe_postures(hand, HandCollisionChecker(hand), rng=rng)
        hand = replace(hand, probe_postures=MappingProxyType(postures))
        silent = [finger for finger in hand.fingers if finger not in hand.probe_postures]
        if silent:
            described.notes.append(f"no probe posture was found for {', '.join(silent)}")
        held = _USED * float(forces_along_pads(hand).min())  # by the motors
        force = float(f"{min(held, _MOST_FORCE[hand.kind]):.2g}")
        return HandDraft(replace(hand, max_contact_force=force), edits, tuple(described.notes))


class _Described:
    """A hand's description on the way to a draft: edits, the model and fingers by them, notes."""

    def __init__(
        self,
        path: Path,
        tips: Sequence[str],
        base_link: str | None,
        xacro_args: Mapping[str, str],
    ) -> None:
        self._path, self._tips, self._robot = path, tips, parse_description(path, xacro_args)
        self.notes = list(getattr(self._robot, "notes", ()))  # of an MJCF
        self.edits = DescriptionEdits(base_link, repair=True, xacro_args=xacro_args)
        self._set_missing_efforts()
        self.model = self._built(self.edits)

    @cached_property
    def fingers(self) -> tuple[DraftFinger, ...]:
        return find_fingers(self.model, self._tips)

    def leave_out_robot(self, base_link: str | None) -> None:
        """Leave out all of a robot but its one hand, if the base is not given."""
        bases = find_hand_bases(self.model) if base_link is None and not self._tips else ()
        if len(bases) > 1:
            raise InvalidHandError(
                "a description must have one hand; this robot's hands may begin"
                f" at {', '.join(bases)}: name one by `base`"
            )
        if bases:
            self.notes.append(
                f"the hand begins at {bases[0]}; all else of the robot is left out, by base_link"
            )
            self._edit(base_link=bases[0])

    def lock_wrist(self) -> None:
        """Lock the joints before all fingers, or leave them out if they are an arm's."""
        wrist = shared_joints(self.model, self.fingers)
        if len(wrist) > _WRIST:
            self.notes.append(f"{len(wrist)} joints before the fingers are left out, by base_link")
            self._edit(base_link=rigid_groups(self.model)[wrist[-1].child])
        elif wrist:
            zero = np.clip(0.0, self.model.lower, self.model.upper)
            positions = {j.name: float(zero[j.index]) for j in wrist if j.is_actuated}
            self.notes.append(f"joints of the wrist are locked: {', '.join(positions)}")
            self._edit(locked_joints=MappingProxyType(positions))

    def split_concave_fingers(self) -> None:
        """Let the tips of a gripper collide as convex parts, if their hulls hide its flat faces.

        An angular finger has its face behind the hull over its foot and its tip.
        """
        if len(self.fingers) != 2:
            return
        tips = {body.link for finger in self.fingers for body in finger.bodies}
        links = tuple(link for link in self.model.links if link in tips)
        parts = self._built(replace(self.edits, convex_parts=links))
        if any(not finger.motors for finger in self.fingers):  # one body with the palm
            self.notes.append(
                f"{self.fingers[0].link} closes on a fixed jaw, {self.fingers[1].link}"
            )
            self._edit(convex_parts=links)
            return
        hidden = _HIDDEN * face_areas(self.model, self.fingers)
        if (face_areas(parts, find_fingers(parts, self._tips)) > hidden).all():
            self.notes.append(
                "the fingers are concave and collide as several bodies, by convex_parts"
            )
            self._edit(convex_parts=links)

    def note_repairs(self) -> None:
        """Keep `repair` if the inertias of file and model differ."""
        read = {link.name: link_inertial(link).inertia_L for link in self._edited().links}
        given = self.model.inertials
        links = [k for k in self.model.links if not np.array_equal(read[k], given[k].inertia_L)]
        self.edits = replace(self.edits, repair=bool(links))
        if links:
            self.notes.append(
                f"impossible inertias or missing masses of {listed(links)} are replaced, by repair"
            )

    def note_exclusions(self, hand: Hand) -> None:
        by_design = hand.self_collision_exclusions - self.model.joined_links
        if by_design:
            named = listed(["-".join(pair) for pair in sorted(by_design)])
            self.notes.append(
                "collisions of these links with each other are ignored, by"
                f" self_collision_exclusions, as they occur in many postures: {named}"
            )

    def _set_missing_efforts(self) -> None:
        efforts = {}
        for joint in self._edited().joints:
            if joint.type in _USUAL_EFFORT and joint.mimic is None:
                effort = None if joint.limit is None else joint.limit.effort
                if not is_plausible_effort(joint.type, effort):
                    efforts[joint.name] = _USUAL_EFFORT[joint.type]
        if efforts:
            self.notes.append(
                f"efforts are missing or absurd, so usual ones are set: {', '.join(efforts)}"
            )
        self.edits = replace(self.edits, effort_limits=MappingProxyType(efforts))

    def _edit(self, **edits: Any) -> None:
        """Change the edits; leave out efforts of joints that are then locked or cut off."""
        self.edits = replace(self.edits, **edits)
        moving = {joint.name for joint in self._edited().joints if joint.type != "fixed"}
        efforts = {name: e for name, e in self.edits.effort_limits.items() if name in moving}
        self.edits = replace(self.edits, effort_limits=MappingProxyType(efforts))
        self.model = self._built(self.edits)
        self.__dict__.pop("fingers", None)

    def _edited(self) -> yourdfpy.Robot:
        return apply_edits(deepcopy(self._robot), self.edits)

    def _built(self, edits: DescriptionEdits) -> RobotModel:
        return build_model(deepcopy(self._robot), self._path, edits)


def _with_openings(
    model: RobotModel, name: str, fingers: Sequence[DraftFinger], rng: np.random.Generator
) -> tuple[Hand, list[Opening]]:
    """Return a hand with pads, and its openings, the widest first.

    If pads cannot face each other where they fit the fingertips best, others are tried, and at last
    pads that are turned by more: a hand with one motor cannot turn them as it closes.
    """
    hand = _without_postures(model, name, fit_pads(model, fingers))
    checker = HandCollisionChecker(hand)
    exclusions = hand.self_collision_exclusions | find_exclusions(hand, checker, rng=rng)
    hand = replace(hand, self_collision_exclusions=exclusions)
    checker = HandCollisionChecker(hand)
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


def _with_palm(hand: Hand, openings: Sequence[Opening]) -> Hand:
    """Return the hand with its palm frame and at most four pregrasps."""
    count = min(len(openings), len(_PREGRASPS))  # evenly spread from the widest to the narrowest
    rows = np.unique(np.linspace(0, len(openings) - 1, count).round().astype(int))
    chosen = [openings[row] for row in rows]
    pregrasps = {label: read_only(o.q) for label, o in zip(_PREGRASPS, chosen, strict=False)}
    X_LH = read_only(find_palm_frame(hand, chosen[len(chosen) // 2]))
    hand = replace(hand, X_LH=X_LH, pregrasps=MappingProxyType(pregrasps))
    aside = np.zeros(3)
    for pad, axis in zip(hand.pads, hand.pad_axes(np.eye(4), chosen[0].q), strict=True):
        if pad.finger in hand.fixed_fingers:  # its pad comes onto the object at the end only
            aside = _ASIDE * unit(axis * [1.0, 1.0, 0.0])
    return replace(hand, approach_H=read_only(unit(hand.approach_H + aside)))


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
        self_collision_exclusions=model.joined_links,
        max_contact_force=1.0,
    )
