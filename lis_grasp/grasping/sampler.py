"""Sampling-based planner of force-closure grasps of a hand on a mesh."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.exceptions import InvalidOptionError, require_at_least
from lis_grasp.geometry import rotate
from lis_grasp.grasping._antipodal_sampling import AT_RIMS, NARROW, USUAL, sample_contact_sets
from lis_grasp.grasping._candidate_filter import CandidateFilter, lowest_contact
from lis_grasp.grasping._candidate_ranking import CandidateRanking, ranked, ranks_of
from lis_grasp.grasping._contact_samples import SurfaceSamples
from lis_grasp.grasping._posed_contacts import contact_sets_at, require_postures
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.grasping.grasp_quality import GraspScorer
from lis_grasp.grasping.grasps import GraspSearch, LoadPrior, Reach
from lis_grasp.grasping.hand_capacity import least_pinched_height
from lis_grasp.grasping.lift_path import STRAIGHT_LIFTS, LiftPath
from lis_grasp.grasping.planned_meshes import require_closed
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray, IndexArray, Seed
from lis_grasp.underflow import underflows
from lis_grasp.world import ALONE, Body, Surroundings

_LOG = logging.getLogger(__name__)

CANDIDATES = 4000
"""Largest number of sampled contact sets."""

# Sampling ends after this many times `count` robust grasps; ranking gains little from more. Without
# so many, bends are sampled too, unless the predicted success of one is this.
_ENOUGH, _LIKELY = 3, 0.5
# Contact sets per batch; the first one expects this many for each robust grasp.
_SMALLEST_BATCH, _LARGEST_BATCH, _SETS_PER_GRASP = 50, 300, 4
# Refinement: standard deviations of the steps [m]; perturbed grasps, the best of which are tried.
_STEPS = (0.01, 0.01, 0.005, 0.005, 0.0025)
_PERTURBATIONS, _TRIED = 8, 2
# Least cosine between the normals of a contact before and after a step: no finger goes from the
# side of a low object to its top.
_SAME_SIDE = 0.5


class ForceClosureSampler:
    """Plans grasps in force closure that the hand can reach without collision.

    Parameters
    ----------
    hand
        The hand.
    prior
        What is known of the object's mass and friction; None for `load`.
    candidates
        Largest number of sampled contact sets; the same number again with bends, and as last
        resorts.
    station
        The `Station` of an arm, in whose reach grasps have to be; None for a free hand.
    surroundings
        The bodies beside the object, in O, which the hand and what it carries may not hit.
    lifts
        Lifts of which one must hit none of them.
    margin
        Least distance from them [m], such as the error of their places.
    obstacles
        The same as one mesh in O [m], which may be open; until 4.0.
    load
        Fields of a `LoadPrior`: ``friction``, ``mass``, ``friction_spread``, ``mass_spread``.

    Examples
    --------
    >>> sampler = ForceClosureSampler(Hand.load("wsg50"), friction=0.6, candidates=100)
    >>> len(sampler.sample(shapes.find("box").mesh, count=1))
    1
    """

    def __init__(
        self,
        hand: Hand,
        prior: LoadPrior | None = None,
        *,
        candidates: int = CANDIDATES,
        station: Reach | None = None,
        surroundings: Surroundings = ALONE,
        lifts: Sequence[LiftPath] = STRAIGHT_LIFTS,
        margin: float = 0.0,
        obstacles: trimesh.Trimesh | None = None,
        **load: Any,
    ) -> None:
        require_at_least(1, candidates=candidates)
        if not isinstance(prior, LoadPrior | None):
            message = "prior must be a LoadPrior: give friction= and mass= by their names"
            raise InvalidOptionError(message, option="prior", value=prior)
        if hand.cup is not None:
            raise InvalidOptionError(
                f"ForceClosureSampler needs a hand with fingers; '{hand.name}' has a suction cup:"
                " call lis_grasp.plan, which takes the sampler of the hand",
                option="hand",
                value=hand.name,
            )
        if obstacles is not None:
            obstacle = Body.of_mesh("obstacles", obstacles)
            surroundings = Surroundings((*surroundings, obstacle))
        self.surroundings, self.lifts, self.margin = surroundings, tuple(lifts), margin
        self.hand, self.candidates, self.station = hand, candidates, station
        self.prior = LoadPrior(**load) if prior is None else prior

    @underflows
    def sample(
        self,
        mesh: trimesh.Trimesh,
        *,
        rng: Seed = 0,
        support_height: float | None = None,
        count: int = 10,
    ) -> GraspSearch:
        """Return up to `count` ranked grasps, and the reasons why other candidates were rejected.

        Parameters
        ----------
        mesh
            Closed, outward-oriented surface in O [m], true or estimated. A vertex attribute
            ``"uncertainty"`` [m] keeps contacts where touches support it.
        rng
            Seed or generator of all random numbers.
        support_height
            Height in O of the plane that the object is on [m].
        count
            Grasps to return at the most.

        Raises
        ------
        InvalidMeshError
            If it is no mesh, is not closed, or its size fits no object of a hand in metres.
        """
        require_closed(mesh)
        if support_height is not None:
            height = float(mesh.bounds[1, 2]) - support_height
            low = copy(self)
            low.hand = self.hand.for_height(height)
            if low.hand is not self.hand:
                found = low.sample(mesh, rng=rng, support_height=support_height, count=count)
                if len(found):
                    flat = (replace(grasp, family="flat_faces") for grasp in found)
                    return replace(found, grasps=tuple(flat))
            if height < least_pinched_height(self.hand, self.prior.friction):
                return GraspSearch((), {"lower_than_fingertips": self.candidates}, self.candidates)
        rng = np.random.default_rng(rng)
        lowest = -np.inf if support_height is None else support_height + lowest_contact(self.hand)
        tip = min(pad.radius for pad in self.hand.pads)
        samples = SurfaceSamples(mesh, lowest=lowest, rng=rng, pad_radius=tip)
        search = _Search(self.hand, samples, self._ranking(mesh, rng, support_height), rng)
        search.draw_enough(self.candidates, count)
        first, poor = search.grasps, search.drawn >= self.candidates  # few are robust
        if first is None or len(first) < count or (poor and ranks_of(first).max() < _LIKELY):
            search.samples = SurfaceSamples(
                mesh, lowest=lowest, rng=rng, bends=True, pad_radius=tip
            )
            search.draw_enough(2 * self.candidates, count)
        for limits in (NARROW, AT_RIMS) if "rim" in self.hand.families else (NARROW,):
            search.limits = limits
            if not len(search):
                search.draw_enough(search.drawn + self.candidates // 4, count)
        search.refine(count)
        return search.result()

    @underflows
    def at(
        self,
        mesh: trimesh.Trimesh,
        poses: Any,
        joints: npt.ArrayLike | None = None,
        *,
        rng: Seed = 0,
        support_height: float | None = None,
    ) -> GraspSearch:
        """Return the ranked grasps that the hand makes in postures of another planner.

        Contacts, forces and qualities are found and checked as by `sample`; palm and joints move
        as little as the contacts need. Each pose has the best of its grasps, or none; the reasons
        are counted.

        Parameters
        ----------
        poses
            Poses of the palm frame H in O, shape (4, 4) or (N, 4, 4).
        joints
            Joint positions (J,) or (N, J) [rad or m], in contact or up to 15 mm off it, in the
            order of `Hand.joint_names`. None closes each pregrasp along the axes of its pads, as
            the jaws of a gripper do.

        Raises
        ------
        InvalidMeshError
            As `sample` does, where the other arguments are explained.
        InvalidOptionError
            If poses or joints are not finite numbers of that shape.

        Examples
        --------
        >>> sampler, mesh = ForceClosureSampler(Hand.load("wsg50")), shapes.find("box").mesh
        >>> best = sampler.sample(mesh, count=1).best
        >>> np.allclose(sampler.at(mesh, best.pose).best.pose, best.pose, atol=0.002)
        True
        """
        require_closed(mesh)
        places, postures = require_postures(self.hand, poses, joints)
        ranking = self._ranking(mesh, np.random.default_rng(rng), support_height)
        of_pose, sets = contact_sets_at(self.hand, mesh, places, postures)
        kept, grasps = ranking.scored(sets)
        best = _best_of_each(of_pose[kept], ranks_of(grasps), most=1)
        rejected = Counter(
            no_surface_for_a_finger=len(places) - len(set(of_pose)),
            outranked=len(kept) - len(best),
        )
        return ranking.search(grasps.subset(best), rejected, len(places))

    def _ranking(
        self, mesh: trimesh.Trimesh, rng: np.random.Generator, support_height: float | None
    ) -> CandidateRanking:
        """Return what rejects contact sets on a mesh, and what ranks their grasps."""
        candidate_filter = CandidateFilter(
            self.hand,
            mesh,
            support_height=support_height,
            reach=self.station,
            surroundings=self.surroundings,
            lifts=self.lifts,
            margin=self.margin,
        )
        scorer = GraspScorer(
            self.hand, mesh, prior=self.prior, rng=rng, support_height=support_height
        )
        return CandidateRanking(candidate_filter, scorer)


@dataclass(slots=True)
class _Search:
    """The grasps found so far, and counts of the rejected candidates."""

    hand: Hand
    samples: SurfaceSamples
    ranking: CandidateRanking
    rng: np.random.Generator
    grasps: GraspBatch | None = None
    rejected: Counter[str] = field(default_factory=Counter)
    drawn: int = 0
    limits: tuple[Sequence[float], float] = USUAL

    def __len__(self) -> int:
        return 0 if self.grasps is None else len(self.grasps)

    def draw_enough(self, candidates: int, count: int) -> None:
        """Sample until there are `candidates`, or enough in force closure at half the friction."""
        before = len(self)
        while self.drawn < candidates:
            robust = 0
            if self.grasps is not None:
                robust = int((self.grasps.quality["epsilon_robust"][before:] > 0.0).sum())
            missing = _ENOUGH * count - robust
            if missing <= 0:
                break
            _LOG.info("%d candidates, %d grasps so far", self.drawn, len(self))
            per_grasp = max(self.drawn / max(robust, 1), _SETS_PER_GRASP)
            batch = int(np.clip(per_grasp * missing, _SMALLEST_BATCH, _LARGEST_BATCH))
            self._draw(min(batch, candidates - self.drawn))

    def _draw(self, count: int) -> None:
        self.drawn += count
        if not len(self.samples):
            self.rejected["no_flat_supported_surface"] += count
            return
        sets, failed = sample_contact_sets(
            self.hand, self.samples, count=count, limits=self.limits, rng=self.rng
        )
        self.rejected.update(failed)
        _, scored = self.ranking.scored(sets)
        self.grasps = scored if self.grasps is None else self.grasps.joined(scored)

    def refine(self, count: int) -> None:
        """Keep the best `count` grasps, or better ones near them, if there are any."""
        if self.grasps is None:
            return
        self.rejected["outranked"] += max(len(self) - count, 0)
        best = ranked(self.grasps).subset(np.arange(min(count, len(self))))
        for distance in _STEPS if len(best) else ():
            _LOG.info("improving %d grasps by steps of %.2g mm", len(best), 1e3 * distance)
            parents, sets = perturb_grasps(
                self.hand, best, self.samples, each=_PERTURBATIONS, distance=distance, rng=self.rng
            )
            chosen = _best_of_each(parents, self.ranking.scorer.loads_per_grip(sets))
            self.drawn += len(chosen)
            kept, scored = self.ranking.scored(sets.subset(chosen), ranks_of(best)[parents[chosen]])
            self.rejected["outranked"] += len(kept)
            both = best.joined(scored)
            ranks, winners = ranks_of(both), np.arange(len(best))
            for i, parent in enumerate(parents[chosen[kept]], start=len(best)):
                if ranks[i] > ranks[winners[parent]]:
                    winners[parent] = i
            best = both.subset(winners)
        self.grasps = ranked(best)

    def result(self) -> GraspSearch:
        """Return the grasps, ranked by precise qualities, over the prior of the load."""
        return self.ranking.search(self.grasps, self.rejected, self.drawn)


def _best_of_each(parents: IndexArray, loads: FloatArray, most: int = _TRIED) -> IndexArray:
    """Return the few perturbations of each parent with the largest load above 0."""
    order = np.lexsort((-loads, parents))
    ranks = np.arange(len(order)) - np.searchsorted(parents[order], parents[order])
    return np.sort(order[(ranks < most) & (loads[order] > 0.0)])


def perturb_grasps(
    hand: Hand,
    grasps: GraspBatch,
    samples: SurfaceSamples,
    *,
    each: int,
    distance: float,
    rng: np.random.Generator,
) -> tuple[IndexArray, GraspBatch]:
    """Perturb the contacts of grasps, and project them on the surface.

    All contacts of a set move by one common random step, blended with a step of each contact by a
    random weight. Steps are drawn in the palm's frame, so that grasps turn with the object. Sets
    with a contact that finds no usable surface are left out.

    Each grasp gets `each` draws, with steps of the standard deviation `distance` [m] in each
    coordinate. Returned are, of B sets: the index (B,) of the perturbed grasp; and the sets, whose
    palms move with the middle of the contacts.
    """
    parents = np.repeat(np.arange(len(grasps)), each)
    parent = grasps.subset(parents)
    alone = rng.random((len(parents), 1, 1))
    steps = rotate(
        parent.X_OH, rng.normal(scale=distance, size=(len(parents), 1 + len(hand.pads), 3))
    )
    moved = parent.points + (1.0 - alone) * steps[:, :1] + alone * steps[:, 1:]
    on_surface, normals, usable = samples.nearest(moved, parent.normals)
    usable &= (normals * parent.normals).sum(axis=-1) > _SAME_SIDE
    used, X_OH = parent.used[..., None], parent.X_OH
    shift = ((on_surface - parent.points) * used).sum(axis=1) / used.sum(axis=1)
    X_OH[:, :3, 3] += shift
    kept = np.flatnonzero((usable | ~parent.used).all(axis=1))
    on_surface, normals = np.where(used, on_surface, 0.0), np.where(used, normals, 0.0)
    sets = GraspBatch(on_surface, normals, parent.used, X_OH, parent.q)
    return parents[kept], sets.subset(kept)
