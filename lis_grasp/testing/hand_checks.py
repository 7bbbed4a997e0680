"""Checks of a hand: what the command `doctor` checks, its kinematics, touches and grasps."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.probe import Probe
from lis_grasp.exploration.workspace import ObstacleModel, Workspace
from lis_grasp.grasping.samplers import sampler_of
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import HAND_CHECKS, opening_range
from lis_grasp.testing.check import Check, Claim, Claims, HeldClaims, plugin_name, require_all

CLAIMS = Claims()

_BLOCK = 0.08  # longest side of the block that is touched and grasped [m]
_SLENDER = 0.6  # its other sides, in that which the pads can hold, or in its longest
_STEP, _SLOPE = 1e-6, 1e-6  # of finite differences [rad or m], and their error [m]
_CANDIDATES = 100
_SIDE, _, _UP = np.eye(3)


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class HandSubject:
    """A hand that is loaded at the first use."""

    made_by: Any

    @cached_property
    def hand(self) -> Hand:
        """The hand."""
        return self.made_by if isinstance(self.made_by, Hand) else Hand.load(self.made_by)

    @cached_property
    def block(self) -> trimesh.Trimesh:
        """A block upright on a table at height 0, which fits between pads that face each other."""
        opening = opening_range(self.hand)[1] or _BLOCK  # a suction cup has none
        width = _SLENDER * min(opening, _BLOCK)
        mesh = trimesh.creation.box((width, width, _BLOCK))
        mesh.apply_translation((0.0, 0.0, 0.5 * _BLOCK))
        return mesh


@CLAIMS.add("be loaded", "see docs/adding-a-hand.md for the keys of the file")
def _loads(of: HandSubject) -> str:
    return "" if isinstance(of.hand, Hand) else "it is no hand"


@CLAIMS.add("have pads that move as their Jacobians say", "check the axes and mimics of the joints")
def _jacobians(of: HandSubject) -> str:
    hand = of.hand
    q = np.mean(list(hand.pregrasps.values()), axis=0)
    centers, _, jacobian, _ = hand.pad_jacobians(np.eye(4), q)  # (F, 3), (F, 3, 6 + J)
    steps = _STEP * np.eye(len(q))
    slopes = (hand.pad_centers(np.eye(4), q + steps) - hand.pad_centers(np.eye(4), q - steps)) / (
        2.0 * _STEP
    )  # (J, F, 3)
    error = float(np.abs(np.moveaxis(slopes, 0, -1) - jacobian[:, :, 6:]).max())
    return f"they differ by {error:.2g} m" if error > _SLOPE * max(1.0, np.ptp(centers)) else ""


@CLAIMS.add("be sent to other processes", "give the YAML's own values, no objects of Python")
def _pickles(of: HandSubject) -> str:
    again: Hand = pickle.loads(pickle.dumps(of.hand))  # noqa: S301 - our own bytes
    q = next(iter(of.hand.pregrasps.values()))
    same = np.array_equal(again.pad_centers(np.eye(4), q), of.hand.pad_centers(np.eye(4), q))
    return "" if same else "the copy has pads elsewhere"


@CLAIMS.add(
    "touch an upright block from above and from a side",
    "fold the other fingers away in the probe postures",
)
def _touches(of: HandSubject) -> str:
    prober, mesh = KinematicProber(of.hand, of.block), of.block
    center, size = mesh.bounds.mean(axis=0), float(mesh.extents.max())
    space = Workspace(0.25 * size, center, size, support_height=0.0)
    obstacles = ObstacleModel(space, Contacts.empty(), None)
    for name, way in (("above", -_UP), ("a side", -_SIDE)):
        outcome = prober.probe(Probe(center, way, standoff=size, overshoot=0.0), obstacles)
        if outcome.status != "touched":
            return f"from {name} the probe {outcome.status} {outcome.reason}".rstrip()
    return ""


@CLAIMS.add(
    "find a grasp of a block that fits between its pads",
    "open the pregrasps wider than the block, and let pads face each other",
)
def _grasps(of: HandSubject) -> str:
    sampler = sampler_of(of.hand, candidates=_CANDIDATES)
    search = sampler.sample(of.block, rng=np.random.default_rng(0), support_height=0.0, count=1)
    width = 1e3 * float(of.block.extents[0])
    return "" if search.grasps else f"of {width:.0f} mm, none of {search.candidates} was possible"


def _finding(name: str) -> Claim:
    """Return a check of the command `doctor` as a claim."""

    def breach(of: HandSubject) -> str:
        return next((f.text for f in HAND_CHECKS[name](of.hand) if not f.fine), "")

    required = f"pass the check of its {name.replace('_', ' ')}"
    return Claim(name, required, "lis-grasp doctor --hand lists all findings", breach)


def hand_checks(hand: str | Path | Hand) -> tuple[Check, ...]:
    """Return the checks of a hand, to be carried out one by one, as by pytest.

    Parameters
    ----------
    hand
        A name, the path of a YAML file, or a hand.

    Examples
    --------
    >>> [str(check) for check in hand_checks("wsg50")][:3]
    ['loads', 'masses', 'efforts']
    """
    subject = HandSubject(hand)
    name = plugin_name(hand.name if isinstance(hand, Hand) else str(hand))
    first, *others = CLAIMS.of(subject, name)
    doctor = (Check(_finding(check), subject, name) for check in HAND_CHECKS)
    return (first, *doctor, *others)


def check_hand(hand: str | Path | Hand) -> HeldClaims:
    """Make and return all checks of a hand; seconds.

    Parameters
    ----------
    hand
        As in `hand_checks`.

    Raises
    ------
    FailedCheckError
        If it fails some, with a sentence on each in `failures`.

    Examples
    --------
    >>> check_hand("wsg50")
    14 of 14 claims hold
    """
    return require_all(hand_checks(hand))
