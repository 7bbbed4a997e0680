"""A prober of an object that moves by a script after each touch, by geometry alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import Probe, ProbeOutcome
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.probing.guarded_motion import GuardedMotion
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape
from lis_grasp.typing import FloatArray

Motion = Callable[[int, ProbeOutcome], FloatArray]
"""Returns the motion (4, 4) in E after the touch of a number, from its outcome."""


class MovingObjectProber:
    """Touches the true object at X_EO; each touch moves it."""

    def __init__(self, hand: Hand, shape: Shape, motion: Motion) -> None:
        self._guarded = GuardedMotion(hand, shape.mesh)
        self._normals = shape.mesh.face_normals
        self._motion = motion
        self._touches = 0
        self.X_EO = np.eye(4)

    def move_frame(self, X_EF: FloatArray) -> None:
        self.X_EO = np.linalg.inv(X_EF) @ self.X_EO

    def probe(self, probe: Probe, obstacles: ObstacleModel | None = None) -> ProbeOutcome:
        self._guarded.place_object(self.X_EO)
        outcome, course = self._guarded.outcome(probe, obstacles)
        if course is not None and course.touched is not None:
            R_EO, p_EO = self.X_EO[:3, :3], self.X_EO[:3, 3]
            contacts = Contacts(
                (R_EO @ course.touched.point + p_EO)[None],
                (R_EO @ self._normals[course.touched.face])[None],
                fingers=(course.touched.link,),
                times=np.array([course.until_contact]),
            )
            outcome = replace(outcome, status="touched", contacts=contacts)
            self._touches += 1
            self.X_EO = self._motion(self._touches, outcome) @ self.X_EO
        return outcome


def pushed_by(distance: float) -> Motion:
    """Return a motion by `distance` [m] against the contact's normal."""

    def motion(touch: int, outcome: ProbeOutcome) -> FloatArray:
        X = np.eye(4)
        X[:2, 3] = -distance * outcome.contacts.normals[0][:2]
        return X

    return motion


def once(touch: int, X: FloatArray) -> Motion:
    """Return a motion by a pose X (4, 4) after one touch."""
    return lambda number, outcome: X if number == touch else np.eye(4)
