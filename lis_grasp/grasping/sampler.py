"""Sampling-based planner of force-closure grasps of a hand on a mesh."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.special import ndtr

from lis_grasp.exceptions import InvalidMeshError, require_at_least
from lis_grasp.geometry import rotate
from lis_grasp.grasping.antipodal_sampling import (
    NARROW_SPREADS,
    SPREADS,
    initial_postures,
    sample_contact_sets,
)
from lis_grasp.grasping.candidate_filter import CandidateFilter
from lis_grasp.grasping.contact_samples import SurfaceSamples
from lis_grasp.grasping.contact_sets import ContactSets, contacts_of
from lis_grasp.grasping.grasp_ranking import GraspScorer
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.grasping.load_prior import LoadPrior
from lis_grasp.grasping.reach import Reach
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray, IndexArray

_LOG = logging.getLogger(__name__)

# Sampling ends after this many times `count` robust grasps; ranking gains little from more.
_ENOUGH = 3
# Contact sets per batch; the first one expects this many for each robust grasp.
_SMALLEST_BATCH, _LARGEST_BATCH, _SETS_PER_GRASP = 50, 300, 4
# Bends are sampled too where no grasp is as likely to succeed as this.
_LIKELY = 0.5
# Least height of a pad above the support [m].
_LOWEST_PAD = 0.0006
# Standard deviation of the distance between a link and the surface where both are planned [m].
_LINK_ERROR = 0.002
# Refinement: standard deviations of the steps [m]; perturbed grasps, of which the best are tried.
_STEPS = (0.01, 0.01, 0.005, 0.005, 0.0025)
_PERTURBATIONS, _TRIED = 8, 2


@dataclass(frozen=True, slots=True)
class ForceClosureSampler:
    """Plans grasps in force closure that the hand can reach without collision.

    1. Contact sets are drawn where the surface is flat enough for a pad and supported by touches
       (`sample_contact_sets`). If few grasps result, or none is likely to succeed, convex bends and
       narrow faces are used too: edges, thin rods, small balls and low plates. If none results,
       mostly for want of surface beside the first finger's contact, fingers come closer together.
    2. Inverse kinematics gives the palm's pose and the joints, and candidates that collide are
       rejected (`CandidateFilter`).
    3. `GraspScorer` rejects what is not in force closure, and predicts the success of the rest.
    4. The best are refined: contacts beside theirs replace them where success is likelier there.

    Parameters
    ----------
    hand
        The hand.
    friction
        Coulomb coefficient between pads and object.
    mass
        Mass of the object [kg].
    friction_spread, mass_spread
        Standard deviations of the logarithms of friction and mass, whose medians are then the
        values above; 0 where they are known. See `LoadPrior`.
    candidates
        Largest number of sampled contact sets, as many again with bends, and with closer fingers.
        Sampling ends early when enough grasps are robust. Refinement tries up to ten more sets for
        each grasp.
    station
        The `Station` of an arm, in whose reach grasps have to be; None for a free hand.
    """

    hand: Hand
    friction: float = 0.8
    mass: float = 0.2
    friction_spread: float = 0.0
    mass_spread: float = 0.0
    candidates: int = 4000
    station: Reach | None = None

    def __post_init__(self) -> None:
        self.load_prior()
        require_at_least(1, candidates=self.candidates)

    def load_prior(self) -> LoadPrior:
        """Return what is known of the object's mass and friction."""
        return LoadPrior(self.friction, self.mass, self.friction_spread, self.mass_spread)

    def sample(
        self,
        mesh: trimesh.Trimesh,
        *,
        rng: np.random.Generator,
        support_height: float | None = None,
        count: int = 10,
    ) -> GraspSearch:
        """Return up to `count` ranked grasps, and the reasons why other candidates were rejected.

        Besides the reasons of `sample_contact_sets` and `CandidateFilter` there are
        ``no_flat_supported_surface``: the mesh has no usable point; ``no_force_closure``; and
        ``outranked``: other grasps are better.

        Parameters
        ----------
        mesh
            Closed, outward-oriented surface in O [m], true or estimated. A vertex attribute
            ``"uncertainty"`` [m] keeps contacts where touches support it.
        rng
            For all random numbers.
        support_height
            Height of the plane that the object is on in O [m]; None where there is none.
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
        lowest = -np.inf if support_height is None else support_height + _LOWEST_PAD
        radius = min(pad.radius for pad in self.hand.pads)
        samples = SurfaceSamples(mesh, lowest=lowest, rng=rng, pad_radius=radius)
        candidate_filter = CandidateFilter(
            self.hand, mesh, support_height=support_height, reach=self.station
        )
        scorer = GraspScorer(self.hand, mesh, prior=self.load_prior(), rng=rng)
        search = _Search(self.hand, samples, candidate_filter, scorer, rng)
        search.draw_enough(self.candidates, count)
        if len(search.grasps) < count or search.likeliest() < _LIKELY:
            search.samples = SurfaceSamples(
                mesh, lowest=lowest, rng=rng, bends=True, pad_radius=radius
            )
            search.draw_enough(2 * self.candidates, count)
        if search.fingers_are_too_far_apart():
            search.spreads = NARROW_SPREADS
            search.draw_enough(3 * self.candidates, count)
        search.refine(count)
        search.predict_success(count)
        return search.result(count)


@dataclass(slots=True)
class _Search:
    """The grasps found so far, and counts of the rejected candidates."""

    hand: Hand
    samples: SurfaceSamples
    candidate_filter: CandidateFilter
    scorer: GraspScorer
    rng: np.random.Generator
    grasps: list[Grasp] = field(default_factory=list)
    rejected: Counter[str] = field(default_factory=Counter)
    drawn: int = 0
    spreads: Sequence[float] = SPREADS

    def draw_enough(self, candidates: int, count: int) -> None:
        """Sample until `candidates` are sampled, or enough more close at half the friction."""
        known = len(self.grasps)
        while self.drawn < candidates:
            robust = sum(grasp.quality["epsilon_robust"] > 0.0 for grasp in self.grasps[known:])
            missing = _ENOUGH * count - robust
            if missing <= 0:
                break
            _LOG.info("%d candidates, %d grasps so far", self.drawn, len(self.grasps))
            each = max(self.drawn / max(robust, 1), _SETS_PER_GRASP)
            batch = int(np.clip(each * missing, _SMALLEST_BATCH, _LARGEST_BATCH))
            self._draw(min(batch, candidates - self.drawn))

    def _draw(self, count: int) -> None:
        self.drawn += count
        if not len(self.samples):
            self.rejected["no_flat_supported_surface"] += count
            return
        sets, R_OH, failed = sample_contact_sets(
            self.hand, self.samples, count=count, spreads=self.spreads, rng=self.rng
        )
        self.rejected.update(failed)
        found = self._grasps_at(sets, *initial_postures(self.hand, sets, R_OH))
        self.grasps += found.values()

    def fingers_are_too_far_apart(self) -> bool:
        """Return whether no grasp was found, mostly as a finger had no surface beside another's."""
        rejected = self.rejected + self.candidate_filter.rejected
        beside = rejected["no_surface_for_a_finger"]
        return not self.grasps and beside > 0.5 * rejected.total()

    def likeliest(self) -> float:
        """Return the largest success probability of the grasps found so far, 0 without any."""
        return max(map(_success, self.grasps), default=0.0)

    def refine(self, count: int) -> None:
        """Replace the best `count` grasps by better ones near them, if there are any."""
        self.grasps.sort(key=_rank, reverse=True)
        best = self.grasps[:count]
        for distance in _STEPS if best else ():
            _LOG.info("improving %d grasps by steps of %.2g mm", len(best), 1e3 * distance)
            parents, sets, X_OH, q = perturb_grasps(
                self.hand, best, self.samples, each=_PERTURBATIONS, distance=distance, rng=self.rng
            )
            chosen = _best_of_each(parents, self.scorer.loads_per_grip(sets))
            self.drawn += len(chosen)
            ranks = np.array([_rank(grasp) for grasp in best])[parents[chosen]]
            found = self._grasps_at(sets.subset(chosen), X_OH[chosen], q[chosen], ranks)
            for i, grasp in found.items():
                parent = parents[chosen[i]]
                if _rank(grasp) > _rank(best[parent]):
                    best[parent] = grasp
            self.rejected["outranked"] += len(found)
        self.grasps[:count] = best
        self.grasps.sort(key=_rank, reverse=True)

    def predict_success(self, count: int) -> None:
        """Rank the best `count` grasps by precise qualities, over the prior of the load."""
        best = self.scorer.predict_success(self.grasps[:count])
        best = [self.scorer.plan_forces(grasp) for grasp in best]
        self.grasps[:count] = sorted(best, key=_rank, reverse=True)

    def result(self, count: int) -> GraspSearch:
        """Return the best `count` grasps."""
        self.rejected["outranked"] += max(len(self.grasps) - count, 0)
        rejected = self.rejected + self.candidate_filter.rejected + self.scorer.rejected
        return GraspSearch(
            tuple(self.grasps[:count]),
            {reason: n for reason, n in sorted(rejected.items()) if n},
            self.drawn,
        )

    def _grasps_at(
        self, sets: ContactSets, X_OH: FloatArray, q: FloatArray, ranks: FloatArray | None = None
    ) -> dict[int, Grasp]:
        """Return the grasps at contact sets, by the index of the set.

        Those that surely rank below given `ranks` (B,) may be left out.
        """
        kept, candidates = self.candidate_filter.solve_and_filter(sets, X_OH, q)
        least = None if ranks is None else ranks[kept] / _apart(candidates.clearance)
        found = self.scorer.score(candidates, least)
        return {int(kept[i]): grasp for i, grasp in found.items()}


def _success(grasp: Grasp) -> float:
    return grasp.quality["success_probability"]


def _rank(grasp: Grasp) -> float:
    """Return the predicted success, times the probability that only fingertips touch."""
    return _success(grasp) * float(_apart(grasp.quality["clearance"]))


def _apart(clearance: npt.ArrayLike) -> FloatArray:
    """Return the probability that links planned at a clearance [m] do not touch the object."""
    return np.asarray(ndtr(np.asarray(clearance) / _LINK_ERROR))


def _best_of_each(parents: IndexArray, loads: FloatArray) -> IndexArray:
    """Return the few perturbations of each parent with the largest load above 0."""
    order = np.lexsort((-loads, parents))
    ranks = np.arange(len(order)) - np.searchsorted(parents[order], parents[order])
    return np.sort(order[(ranks < _TRIED) & (loads[order] > 0.0)])


def perturb_grasps(
    hand: Hand,
    grasps: Sequence[Grasp],
    samples: SurfaceSamples,
    *,
    each: int,
    distance: float,
    rng: np.random.Generator,
) -> tuple[IndexArray, ContactSets, FloatArray, FloatArray]:
    """Perturb the contacts of grasps, and project them on the surface.

    All contacts of a set move by one common random step, blended with a step of each contact by a
    random weight. Steps are drawn in the palm's frame, so that grasps turn with the object. Sets
    with a contact that finds no usable surface are left out.

    Each grasp gets `each` draws, with steps of the standard deviation `distance` [m] in each
    coordinate. Returned are, of B sets: the index (B,) of the perturbed grasp, the sets, and an
    initial guess of inverse kinematics: palm poses (B, 4, 4) and joint positions (B, J).
    """
    parents = np.repeat(np.arange(len(grasps)), each)
    contacts = contacts_of(grasps, hand).subset(parents)
    points, used = contacts.points, contacts.used
    alone = rng.random((len(parents), 1, 1))
    poses = np.array([grasp.X_OH for grasp in grasps])
    steps_H = rng.normal(scale=distance, size=(len(parents), 1 + len(hand.pads), 3))
    steps = rotate(poses[parents], steps_H)
    moved = points + (1.0 - alone) * steps[:, :1] + alone * steps[:, 1:]
    on_surface, normals, usable = samples.nearest(moved, contacts.normals)
    kept = (usable | ~used).all(axis=1)
    X_OH = poses[parents[kept]]
    q = np.array([grasp.joint_positions for grasp in grasps])[parents[kept]]
    mask = used[kept][..., None]
    sets = ContactSets(
        np.where(mask, on_surface[kept], 0.0),
        np.where(mask, normals[kept], 0.0),
        used[kept],
    )
    # The palm moves with the middle of the contacts.
    shift = ((on_surface - points) * used[..., None]).sum(axis=1) / used.sum(axis=1)[:, None]
    X_OH[:, :3, 3] += shift[kept]
    return parents[kept], sets, X_OH, q
