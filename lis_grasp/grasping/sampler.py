"""Sample force-closure grasps of a hand on a mesh: contacts, reach, collision, quality, rank."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.exceptions import InvalidMeshError, InvalidOptionError
from lis_grasp.grasping.assessment import GraspAssessor
from lis_grasp.grasping.contact_samples import SurfaceSamples
from lis_grasp.grasping.contact_search import ContactSets, find_contact_sets, initial_postures
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.grasping.placement import HandPlacer
from lis_grasp.grasping.refinement import vary
from lis_grasp.hands.hand import Hand
from lis_grasp.typing import FloatArray

# Contact sets that are worked on together.
_ROUND = 100
# Ranking gains little from more grasps than this many times those asked for.
_ENOUGH = 5
# Refinement goes by steps of these standard deviations [m]; of so many variations of a grasp it
# tries so many, those of the best epsilon.
_STEPS = (0.01, 0.01, 0.005, 0.005, 0.0025)
_VARIATIONS, _TRIED = 20, 2


@dataclass(frozen=True, slots=True)
class ForceClosureSampler:
    """Finds grasps in force closure, free of collision, that the hand can reach.

    Contact sets are drawn where the surface is flat enough for a pad and supported by touches, and
    if no grasp comes of that also across convex bends: a prism of five sides has an edge opposite
    each face, and thin rods and small balls have nothing else. The palm's pose and the joints
    follow by inverse kinematics; a filter and FCL judge every link at the grasp, at the opened
    posture, and along the approach (`HandPlacer`); what is left is assessed and ranked by
    `GraspAssessor`. Then the best are refined: contacts beside theirs, ever nearer ones, replace
    them where a grasp at these is likelier to hold.

    Parameters
    ----------
    hand
        The hand.
    friction
        Coulomb coefficient between pads and object.
    candidates
        Contact sets to draw at the most; fewer, once enough grasps hold, and as many again with
        bends. Refinement tries up to ten more for each grasp asked for.
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
        largest_pad = max(pad.radius for pad in self.hand.pads)
        lowest = -np.inf if support_height is None else support_height + largest_pad + 0.004
        samples = SurfaceSamples(mesh, lowest=lowest, rng=rng)
        placer = HandPlacer(self.hand, mesh, support_height=support_height)
        assessor = GraspAssessor(self.hand, mesh, friction=self.friction, rng=rng)
        search = _Search(self.hand, samples, placer, assessor, rng)
        search.draw_enough(self.candidates, count)
        if not search.found:
            search.samples = SurfaceSamples(mesh, lowest=lowest, rng=rng, bends=True)
            search.draw_enough(2 * self.candidates, count)
        search.refine(count)
        return search.result(count)


class _Search:
    """A search as it goes: grasps so far, and what became of the other candidates."""

    def __init__(
        self,
        hand: Hand,
        samples: SurfaceSamples,
        placer: HandPlacer,
        assessor: GraspAssessor,
        rng: np.random.Generator,
    ) -> None:
        self._hand, self.samples, self._rng = hand, samples, rng
        self._placer, self._assessor = placer, assessor
        self._grasps: list[Grasp] = []
        self._rejected: Counter[str] = Counter()
        self.drawn = 0

    @property
    def robust(self) -> int:
        """How many grasps close at half the friction, too."""
        return sum(grasp.quality["epsilon_robust"] > 0.0 for grasp in self._grasps)

    @property
    def found(self) -> bool:
        """Whether there are grasps."""
        return bool(self._grasps)

    def draw_enough(self, candidates: int, count: int) -> None:
        """Draw until there were so many candidates, or there is a choice of `count` that hold."""
        while self.drawn < candidates and self.robust < _ENOUGH * count:
            self.draw(min(_ROUND, candidates - self.drawn))

    def draw(self, count: int) -> None:
        """Draw contact sets, and keep the grasps that come of them."""
        self.drawn += count
        if not len(self.samples):
            self._rejected["no_flat_supported_surface"] += count
            return
        sets, misses = find_contact_sets(self._hand, self.samples, count=count, rng=self._rng)
        self._rejected.update(misses)
        found = self._assessed(sets, *initial_postures(self._hand, sets))
        self._grasps += found.values()

    def refine(self, count: int) -> None:
        """Replace the best `count` grasps by better ones near them, step by step."""
        self._grasps.sort(key=_chance, reverse=True)
        best = self._grasps[:count]
        for distance in _STEPS if best else ():
            parents, sets, X_OH, q = vary(
                self._hand, best, self.samples, each=_VARIATIONS, distance=distance, rng=self._rng
            )
            chosen = _best_of_each(parents, self._assessor.robust_epsilons(sets))
            self.drawn += len(chosen)
            found = self._assessed(sets.subset(chosen), X_OH[chosen], q[chosen])
            for i, grasp in found.items():
                parent = parents[chosen[i]]
                if _chance(grasp) > _chance(best[parent]):
                    best[parent] = grasp
            self._rejected["outranked"] += len(found)
        self._grasps[:count] = best
        self._grasps.sort(key=_chance, reverse=True)

    def result(self, count: int) -> GraspSearch:
        """Return the best `count` grasps."""
        self._rejected["outranked"] += max(len(self._grasps) - count, 0)
        rejected = self._rejected + self._placer.rejected
        return GraspSearch(
            tuple(self._grasps[:count]),
            {reason: n for reason, n in sorted(rejected.items()) if n},
            self.drawn,
        )

    def _assessed(self, sets: ContactSets, X_OH: FloatArray, q: FloatArray) -> dict[int, Grasp]:
        """Return the grasps among contact sets, by the index of the set."""
        kept, placed = self._placer.place(sets, X_OH, q)
        found = self._assessor.assess(placed)
        self._rejected["no_force_closure"] += len(placed) - len(found)
        return {int(kept[i]): grasp for i, grasp in found.items()}


def _chance(grasp: Grasp) -> float:
    return grasp.quality["success_probability"]


def _best_of_each(parents: npt.NDArray[np.intp], promises: FloatArray) -> npt.NDArray[np.intp]:
    """Return the few variations of each parent that promise most, none that promises nothing."""
    order = np.lexsort((-promises, parents))
    ranks = np.arange(len(order)) - np.searchsorted(parents[order], parents[order])
    return np.sort(order[(ranks < _TRIED) & (promises[order] > 0.0)])
