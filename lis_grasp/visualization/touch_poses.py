"""Where the hand was at each touch, worked out again from the log of an exploration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import Exploration, ProbeOutcome, TactileSensor, Workspace
from lis_grasp.exploration.known_shape import KnownShape
from lis_grasp.hands.hand import Hand
from lis_grasp.probing.guarded_motion import Course, GuardedMotion
from lis_grasp.surfaces import ImplicitSurface, carved
from lis_grasp.typing import FloatArray

# A pad sinks in by a fraction of a millimetre, and contact is a patch, of which the log has the
# middle: a hand that stops further than this from what was felt is not where it was then [m].
_AGREES = 2e-3


@dataclass(frozen=True, slots=True, eq=False)
class TouchPose:
    """A hand that touches.

    Parameters
    ----------
    X_OH
        Shape (4, 4), pose of the palm in O.
    joint_positions
        Shape (J,), in the order of the hand's joints.
    direction
        Shape (3,), unit, in O: the way it came.
    """

    X_OH: FloatArray
    joint_positions: FloatArray
    direction: FloatArray


def replay_touches(
    outcomes: Sequence[ProbeOutcome],
    contacts: int,
    *,
    mesh: trimesh.Trimesh,
    hand: Hand,
    space: Workspace,
    estimate: Callable[[Contacts], ImplicitSurface],
    position_noise: float = 0.0,
) -> list[TouchPose | None]:
    """Return where the hand was when each contact was felt, None where that is not known.

    A hand's way to a probe follows from the probe and from what was known by then, so the guarded
    motion is repeated for each probe of the log, by geometry alone. A motion that does not end at
    what the log says was felt is left out.

    Parameters
    ----------
    outcomes
        Every probe and what came of it, in order.
    contacts
        How many contacts the exploration kept.
    mesh
        The true object in O [m], watertight.
    hand, space, estimate
        As in the exploration.
    position_noise
        Of the sensor: one standard deviation along each axis [m].
    """
    motion = GuardedMotion(hand, mesh, None)
    felt, estimated = Contacts.empty(), None
    margin = TactileSensor(position_noise=position_noise).free_margin
    poses: list[TouchPose | None] = []
    for number, outcome in enumerate(outcomes, start=1):
        if len(felt) >= contacts:
            break
        after = Exploration.replay(outcomes[:number], touches=contacts).contacts
        if len(after) > len(felt):
            surface = None if estimated is None else carved(estimated, felt, margin=margin)
            course = motion.run(outcome.probe, KnownShape(space, felt, surface))
            reach = _AGREES + 4.0 * position_noise
            pose = _pose_at_end(course, outcome.contacts.points, reach)
            poses += [pose] * (len(after) - len(felt))
            estimated = estimate(after)
        felt = after
    return poses


def _pose_at_end(course: Course | str, points: FloatArray, reach: float) -> TouchPose | None:
    if isinstance(course, str) or course.met is None:
        return None
    if np.linalg.norm(points - course.met.point, axis=1).min() > reach:
        return None
    X_OH = course.X_OH.copy()
    X_OH[:3, 3] += course.travelled * course.direction
    return TouchPose(X_OH, course.approach.posture.joint_positions, course.direction)
