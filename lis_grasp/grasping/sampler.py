"""Sample force-closure grasps of a hand on a mesh: contacts, reach, collision, quality, rank."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.exceptions import InvalidMeshError, InvalidOptionError
from lis_grasp.grasping.assessment import closes, epsilon_on, weight_on
from lis_grasp.grasping.collision import HandCollisionChecker
from lis_grasp.grasping.contact_search import (
    ContactSets,
    SurfaceSamples,
    find_contact_sets,
    initial_postures,
)
from lis_grasp.grasping.grasp import Grasp, GraspSearch
from lis_grasp.grasping.grip import balanced_grip
from lis_grasp.grasping.hand import Hand
from lis_grasp.grasping.inverse_kinematics import PadTargets, Postures, reach

FloatArray = npt.NDArray[np.float64]

_MAX_POSITION_ERROR = 0.0015  # [m] of a pad from its contact
_MAX_AXIS_ERROR = 0.02  # [rad] of a contact beyond its pad's border
# Rounds of candidates, where grasps are hard to find.
_ROUNDS = 4
# Ranking gains little from more grasps than this many times those asked for.
_ENOUGH = 5
_OPENING = 0.02  # [m] that each pad backs off its contact before closing
_STANDOFF, _APPROACH_STEPS = 0.12, 8  # [m] along which the approach must be free
# Contacts are known to a few degrees only: grasps are ranked at this share of the friction.
_ROBUST_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class ForceClosureSampler:
    """Finds grasps in force closure, free of collision, that the hand can reach.

    Contact sets are drawn where the surface is flat enough for a pad and supported by touches; the
    palm's pose and the joints follow by inverse kinematics; FCL judges every link at the grasp, at
    the opened posture, and along the approach; what is left is ranked by epsilon times the weight
    that the grasp carries, both at half the friction: wrenches from anywhere, and the one that is
    sure to come.

    Parameters
    ----------
    hand
        The hand.
    friction
        Coulomb coefficient between pads and object.
    candidates
        Contact sets to draw in a round; there are more rounds until enough grasps hold at half the
        friction too, four at the most.
    """

    hand: Hand
    friction: float = 0.8
    candidates: int = 1000

    def __post_init__(self) -> None:
        if not (np.isfinite(self.friction) and self.friction > 0.0):
            raise InvalidOptionError(f"friction must be a positive number; it is {self.friction}")
        if self.candidates < 1:
            raise InvalidOptionError(f"candidates must be at least 1; it is {self.candidates}")

    def sample(
        self,
        mesh: trimesh.Trimesh,
        *,
        rng: np.random.Generator,
        support_height: float | None = None,
        count: int = 10,
    ) -> GraspSearch:
        """Return up to `count` ranked grasps, and why the other candidates were rejected.

        Parameters
        ----------
        mesh
            Closed, outward-oriented surface in O [m], true or estimated. A vertex attribute
            ``"uncertainty"`` [m] keeps contacts where touches support it.
        rng
            For every draw.
        support_height
            Height of the plane that the object stands on in O [m]; None where there is none.
        count
            Grasps to return at the most.

        Raises
        ------
        InvalidMeshError
            If the mesh is not closed.
        """
        if not mesh.is_watertight:
            raise InvalidMeshError(
                "grasps are planned on closed meshes; this one has open edges: repair it with"
                " lis_grasp.shapes.load, or mesh an estimate with extract_mesh"
            )
        rejected: Counter[str] = Counter()
        largest_pad = max(pad.radius for pad in self.hand.pads)
        lowest = -np.inf if support_height is None else support_height + largest_pad + 0.004
        samples = SurfaceSamples(mesh, lowest=lowest, rng=rng)
        if not len(samples):
            rejected["no_flat_supported_surface"] = self.candidates
            return GraspSearch((), dict(rejected), self.candidates)
        checker = HandCollisionChecker(self.hand, mesh, support_height=support_height)
        grasps: list[Grasp] = []
        drawn = 0
        for _ in range(_ROUNDS):
            drawn += self.candidates
            grasps += self._draw(mesh, samples, checker, _ENOUGH * count, rejected, rng)
            if sum(_rank(grasp) < 0.0 for grasp in grasps) >= count:
                break
        grasps.sort(key=_rank)
        if len(grasps) > count:
            rejected["outranked"] = len(grasps) - count
        counts = {reason: n for reason, n in sorted(rejected.items()) if n}
        return GraspSearch(tuple(grasps[:count]), counts, drawn)

    def _draw(
        self,
        mesh: trimesh.Trimesh,
        samples: SurfaceSamples,
        checker: HandCollisionChecker,
        enough: int,
        rejected: Counter[str],
        rng: np.random.Generator,
    ) -> list[Grasp]:
        """Return the grasps among one round of candidates, no more than enough."""
        sets, misses = find_contact_sets(self.hand, samples, count=self.candidates, rng=rng)
        rejected.update(misses)
        sets, postures = self._reach(sets, rejected)
        opened = self._opened(sets, postures)
        grasps: list[Grasp] = []
        for b in range(len(sets)):
            if len(grasps) >= enough:
                rejected["not_needed"] += len(sets) - b
                break
            reason = self._obstacle(checker, postures.X_OH[b], postures.q[b], opened[b])
            if reason is not None:
                rejected[reason] += 1
                continue
            grasp = self._assess(mesh, sets, b, postures, opened[b])
            if grasp is None:
                rejected["no_force_closure"] += 1
                continue
            grasps.append(grasp)
        return grasps

    def _reach(self, sets: ContactSets, rejected: Counter[str]) -> tuple[ContactSets, Postures]:
        """Solve the inverse kinematics from the fitting pregrasp, and drop what is not reached."""
        if not len(sets):
            none = np.zeros(0)
            return sets, Postures(
                np.zeros((0, 4, 4)), np.zeros((0, len(self.hand.lower))), none, none
            )
        X_OH, start = initial_postures(self.hand, sets)
        targets = PadTargets(sets.points, sets.normals, sets.used)
        postures = reach(self.hand, targets, X_OH, start)
        near = postures.position_error <= _MAX_POSITION_ERROR
        facing = postures.axis_error <= _MAX_AXIS_ERROR
        rejected["out_of_reach"] += int((~near).sum())
        rejected["pad_does_not_face_the_surface"] += int((near & ~facing).sum())
        kept = np.flatnonzero(near & facing)
        return sets.subset(kept), postures.subset(kept)

    def _opened(self, sets: ContactSets, postures: Postures) -> FloatArray:
        """Return joint positions (B, J) with every used pad off its contact, the palm still."""
        if not len(sets):
            return postures.q
        away = PadTargets(sets.points + _OPENING * sets.normals, sets.normals, sets.used)
        return reach(self.hand, away, postures.X_OH, postures.q, palm_fixed=True).q

    def _obstacle(
        self, checker: HandCollisionChecker, X_OH: FloatArray, q: FloatArray, opened: FloatArray
    ) -> str | None:
        at_grasp = checker.first_collision(X_OH, q, pads_may_touch=True)
        if at_grasp is not None:
            return f"grasp_hits_{at_grasp}"
        approach_O = X_OH[:3, :3] @ self.hand.approach_H
        for back in np.linspace(0.0, _STANDOFF, _APPROACH_STEPS):
            X_back = X_OH.copy()
            X_back[:3, 3] -= back * approach_O
            on_the_way = checker.first_collision(X_back, opened)
            if on_the_way is not None:
                return f"approach_hits_{on_the_way}"
        return None

    def _assess(
        self,
        mesh: trimesh.Trimesh,
        sets: ContactSets,
        b: int,
        postures: Postures,
        opened: FloatArray,
    ) -> Grasp | None:
        """Return the grasp with its quality, or None if it is not in force closure."""
        hand, used = self.hand, sets.used[b]
        points, normals = sets.points[b][used], sets.normals[b][used]
        if not closes(hand, points, normals, friction=self.friction):
            return None
        quality = {"pad_error": float(postures.position_error[b])}
        for suffix, share in (("", 1.0), ("_robust", _ROBUST_SHARE)):
            friction = share * self.friction
            quality |= {
                f"epsilon{suffix}": epsilon_on(mesh, hand, points, normals, friction=friction),
                f"weight{suffix}": weight_on(mesh, hand, points, normals, friction=friction),
            }
        forces = balanced_grip(
            points, normals, friction=self.friction, total=2.0 * hand.max_contact_force
        )
        X_OH = postures.X_OH[b]
        return Grasp(
            hand=hand.name,
            X_OH=X_OH,
            joint_names=hand.joint_names,
            joint_positions=postures.q[b],
            pregrasp_positions=opened,
            approach_O=X_OH[:3, :3] @ hand.approach_H,
            contact_points=points,
            contact_normals=normals,
            contact_fingers=tuple(f for f, on in zip(hand.fingers, used, strict=True) if on),
            contact_forces=forces,
            quality=quality,
            accepted=f"force closure at friction {self.friction:g}, reached, free of collision",
        )


def _rank(grasp: Grasp) -> float:
    """Return what grasps are sorted by, the best first.

    Epsilon alone prefers long levers between fingers, and lets an object turn under its own weight
    about the line through them.
    """
    return -grasp.quality["epsilon_robust"] * grasp.quality["weight_robust"]
