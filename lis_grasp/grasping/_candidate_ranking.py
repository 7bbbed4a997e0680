"""Ranking of grasp candidates: what of contact sets is rejected, and in which order the rest is."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from lis_grasp.grasping._candidate_filter import CandidateFilter
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.grasping.grasp_quality import GraspScorer
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.typing import FloatArray, IndexArray

# Standard deviation of the distance between a link and the surface where both are planned [m].
_LINK_ERROR = 0.002


@dataclass(frozen=True, slots=True, eq=False)
class CandidateRanking:
    """The filter and the scorer of the contact sets of one hand on one mesh."""

    candidate_filter: CandidateFilter
    scorer: GraspScorer

    def scored(
        self, sets: GraspBatch, ranks: FloatArray | None = None
    ) -> tuple[IndexArray, GraspBatch]:
        """Return the indices of the contact sets with a grasp, and their grasps.

        Those that surely rank below given `ranks` (B,) may be left out.
        """
        kept, candidates = self.candidate_filter.solve_and_filter(sets)
        assert candidates.clearance is not None
        least = None if ranks is None else ranks[kept] / _apart(candidates.clearance)
        closed, scored = self.scorer.score(candidates, least)
        return kept[closed], scored

    def search(
        self, found: GraspBatch | None, rejected: Counter[str], candidates: int
    ) -> GraspSearch:
        """Return the grasps, ranked by precise qualities, over the prior of the load."""
        grasps: list[Grasp] = []
        if found is not None:
            grasps = self.scorer.plan_forces(ranked(self.scorer.predict_success(found)))
        return self.candidate_filter.search(grasps, rejected + self.scorer.rejected, candidates)


def ranks_of(grasps: GraspBatch) -> FloatArray:
    """Return the predicted success, times the probability that only fingertips touch, (B,)."""
    quality = grasps.quality
    return np.asarray(quality["success_probability"] * _apart(quality["clearance"]))


def ranked(grasps: GraspBatch) -> GraspBatch:
    """Return grasps in the order of their ranks, the best first."""
    return grasps.subset(np.argsort(-ranks_of(grasps), kind="stable"))


def _apart(clearance: npt.ArrayLike) -> FloatArray:
    """Return the probability that links planned at a clearance [m] do not touch the object."""
    return np.asarray(ndtr(np.asarray(clearance) / _LINK_ERROR))
