"""Sample force-closure grasps of a hand on a mesh: contacts, reach, collision, quality, rank."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.exceptions import InvalidMeshError, InvalidOptionError
from lis_grasp.grasping.assessment import GraspAssessor, PlacedHands
from lis_grasp.grasping.collision import HandCollisionChecker
from lis_grasp.grasping.contact_search import (
    ContactSets,
    SurfaceSamples,
    find_contact_sets,
    initial_postures,
)
from lis_grasp.grasping.grasp import Grasp, GraspSearch
from lis_grasp.grasping.hand import Hand
from lis_grasp.grasping.inverse_kinematics import PadTargets, Postures, reach
from lis_grasp.grasping.pose_filter import HandPoseFilter

FloatArray = npt.NDArray[np.float64]

_MAX_POSITION_ERROR = 0.0015  # [m] of a pad from its contact
_MAX_AXIS_ERROR = 0.02  # [rad] of a contact beyond its pad's border
# Contact sets that are worked on together.
_ROUND = 100
# Ranking gains little from more grasps than this many times those asked for.
_ENOUGH = 5
_OPENING = 0.02  # [m] that each pad backs off its contact before closing
_STANDOFF, _APPROACH_STEPS = 0.12, 8  # [m] along which the approach must be free


@dataclass(frozen=True, slots=True)
class ForceClosureSampler:
    """Finds grasps in force closure, free of collision, that the hand can reach.

    Contact sets are drawn where the surface is flat enough for a pad and supported by touches; the
    palm's pose and the joints follow by inverse kinematics; a filter and FCL judge every link at
    the grasp, at the opened posture, and along the approach; what is left is assessed and ranked by
    `GraspAssessor`.

    Parameters
    ----------
    hand
        The hand.
    friction
        Coulomb coefficient between pads and object.
    candidates
        Contact sets to draw at the most; fewer, once enough grasps hold.
    """

    hand: Hand
    friction: float = 0.8
    candidates: int = 4000

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
        poses = HandPoseFilter(self.hand, mesh)
        assessor = GraspAssessor(self.hand, mesh, friction=self.friction, rng=rng)
        grasps: list[Grasp] = []
        drawn = 0
        while drawn < self.candidates:
            size = min(_ROUND, self.candidates - drawn)
            drawn += size
            placed = self._place(samples, poses, checker, size, rejected, rng)
            found = assessor.assess(placed)
            rejected["no_force_closure"] += len(placed) - len(found)
            grasps += found
            if sum(grasp.quality["epsilon_robust"] > 0.0 for grasp in grasps) >= _ENOUGH * count:
                break
        grasps.sort(key=lambda grasp: -grasp.quality["success_probability"])
        if len(grasps) > count:
            rejected["outranked"] = len(grasps) - count
        counts = {reason: n for reason, n in sorted(rejected.items()) if n}
        return GraspSearch(tuple(grasps[:count]), counts, drawn)

    def _place(
        self,
        samples: SurfaceSamples,
        poses: HandPoseFilter,
        checker: HandCollisionChecker,
        count: int,
        rejected: Counter[str],
        rng: np.random.Generator,
    ) -> PlacedHands:
        """Return those of `count` contact sets that the hand can reach without colliding."""
        sets, misses = find_contact_sets(self.hand, samples, count=count, rng=rng)
        rejected.update(misses)
        sets, postures = self._reach(sets, rejected)
        free = ~poses.collides(postures.X_OH, postures.q, pads_may_touch=True)
        rejected["grasp_hits_object"] += int((~free).sum())
        for b in np.flatnonzero(free):
            hit = checker.first_collision(postures.X_OH[b], postures.q[b], pads_may_touch=True)
            if hit is not None:
                rejected[f"grasp_hits_{hit}"] += 1
                free[b] = False
        kept = np.flatnonzero(free)
        sets, postures = sets.subset(kept), postures.subset(kept)
        opened = self._opened(sets, postures)
        free = ~poses.collides(postures.X_OH, opened)
        rejected["approach_hits_object"] += int((~free).sum())
        for b in np.flatnonzero(free):
            hit = self._obstacle_on_the_way(checker, postures.X_OH[b], opened[b])
            if hit is not None:
                rejected[f"approach_hits_{hit}"] += 1
                free[b] = False
        kept = np.flatnonzero(free)
        return PlacedHands(sets.subset(kept), postures.subset(kept), opened[kept])

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

    def _obstacle_on_the_way(
        self, checker: HandCollisionChecker, X_OH: FloatArray, opened: FloatArray
    ) -> str | None:
        back = np.linspace(0.0, _STANDOFF, _APPROACH_STEPS)
        way = np.tile(X_OH, (len(back), 1, 1))
        way[:, :3, 3] -= back[:, None] * (X_OH[:3, :3] @ self.hand.approach_H)
        return checker.first_collision_on_the_way(way, opened)
